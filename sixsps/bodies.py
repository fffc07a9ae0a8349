"""The bodies of a hexapod: links, legs and the platform; validated and frozen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arrays import LARGEST, Array, frozen
from sixsps.errors import MechanismError
from sixsps.missing import LOWER, UPPER, Missing

# Inertia that was turned or read from a drawing may miss symmetry, and a thin plate equality in the
# triangle inequality, by this much relative.
_ROUNDING = 1e-9
_ANY_LENGTH = (0.0, math.inf)


def _positive(value: float, place: str, unit: str) -> None:
    _number(value, place, unit)
    if not value > 0:
        raise MechanismError(place, value, f"finite and > 0 [{unit}]")


def _number(value: float, place: str, unit: str) -> None:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise MechanismError(place, value, f"a number [{unit}]")
    if not abs(float(value)) <= LARGEST:
        raise MechanismError(place, value, f"a finite number up to {LARGEST:g} [{unit}]")


def rigid_inertia(value: ArrayLike, place: str, *, point: bool = False) -> Array:
    """Returns the inertia (3, 3) of a rigid body, exactly symmetric and read-only.

    Args:
        value: (3, 3) [kg m^2].
        place: name used in the message.
        point: whether the body may be a rod or a point, of which principal moments are zero to rounding.

    Raises:
        MechanismError: it is not symmetric, a principal moment is not positive, or one is larger than the sum
            of the other two, by more than rounding.
    """
    inertia = frozen(value, (3, 3), place, MechanismError)
    if np.abs(inertia - inertia.T).max() > _ROUNDING * np.abs(inertia).max():
        raise MechanismError(place, inertia.tolist(), "a symmetric matrix")
    inertia = frozen((inertia + inertia.T) / 2, (3, 3), place, MechanismError)
    principal = np.linalg.eigvalsh(inertia)
    found = f"principal moments {principal}"
    if point and principal[0] < -_ROUNDING * np.abs(principal).max():
        raise MechanismError(place, found, "no negative principal moment [kg m^2]")
    if not point and principal[0] <= 0:
        raise MechanismError(place, found, "positive principal moments [kg m^2]")
    if principal[2] > (principal[0] + principal[1]) * (1 + _ROUNDING):
        raise MechanismError(place, found, "no principal moment larger than the sum of the other two")
    return inertia


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

    def to_mapping(self) -> dict[str, Any]:
        """Returns the content of the mechanism file's keys `lower` and `upper`."""
        return {
            "mass": self.mass,
            "length": self.length,
            "com": self.com,
            "inertia": {"transverse": self.transverse, "axial": self.axial},
        }


@dataclass(frozen=True)
class Leg:
    """A telescopic leg: lower link at the base, upper link at the platform.

    Attributes:
        lower: the cylinder, turning about A; missing in a mechanism of geometry alone.
        upper: the rod, turning about B; missing there too.
        length_limits: shortest and longest distance A to B [m], by default what the lengths of the
            links allow, without links 0 and infinity; never changes the forces of a given motion, only flags
            samples outside.

    Raises:
        MechanismError: the limits are not 0 <= shortest < longest, or one link is missing.
    """

    lower: Link = LOWER
    upper: Link = UPPER
    length_limits: tuple[float, float] = None  # type: ignore[assignment]  # a pair once constructed

    def __post_init__(self) -> None:
        if isinstance(self.lower, Missing) != isinstance(self.upper, Missing):
            missing = "lower" if isinstance(self.lower, Missing) else "upper"
            raise MechanismError(missing, "missing", "both links, or neither for geometry alone")
        given = self._default_limits() if self.length_limits is None else self.length_limits
        low, high = self._checked(given)
        if not 0 <= low < high:
            raise MechanismError("length_limits", [low, high], "0 <= shortest < longest [m]")
        object.__setattr__(self, "length_limits", (low, high))

    def _default_limits(self) -> tuple[float, float]:
        if not self.has_links:
            return _ANY_LENGTH
        return max(self.lower.length, self.upper.length), self.lower.length + self.upper.length

    def _checked(self, given: Any) -> tuple[float, float]:
        """Returns two numbers, finite ones; without links the second may be infinite."""
        pair = isinstance(given, tuple | list | np.ndarray) and len(given) == 2
        if not self.has_links and pair and isinstance(given[1], Real) and given[1] == math.inf:
            (low,) = frozen([given[0]], (1,), "length_limits", MechanismError)
            return float(low), math.inf
        low, high = frozen(given, (2,), "length_limits", MechanismError)
        return float(low), float(high)

    @property
    def has_links(self) -> bool:
        """Whether the links are given."""
        return not isinstance(self.lower, Missing)

    def to_mapping(self) -> dict[str, Any]:
        """Returns the content of the mechanism file's key `legs`, for one leg."""
        links = {"lower": self.lower.to_mapping(), "upper": self.upper.to_mapping()} if self.has_links else {}
        known = self.length_limits != _ANY_LENGTH
        return links | ({"length_limits": list(self.length_limits)} if known else {})


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
        object.__setattr__(self, "inertia", rigid_inertia(self.inertia, "platform.inertia"))

    def to_mapping(self) -> dict[str, Any]:
        """Returns the content of the mechanism file's key `platform`, without the anchors."""
        xx, yy, zz = (float(self.inertia[i, i]) for i in range(3))
        xy, xz, yz = (float(self.inertia[i, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
        inertia = {"xx": xx, "yy": yy, "zz": zz, "xy": xy, "xz": xz, "yz": yz}
        return {"mass": self.mass, "com": self.com.tolist(), "inertia": inertia}


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
