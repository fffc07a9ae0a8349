"""Mechanism files: YAML in and out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError

from sixsps.bodies import Leg, Link, Platform
from sixsps.errors import MechanismError
from sixsps.files import exists, read_bytes, write_atomically
from sixsps.limits import Limits
from sixsps.mechanism import Mechanism
from sixsps.yaml_reader import Document, read_document, write_document

# The largest bundled file has 2 kB; a mechanism has about 200 numbers however it is laid out.
_LARGEST_FILE = 64 * 1024

Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Anchors = Annotated[list[Vector], Field(min_length=6, max_length=6)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Base(_Section):
    anchors: Anchors


class _Inertia(_Section):
    xx: Number
    yy: Number
    zz: Number
    xy: Number = 0.0
    xz: Number = 0.0
    yz: Number = 0.0


class _Platform(_Section):
    anchors: Anchors
    mass: Number
    com: Vector = [0.0, 0.0, 0.0]
    inertia: _Inertia


class _BarePlatform(_Section):
    anchors: Anchors


class _LinkInertia(_Section):
    transverse: Number
    axial: Number


class _Link(_Section):
    mass: Number
    length: Number
    com: Number | None = None
    inertia: _LinkInertia | None = None
    radius: Number | None = None


class _Leg(_Section):
    lower: _Link
    upper: _Link
    length_limits: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None


class _BareLeg(_Section):
    length_limits: Annotated[list[Number], Field(min_length=2, max_length=2)]


def _shape_of_legs(value: object) -> str:
    return "each" if isinstance(value, list) else "shared"


_Six = Annotated[list[_Leg], Field(min_length=6, max_length=6)]
_Legs = Annotated[
    Annotated[_Leg, Tag("shared")] | Annotated[_Six, Tag("each")], Discriminator(_shape_of_legs)
]
_BareSix = Annotated[list[_BareLeg], Field(min_length=6, max_length=6)]
_BareLegs = Annotated[
    Annotated[_BareLeg, Tag("shared")] | Annotated[_BareSix, Tag("each")], Discriminator(_shape_of_legs)
]


class _Limits(_Section):
    """Keys alone: what their values may be is for `Limits` to say."""

    force: Any = None
    rate: Any = None
    base_cone: Any = None
    base_axes: Any = None
    platform_cone: Any = None
    platform_axes: Any = None
    clearance: Any = None


class _File(_Section):
    name: str
    source: str = ""
    assumed: dict[str, str] = {}
    gravity: Vector
    base: _Base
    platform: _Platform
    legs: _Legs
    limits: _Limits = _Limits()


class _BareFile(_Section):
    """A file of geometry alone."""

    name: str
    source: str = ""
    assumed: dict[str, str] = {}
    gravity: Vector | None = None
    base: _Base
    platform: _BarePlatform
    legs: _BareLegs | None = None
    limits: _Limits = _Limits()


def bundled_mechanisms() -> list[str]:
    """Returns the names of the mechanisms that ship with this package."""
    names = (entry.name for entry in _data().iterdir())
    return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))


def load(name_or_path: str | Path) -> Mechanism:
    """Reads a mechanism by bundled name or path.

    Raises:
        MechanismError: naming file and line, key, value and what is allowed.
    """
    if str(name_or_path) in bundled_mechanisms():
        content = (_data() / f"{name_or_path}.yaml").read_bytes()
        return parse(content, f"{name_or_path}.yaml")
    path = Path(name_or_path)
    if not exists(path) and path.suffix not in (".yaml", ".yml"):
        allowed = f"a YAML file or one of {', '.join(bundled_mechanisms())}"
        raise MechanismError("mechanism", "no such file or bundled name", allowed, str(path))
    return parse(read_bytes(path, "mechanism", MechanismError, _LARGEST_FILE), str(path))


def parse(content: bytes, source: str) -> Mechanism:
    """Returns the mechanism that the YAML text `content` describes.

    Args:
        content: UTF-8 YAML.
        source: what to call it in errors.

    Raises:
        MechanismError: naming `source` and line, key, value and what is allowed.
    """
    document = read_document(content, source)
    schema = _BareFile if _is_bare(document.content) else _File
    try:
        return _mechanism(schema.model_validate(document.content))
    except ValidationError as error:
        raise _explained(error, document, schema) from None
    except MechanismError as error:
        path = tuple(error.place.replace("[", ".").replace("]", "").replace(", ", ".").split("."))
        raise MechanismError(error.place, error.value, error.allowed, document.locate(path)) from None


def save(mechanism: Mechanism, path: Path) -> None:
    """Writes `mechanism` as YAML; floats read back exactly.

    Raises:
        OutputError: `path` cannot be written.
    """
    text = write_document(mechanism.to_mapping())
    with write_atomically(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _data() -> Traversable:
    return resources.files("sixsps") / "data"


def _is_bare(content: object) -> bool:
    """Whether the content has nothing of inertia: what has some of it has forgotten the rest."""
    if not isinstance(content, dict):
        return False
    platform, legs = content.get("platform"), content.get("legs", {})
    return (
        isinstance(platform, dict)
        and not {"mass", "com", "inertia"} & platform.keys()
        and all(
            isinstance(leg, dict) and not {"lower", "upper"} & leg.keys()
            for leg in (legs if isinstance(legs, list) else [legs])
        )
    )


def _mechanism(file: _File | _BareFile) -> Mechanism:
    inertial: dict[str, Any] = {} if file.gravity is None else {"gravity": np.array(file.gravity)}
    if isinstance(file, _File):
        inertial["platform"] = _platform(file.platform)
    if file.legs is not None:
        inertial["legs"] = tuple(_legs(file.legs))
    return Mechanism(
        name=file.name,
        base_anchors=np.array(file.base.anchors),
        platform_anchors=np.array(file.platform.anchors),
        source=file.source,
        assumed=file.assumed,
        limits=Limits.of(file.limits.model_dump()),
        **inertial,
    )


def _platform(platform: _Platform) -> Platform:
    inertia = platform.inertia
    matrix = np.array(
        [
            [inertia.xx, inertia.xy, inertia.xz],
            [inertia.xy, inertia.yy, inertia.yz],
            [inertia.xz, inertia.yz, inertia.zz],
        ]
    )
    return Platform(platform.mass, np.array(platform.com), matrix)


def _legs(legs: _Leg | _BareLeg | Sequence[_Leg | _BareLeg]) -> Iterator[Leg]:
    if isinstance(legs, Sequence):
        for index, leg in enumerate(legs):
            yield _leg(leg, f"legs.{index}")
    else:
        yield from [_leg(legs, "legs")] * 6


def _leg(leg: _Leg | _BareLeg, place: str) -> Leg:
    halves: dict[str, Any] = {}
    if isinstance(leg, _Leg):
        halves = {name: _link(getattr(leg, name), f"{place}.{name}") for name in ("lower", "upper")}
    if leg.length_limits is not None:
        halves["length_limits"] = (leg.length_limits[0], leg.length_limits[1])
    try:
        return Leg(**halves)
    except MechanismError as error:
        raise MechanismError(f"{place}.{error.place}", error.value, error.allowed) from None


def _link(link: _Link, place: str) -> Link:
    if (link.inertia is None) == (link.radius is None):
        given = "both" if link.inertia else "neither"
        raise MechanismError(place, f"{given} of inertia and radius", "exactly one of them")
    try:
        if link.inertia is None:
            return Link.solid_cylinder(link.mass, link.length, link.radius or 0.0, link.com)
        com = link.length / 2 if link.com is None else link.com
        return Link(link.mass, link.length, com, link.inertia.transverse, link.inertia.axial)
    except MechanismError as error:
        raise MechanismError(f"{place}.{error.place}", error.value, error.allowed) from None


_ALLOWED = {
    "extra_forbidden": "no such key",
    "missing": "this key is required",
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text (in quotes where it looks like a number)",
    "list_type": "a list",
    "model_type": "a mapping of keys",
    "dict_type": "a mapping of keys",
}


def _explained(error: ValidationError, document: Document, schema: type[BaseModel]) -> MechanismError:
    detail = error.errors(include_url=False)[0]
    path = list(detail["loc"])
    if path[:1] == ["legs"] and path[1:2] in (["shared"], ["each"]):
        del path[1]  # which of the two shapes of legs, no key of the file
    place = ".".join(str(part) for part in path) or "the file"
    kind, value = detail["type"], detail["input"]
    allowed = _ALLOWED.get(kind, detail["msg"])
    if kind == "missing":
        value = "missing"
    elif isinstance(value, str):
        value = repr(value)  # with the quotes that tell text from a number
    if kind == "extra_forbidden":
        allowed = _known_keys(schema, path[:-1])
    elif kind in ("too_short", "too_long"):
        context: dict[str, Any] = detail["ctx"]
        value = f"{context['actual_length']} entries"
        allowed = f"{context.get('min_length', context.get('max_length'))} entries"
    return MechanismError(place, value, allowed, document.locate(tuple(map(str, path))))


def _known_keys(schema: type[BaseModel], path: list[int | str]) -> str:
    section = schema
    for part in path:
        if isinstance(part, int):
            continue
        sections: dict[str, type[BaseModel]] = {
            "base": _Base,
            "platform": _Platform,
            "legs": _Leg,
            "lower": _Link,
            "upper": _Link,
            "inertia": _Inertia if section is _Platform else _LinkInertia,
            "limits": _Limits,
        }
        section = sections[part]
    return "the keys " + ", ".join(section.model_fields)
