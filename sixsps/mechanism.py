"""The mechanism: geometry and inertia of a hexapod, frozen and validated."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from sixsps.arrays import LARGEST, Array, frozen
from sixsps.errors import MechanismError
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

_LONGEST_NAME = 200
# Inertia that was turned or read from a drawing may miss symmetry, and a thin plate equality in the
# triangle inequality, by this much relative.
_ROUNDING = 1e-9


def _positive(value: float, place: str, unit: str) -> None:
    _number(value, place, unit)
    if not value > 0:
        raise MechanismError(place, value, f"finite and > 0 [{unit}]")


def _number(value: float, place: str, unit: str) -> None:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise MechanismError(place, value, f"a number [{unit}]")
    if not abs(float(value)) <= LARGEST:
        raise MechanismError(place, value, f"a finite number up to {LARGEST:g} [{unit}]")


@dataclass(frozen=True)
class Link:
    """One rigid half of a leg, symmetric about the leg axis.

    Attributes:
        mass: [kg], > 0.
        length: [m], > 0; sets the default length limits and the drawing, no force of a given motion.
        com: distance of the centre of mass from the link's own joint (A for the lower, B for the
            upper link) towards the other [m].
        transverse: moment of inertia about any axis across the leg through the com [kg m^2], > 0.
        axial: moment of inertia about the leg axis [kg m^2], > 0 and at most 2 * transverse; no
            leg force depends on it (the leg does not spin), simulators need it.

    Raises:
        MechanismError: a value is out of range.
    """

    mass: float
    length: float
    com: float
    transverse: float
    axial: float

    def __post_init__(self) -> None:
        _positive(self.mass, "mass", "kg")
        _positive(self.length, "length", "m")
        _number(self.com, "com", "m")
        _positive(self.transverse, "inertia.transverse", "kg m^2")
        _positive(self.axial, "inertia.axial", "kg m^2")
        for name in ("mass", "length", "com", "transverse", "axial"):
            object.__setattr__(self, name, float(getattr(self, name)))
        if self.axial > 2 * self.transverse * (1 + _ROUNDING):
            allowed = f"at most twice the transverse inertia, {2 * self.transverse!r} kg m^2"
            raise MechanismError("inertia.axial", self.axial, allowed)

    @classmethod
    def solid_cylinder(cls, mass: float, length: float, radius: float, com: float | None = None) -> Link:
        """Returns a link with the inertia of a solid cylinder.

        Args:
            mass: [kg].
            length: [m].
            radius: [m], > 0.
            com: distance of the centre of mass from the link's joint [m]; length / 2 by default.

        Raises:
            MechanismError: a value is out of range.
        """
        _positive(mass, "mass", "kg")
        _positive(length, "length", "m")
        _positive(radius, "radius", "m")
        mass, length, radius = float(mass), float(length), float(radius)
        transverse = mass * (3 * radius**2 + length**2) / 12
        return cls(mass, length, length / 2 if com is None else com, transverse, mass * radius**2 / 2)


@dataclass(frozen=True)
class Leg:
    """A telescopic leg: lower link at the base, upper link at the platform.

    Attributes:
        lower: the cylinder, turning about A.
        upper: the rod, turning about B.
        length_limits: shortest and longest distance A to B [m], by default what the lengths of the
            links allow; never changes the forces of a given motion, only flags samples outside.

    Raises:
        MechanismError: the limits are not 0 <= shortest < longest.
    """

    lower: Link
    upper: Link
    length_limits: tuple[float, float] = None  # type: ignore[assignment]  # a pair once constructed

    def __post_init__(self) -> None:
        given = self.length_limits
        if given is None:
            given = (max(self.lower.length, self.upper.length), self.lower.length + self.upper.length)
        low, high = (float(limit) for limit in frozen(given, (2,), "length_limits", MechanismError))
        if not 0 <= low < high:
            raise MechanismError("length_limits", [low, high], "0 <= shortest < longest [m]")
        object.__setattr__(self, "length_limits", (low, high))


@dataclass(frozen=True, eq=False)
class Platform:
    """The moving platform's mass properties, in the platform frame O1-X1Y1Z1.

    Attributes:
        mass: [kg], > 0.
        com: (3,) centre of mass from O1 [m] (r_m of the paper).
        inertia: (3, 3) about the centre of mass, platform axes [kg m^2].

    Raises:
        MechanismError: a value is out of range, or no rigid body has that inertia.
    """

    mass: float
    com: Array
    inertia: Array

    def __post_init__(self) -> None:
        _positive(self.mass, "platform.mass", "kg")
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "com", frozen(self.com, (3,), "platform.com", MechanismError))
        inertia = frozen(self.inertia, (3, 3), "platform.inertia", MechanismError)
        if np.abs(inertia - inertia.T).max() > _ROUNDING * np.abs(inertia).max():
            raise MechanismError("platform.inertia", inertia.tolist(), "a symmetric matrix")
        inertia = frozen((inertia + inertia.T) / 2, (3, 3), "platform.inertia", MechanismError)
        object.__setattr__(self, "inertia", inertia)
        principal = np.linalg.eigvalsh(inertia)
        if principal[0] <= 0:
            allowed = "positive principal moments [kg m^2]"
            raise MechanismError("platform.inertia", f"principal moments {principal}", allowed)
        if principal[2] > (principal[0] + principal[1]) * (1 + _ROUNDING):
            allowed = "no principal moment larger than the sum of the other two"
            raise MechanismError("platform.inertia", f"principal moments {principal}", allowed)


@dataclass(frozen=True, eq=False)
class Links:
    """The six lower or the six upper links as arrays; fields as in `Link`, each (6,)."""

    mass: Array
    length: Array
    com: Array
    transverse: Array
    axial: Array

    @classmethod
    def stack(cls, links: Sequence[Link]) -> Links:
        """Returns the fields of `links` as arrays."""
        names = ("mass", "length", "com", "transverse", "axial")
        columns = ([getattr(link, name) for link in links] for name in names)
        return cls(*(frozen(column, (len(links),), "links", MechanismError) for column in columns))


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A 6-SPS hexapod (Stewart-Gough platform), frozen.

    Attributes:
        name: any printable text; never used as a path or in a template.
        gravity: (3,) world axes [m/s^2].
        base_anchors: (6, 3) base joint centres A_i, world frame [m].
        platform_anchors: (6, 3) platform joint centres b_i, platform frame [m].
        platform: mass properties of the platform.
        legs: the six legs.
        source: where the values come from.
        assumed: key path -> why, for every value that the source does not give.

    Raises:
        MechanismError: a value is out of range, or every pose is singular.
    """

    name: str
    gravity: Array
    base_anchors: Array
    platform_anchors: Array
    platform: Platform
    legs: tuple[Leg, ...]
    source: str = ""
    assumed: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_name(self.name)
        for attribute, shape, place in (
            ("gravity", (3,), "gravity"),
            ("base_anchors", (6, 3), "base.anchors"),
            ("platform_anchors", (6, 3), "platform.anchors"),
        ):
            value = frozen(getattr(self, attribute), shape, place, MechanismError)
            object.__setattr__(self, attribute, value)
        object.__setattr__(self, "legs", tuple(self.legs))
        object.__setattr__(self, "assumed", MappingProxyType(dict(self.assumed)))
        if len(self.legs) != 6:
            raise MechanismError("legs", f"{len(self.legs)} legs", "six legs")
        _check_regular_somewhere(self)

    @classmethod
    def load(cls, name_or_path: str | Path) -> Mechanism:
        """Reads a bundled mechanism by name, or a YAML file by path.

        Args:
            name_or_path: one of `bundled_mechanisms()` or the path of a file.

        Raises:
            MechanismError: there is no such file, or it does not describe a hexapod.
        """
        from sixsps.mechanism_file import load

        return load(name_or_path)

    def save(self, path: str | Path) -> None:
        """Writes the YAML file that `load` reads back to an equal mechanism.

        Raises:
            OutputError: `path` cannot be written.
        """
        from sixsps.mechanism_file import save

        save(self, Path(path))

    @cached_property
    def lower(self) -> Links:
        """The six lower links as arrays."""
        return Links.stack([leg.lower for leg in self.legs])

    @cached_property
    def upper(self) -> Links:
        """The six upper links as arrays."""
        return Links.stack([leg.upper for leg in self.legs])

    @cached_property
    def length_limits(self) -> Array:
        """(6, 2) shortest and longest leg lengths [m]."""
        limits = [leg.length_limits for leg in self.legs]
        return frozen(limits, (6, 2), "length_limits", MechanismError)

    @cached_property
    def characteristic_length(self) -> float:
        """Root mean square distance of the platform anchors from O1 [m].

        Divides the moment rows of J before its condition number is taken, so that the number does
        not depend on the unit of length.
        """
        return math.sqrt(float(np.mean(np.sum(self.platform_anchors**2, axis=1))))

    def to_mapping(self) -> dict[str, Any]:
        """Returns the content of the mechanism's YAML file."""
        xx, yy, zz = (float(self.platform.inertia[i, i]) for i in range(3))
        xy, xz, yz = (float(self.platform.inertia[i, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
        mapping: dict[str, Any] = {"name": self.name}
        if self.source:
            mapping["source"] = self.source
        if self.assumed:
            mapping["assumed"] = dict(self.assumed)
        legs = [_leg_mapping(leg) for leg in self.legs]
        return mapping | {
            "gravity": self.gravity.tolist(),
            "base": {"anchors": self.base_anchors.tolist()},
            "platform": {
                "anchors": self.platform_anchors.tolist(),
                "mass": float(self.platform.mass),
                "com": self.platform.com.tolist(),
                "inertia": {"xx": xx, "yy": yy, "zz": zz, "xy": xy, "xz": xz, "yz": yz},
            },
            "legs": legs[0] if all(leg == legs[0] for leg in legs) else legs,
        }

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the mechanism's numbers, whatever its name and the layout of its file."""
        mapping = self.to_mapping()
        numbers = {key: mapping[key] for key in ("gravity", "base", "platform", "legs")}
        text = json.dumps(numbers, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def __reduce__(self) -> tuple[type[Mechanism], tuple[Any, ...]]:
        """Pickles such that what comes back is frozen again."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Mechanism, tuple((values | {"assumed": dict(self.assumed)}).values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mechanism) and self.to_mapping() == other.to_mapping()

    def __hash__(self) -> int:
        return hash(self.sha256)


def _leg_mapping(leg: Leg) -> dict[str, Any]:
    def link(half: Link) -> dict[str, Any]:
        return {
            "mass": float(half.mass),
            "length": float(half.length),
            "com": float(half.com),
            "inertia": {"transverse": float(half.transverse), "axial": float(half.axial)},
        }

    limits = [float(limit) for limit in leg.length_limits]
    return {"lower": link(leg.lower), "upper": link(leg.upper), "length_limits": limits}


def _check_name(name: str) -> None:
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise MechanismError("name", name, "printable text")
    if len(name) > _LONGEST_NAME:
        raise MechanismError("name", name, f"at most {_LONGEST_NAME} characters")


def _check_regular_somewhere(mechanism: Mechanism) -> None:
    """Raises MechanismError when J is singular in every pose.

    det J is an analytic function of the pose: where it vanishes at a handful of generic poses it
    vanishes everywhere. Shared anchors of four legs, similar base and platform polygons and all
    anchors on one line are of this kind.
    """
    length = mechanism.characteristic_length
    if length > 0 and _best_condition(mechanism, length) < SINGULAR_CONDITION:
        return
    for place, anchors in (
        ("base.anchors", mechanism.base_anchors),
        ("platform.anchors", mechanism.platform_anchors),
    ):
        _, counts = np.unique(anchors, axis=0, return_counts=True)
        if counts.max() > 1:
            found = f"{counts.max()} anchors coincide and every pose is singular"
            raise MechanismError(place, found, "at most three coincident anchors, each leg its own pair")
    found = "with these platform anchors every pose is singular"
    raise MechanismError("base.anchors", found, "anchors not on one line, base not similar to platform")


def _best_condition(mechanism: Mechanism, length: float) -> float:
    generator = np.random.default_rng(20120531)
    size = length + float(np.ptp(mechanism.base_anchors, axis=0).max())
    position = mechanism.base_anchors.mean(axis=0) + size * generator.standard_normal((16, 3))
    rotation, _ = np.linalg.qr(generator.standard_normal((16, 3, 3)))
    rotation *= np.linalg.det(rotation)[:, None, None]
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    legs = position[:, None] + arms - mechanism.base_anchors
    lengths = np.linalg.norm(legs, axis=-1)
    directions = legs / lengths[..., None]
    jacobian = np.concatenate([directions, np.cross(arms, directions)], axis=-1)
    return float(condition_numbers(jacobian, lengths, length).min())
