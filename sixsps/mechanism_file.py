"""Mechanism files: YAML in and out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Discriminator, Field, Tag, ValidationError

from sixsps.bodies import Leg, Link, Platform
from sixsps.errors import MechanismError
from sixsps.files import exists, read_bytes, write_atomically
from sixsps.limits import Limits
from sixsps.mechanism import Mechanism
from sixsps.yaml_reader import read_document, write_document
from sixsps.yaml_schema import Inertia, Number, Section, Vector, explained, located

# The largest bundled file has 2 kB; a mechanism has about 200 numbers however it is laid out.
_LARGEST_FILE = 64 * 1024

Anchors = Annotated[list[Vector], Field(min_length=6, max_length=6)]


class _Base(Section):
    anchors: Anchors


class _Platform(Section):
    anchors: Anchors
    mass: Number
    com: Vector = Field(default=[0.0, 0.0, 0.0])
    inertia: Inertia


class _BarePlatform(Section):
    anchors: Anchors


class _LinkInertia(Section):
    transverse: Number
    axial: Number


class _Link(Section):
    mass: Number
    length: Number
    com: Number | None = None
    inertia: _LinkInertia | None = None
    radius: Number | None = None


class _Leg(Section):
    lower: _Link
    upper: _Link
    length_limits: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None


class _BareLeg(Section):
    # The longest may be infinite, for a leg of which the shortest alone is known.
    length_limits: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None


def _shape_of_legs(value: object) -> str:
    return "each" if isinstance(value, list) else "shared"


def _keys(path: Sequence[int | str]) -> Sequence[int | str]:
    """Takes the shape of the legs, which is no key of the file, out of a path of pydantic's."""
    return (path[0], *path[2:]) if len(path) > 1 and path[0] == "legs" else path


_Six = Annotated[list[_Leg], Field(min_length=6, max_length=6)]
_Legs = Annotated[
    Annotated[_Leg, Tag("shared")] | Annotated[_Six, Tag("each")], Discriminator(_shape_of_legs)
]
_BareSix = Annotated[list[_BareLeg], Field(min_length=6, max_length=6)]
_BareLegs = Annotated[
    Annotated[_BareLeg, Tag("shared")] | Annotated[_BareSix, Tag("each")], Discriminator(_shape_of_legs)
]


class _Limits(Section):
    """Keys alone: what their values may be is for `Limits` to say."""

    force: Any = None
    rate: Any = None
    base_cone: Any = None
    base_axes: Any = None
    platform_cone: Any = None
    platform_axes: Any = None
    clearance: Any = None


class _File(Section):
    name: str
    source: str = ""
    assumed: dict[str, str] = Field(default_factory=dict)
    gravity: Vector
    base: _Base
    platform: _Platform
    legs: _Legs
    limits: _Limits = _Limits()


class _BareFile(Section):
    """A file of geometry alone."""

    name: str
    source: str = ""
    assumed: dict[str, str] = Field(default_factory=dict)
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
        raise explained(error, document, partial(_section, schema), _keys) from None
    except MechanismError as error:
        raise located(error, document) from None


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
    platform, legs = content.get("platform"), content.get("legs") or {}
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
    return Platform(platform.mass, np.array(platform.com), platform.inertia.matrix)


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


def _section(schema: type[BaseModel], path: Sequence[str]) -> type[BaseModel]:
    """Returns the schema of the section at a key path."""
    section = schema
    for part in path:
        if part.isdecimal():
            continue
        sections: dict[str, type[BaseModel]] = {
            "base": _Base,
            "platform": _Platform if schema is _File else _BarePlatform,
            "legs": _Leg if schema is _File else _BareLeg,
            "lower": _Link,
            "upper": _Link,
            "inertia": _LinkInertia if section is _Link else Inertia,
            "limits": _Limits,
        }
        section = sections[part]
    return section
