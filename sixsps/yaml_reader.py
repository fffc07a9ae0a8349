"""YAML as data: YAML 1.2 scalars, unique keys, bounded size, and the line of every key."""

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


_INTEGER = re.compile(r"[-+]?[0-9]+$")
_FLOAT = re.compile(
    r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
)
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"(?:true|false)$"), list("tf"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"(?:~|null|)$"), ["~", "n", ""])
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:merge", re.compile(r"<<$"), ["<"])


def _number(loader: _Loader, node: yaml.ScalarNode) -> float:
    text = loader.construct_scalar(node)
    return float(text.replace(".inf", "inf").replace(".nan", "nan")) if text[-1:].isalpha() else float(text)


@dataclass(frozen=True)
class Document:
    """A YAML document: its plain content, and where each key stands."""

    source: str
    content: Any
    lines: dict[str, int]

    def locate(self, place: str) -> str:
        """Returns `source:line` of a dotted key path, or of its nearest parent that exists."""
        parts = place.replace("[", ".").replace("]", "").replace(", ", ".").split(".")
        while parts:
            line = self.lines.get(".".join(parts))
            if line is not None:
                return f"{self.source}:{line}"
            parts.pop()
        return self.source


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
        lines: dict[str, int] = {}
        _index(node, "", lines, source)
        return Document(source, loader.construct_document(node), lines)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        problem = error.problem or "cannot be parsed"
        raise MechanismError(f"line {line}", problem, "YAML without object tags", source) from None
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


def _index(node: yaml.Node, place: str, lines: dict[str, int], source: str) -> None:
    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            name = str(key.value)
            path = f"{place}.{name}" if place else name
            if name in seen:
                line = key.start_mark.line + 1
                raise MechanismError(path, "repeated key", "each key once", f"{source}:{line}")
            seen.add(name)
            lines[path] = key.start_mark.line + 1
            _index(value, path, lines, source)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            path = f"{place}.{index}" if place else str(index)
            lines[path] = value.start_mark.line + 1
            _index(value, path, lines, source)


_Loader.add_constructor("tag:yaml.org,2002:float", _number)
