"""The mechanisms that paths start from, one of every class, with all their complex poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixsps.assembly.patterns import Labels, Pattern, relabelling

Complex = NDArray[np.complex128]

FILE = "start_systems.npz"
MOST = 40
"""The largest number of isolated poses that any hexapod has, complex ones counted: the degree of the
variety of rigid displacements in the space in which every leg is a linear equation (Ronga & Vust 1995;
Lazard 1993; Gallet, Nawratil & Schicho, "Bond theory for pentapods and hexapods", 2015)."""

_GENERAL = (0, 1, 2, 3, 4, 5)
_CONJUGATED = np.array([1, -1, -1, -1, 1, -1, -1, -1])


@dataclass(frozen=True, eq=False)
class StartSystem:
    """A generic complex mechanism and all its poses.

    Attributes:
        pattern: of its class.
        legs: (6, 7) d, m and l^2 of the legs.
        solutions: (n, 8) coordinates (e, G), of length one.
    """

    pattern: Pattern
    legs: Complex
    solutions: Complex


def legs_from(base: Any, platform: Any, squares: Any) -> Complex:
    """Returns the legs (6, 7) with anchors (6, 3) and squared lengths (6,)."""
    columns = [base - platform, base + platform, np.asarray(squares)[:, None]]
    return np.concatenate(columns, axis=1).astype(np.complex128)


@cache
def start_systems() -> dict[Pattern, StartSystem]:
    """Returns the start system of every class that has regular poses, as shipped."""
    with (files("sixsps") / "assembly" / FILE).open("rb") as stream, np.load(stream) as arrays:
        patterns, legs, counts, solutions = (
            arrays[name] for name in ("patterns", "legs", "counts", "solutions")
        )
    parts = np.split(solutions, np.cumsum(counts)[:-1])
    found = {}
    for labels, rows, points in zip(patterns.tolist(), legs, parts, strict=True):
        pattern = Pattern(tuple(labels[0]), tuple(labels[1]))
        found[pattern] = StartSystem(pattern, rows, points)
    return found


@lru_cache(maxsize=256)
def start_system(base: Labels, platform: Labels) -> StartSystem:
    """Returns the start system for legs with these anchors, in their own order and roles.

    Legs of a class whose poses are all singular start from the general one.

    Args:
        base: numbers of the legs' base anchors.
        platform: numbers of their platform anchors.
    """
    shipped = start_systems()
    change = relabelling(base, platform)
    if change.pattern not in shipped:
        return shipped[Pattern(_GENERAL, _GENERAL)]
    one = shipped[change.pattern]
    legs = np.empty_like(one.legs)
    legs[list(change.order)] = one.legs
    if not change.exchanged:
        return StartSystem(one.pattern, legs, one.solutions)
    # the inverse poses
    legs[:, :3] *= -1
    return StartSystem(one.pattern, legs, one.solutions * _CONJUGATED)
