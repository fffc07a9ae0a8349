"""How far from the reference an engine may be, with the reason of every figure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array

UNIT_ROUNDOFF = float(np.finfo(np.float64).eps) / 2


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of one engine.

    Attributes:
        rounding_factor: what its errors may reach, relative, in units of unit roundoff times
            `LegKinematics.error_growth`, the bound that cond(J) sets to any double-precision solve.
        reason: why this figure.
    """

    rounding_factor: float
    reason: str

    def relative(self, error_growth: Array) -> Array:
        """Returns the (n,) relative errors allowed at samples with these `error_growth`."""
        return self.rounding_factor * error_growth * UNIT_ROUNDOFF

    def rounding(self, error_growth: float) -> float:
        """Returns the relative error allowed at this `error_growth`."""
        return self.rounding_factor * error_growth * UNIT_ROUNDOFF


_ROOM = 100


def _rounding(seen: float, how: str) -> Tolerance:
    """Returns the tolerance of an engine whose rounding errors were seen to reach `seen`.

    Args:
        seen: largest true error, against certified forces, in units of error growth times unit
            roundoff, on 1000 states of 200 random mechanisms and on the bundled ones along line,
            sinusoids and the recorded motion.
        how: what the rounding errors come from.
    """
    room = "100 leaves room for rarer states, lopsided masses and loads that nearly cancel"
    return Tolerance(_ROOM, f"{how}; at most {seen:g} was seen on random and bundled mechanisms, {room}")


_SOLVE = "one backward stable solve of J F = C from rounded coordinates"
_TREE = "leg motion from 3 or 4 equations a leg, then one least-squares solve of the tree"

TOLERANCES: dict[str, Tolerance] = {
    "kane": _rounding(3.1, _SOLVE),
    "casadi": _rounding(2.0, _SOLVE),
    "fast": _rounding(2.6, _SOLVE),
    "lagrange": _rounding(2.8, _SOLVE),
    "newton-euler": _rounding(3.1, _SOLVE),
    "virtual-work": _rounding(3.5, _SOLVE),
    "pinocchio": _rounding(3.1, _TREE),
    "pinocchio-ball": _rounding(2.8, _TREE),
    "mujoco": _rounding(2.8, _TREE),
    "drake": _rounding(2.8, _TREE),
    "dart": _rounding(2.3, _TREE),
    "exudyn": _rounding(1.6, "one refined least-squares solve for 85 multipliers"),
    "opensim": _rounding(1.0, _TREE + ", refined once"),
    "sympy": _rounding(3.1, _SOLVE),
    "pinocchio-payload": _rounding(1.4, _TREE + ", the rounding of the robot's own wrench among it"),
}
DEFAULT = Tolerance(_ROOM, "no row of its own")


UPS = 1e-6
"""Relative error of an engine whose legs stand on universal joints, against legs that do not spin:
another mechanism. The joint turns a leg about its own axis, and the moment that its axial inertia needs
for that bends it: 3e-9 to 8e-7 of the largest force on the bundled mechanisms. Where it is more,
twice what the closed form of `sixsps.universal_joints` says is allowed; and without the forces of
the closed form an engine is held to its row of the table."""


def tolerance_of(engine: str) -> Tolerance:
    """Returns the tolerance of an engine, or for one without a row what rounding allows."""
    return TOLERANCES.get(engine, DEFAULT)


def rounding_reason(engine: str) -> str:
    """Returns in words what `Tolerance.rounding` of an engine is."""
    tolerance = tolerance_of(engine)
    factor = f"{tolerance.rounding_factor:g} x cond(J) x (1 + coordinates / leg length) x unit roundoff"
    return f"{factor}: {tolerance.reason}"
