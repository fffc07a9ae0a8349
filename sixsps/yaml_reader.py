"""YAML as plain data: YAML 1.2 scalars, no tags, unique keys, bounded size, a line for every key."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import yaml

from sixsps.errors import MechanismError

# Nodes after aliases are written out; a mechanism with six different legs has about 300.
_MOST_NODES = 20_000


class _Loader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2: 1e-4 is a number, `on` and 1:30 are text."""

    yaml_implicit_resolvers = {}  # noqa: RUF012  filled below


class _Dumper(yaml.SafeDumper):
    """SafeDumper that quotes the text that `_Loader` would take for something else."""

    yaml_implicit_resolvers = {}  # noqa: RUF012  filled below


_SCALARS = {
    "bool": re.compile(r"(?:true|false)$"),
    "null": re.compile(r"(?:~|null|)$"),
    "float": re.compile(
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
    ),
    "merge": re.compile(r"<<$"),
}
_TEXT, _MERGE = "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"
_FIRST = {"bool": "tf", "null": ["~", "n", ""], "float": "-+.0123456789", "merge": "<"}
for _kind, _pattern in _SCALARS.items():
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", _pattern, list(_FIRST[_kind]))


def _number(loader: _Loader, node: yaml.ScalarNode) -> float:
    text = loader.construct_scalar(node).lower()
    return float(text.replace(".inf", "inf").replace(".nan", "nan"))


@dataclass(frozen=True)
class Document:
    """A YAML document: its plain content, and where each key stands."""

    source: str
    content: Any
    lines: dict[tuple[str, ...], int]

    def locate(self, path: tuple[str, ...]) -> str:
        """Returns `source:line` of a key path, or of its nearest parent that exists."""
        while path:
            if path in self.lines:
                return f"{self.source}:{self.lines[path]}"
            path = path[:-1]
        return self.source


def write_document(content: Any) -> str:
    """Returns the YAML text of plain data, such that `read_document` gives it back."""
    text: str = yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)
    return text


def read_document(content: bytes, source: str) -> Document:
    """Parses one YAML document without executing or expanding anything.

    Args:
        content: UTF-8 text.
        source: what to call it in errors.

    Raises:
        MechanismError: not text, not YAML, an object tag, a repeated key, or aliases that would
            blow it up.
    """
    try:
        loader = _Loader(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise MechanismError(f"byte {error.start}", "binary data", "UTF-8 text", source) from None
    except yaml.reader.ReaderError as error:
        place = f"character {error.position}"
        raise MechanismError(place, f"#x{ord(chr(error.character)):04x}", "printable text", source) from None
    try:
        node = loader.get_single_node()
        if node is None:
            raise MechanismError("the file", "empty", "a mapping of keys", source)
        _refuse_expansion(node, source)
        lines: dict[tuple[str, ...], int] = {}
        _index(node, (), lines, source)
        return Document(source, loader.construct_document(node), lines)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        problem = error.problem or "cannot be parsed"
        raise MechanismError(f"line {line}", problem, "well-formed YAML", source) from None
    except (ValueError, OverflowError) as error:  # an escape that is no character
        raise MechanismError("the file", str(error), "Unicode text", source) from None
    except RecursionError:
        raise MechanismError("the file", "nested too deeply", "a mapping of keys", source) from None
    finally:
        loader.dispose()


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [child for pair in node.value for child in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _refuse_expansion(root: yaml.Node, source: str) -> None:
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()

    def size(node: yaml.Node) -> int:
        if id(node) in open_nodes:
            raise MechanismError("the file", "an alias that contains itself", "plain data", source)
        if id(node) not in sizes:
            open_nodes.add(id(node))
            sizes[id(node)] = 1 + sum(size(child) for child in _children(node))
            open_nodes.remove(id(node))
        return sizes[id(node)]

    if size(root) > _MOST_NODES:
        allowed = f"at most {_MOST_NODES} entries after aliases are written out"
        raise MechanismError("the file", f"{size(root)} entries", allowed, source)


def _index(node: yaml.Node, path: tuple[str, ...], lines: dict[tuple[str, ...], int], source: str) -> None:
    _refuse_tag(node, path, source)
    if isinstance(node, yaml.MappingNode):
        own: set[str] = set()
        for key, value in node.value:
            name, line = str(key.value), key.start_mark.line + 1
            inner = (*path, name)
            if name in own:
                raise MechanismError(".".join(inner), "repeated key", "each key once", f"{source}:{line}")
            own.add(name)
            lines[inner] = line
            _refuse_tag(key, inner, source)
            if key.tag not in (_TEXT, _MERGE):
                raise MechanismError(".".join(inner), "no text", "keys that are text", f"{source}:{line}")
            _index(value, inner, lines, source)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            inner = (*path, str(index))
            lines[inner] = value.start_mark.line + 1
            _index(value, inner, lines, source)


def _refuse_tag(node: yaml.Node, path: tuple[str, ...], source: str) -> None:
    """Raises MechanismError for a tag that this reader would not have given itself."""
    kind = str(node.tag).removeprefix("tag:yaml.org,2002:")
    text = node.value if isinstance(node, yaml.ScalarNode) else ""
    pattern = _SCALARS.get(kind)
    if kind in ("str", "map", "seq") or (pattern and pattern.match(text)):
        return
    where = f"{source}:{node.start_mark.line + 1}"
    found = f"{node.tag} {text}".strip()
    raise MechanismError(".".join(path) or "the file", found, "YAML without object tags", where)


_Loader.add_constructor("tag:yaml.org,2002:float", _number)
