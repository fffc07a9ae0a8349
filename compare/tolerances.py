"""How far from the reference an engine may be, with the reason of every figure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array

UNIT_ROUNDOFF = float(np.finfo(np.float64).eps) / 2

AGREEMENT = 1e-10
"""Relative difference below which two engines are said to agree: far below any sensor or model
error, far above rounding on a motion that stays away from singularities."""


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of one engine.

    Attributes:
        agreement: relative error that is allowed anywhere.
        rounding_factor: what its rounding errors may reach, in units of unit roundoff times
            `LegKinematics.error_growth`; takes over from `agreement` near singularities, where no
            double-precision solve is better.
        reason: why these figures.
    """

    agreement: float
    rounding_factor: float
    reason: str

    def relative(self, error_growth: Array) -> Array:
        """Returns the (n,) relative errors allowed at samples with these `error_growth`."""
        return np.maximum(self.agreement, self.rounding_factor * error_growth * UNIT_ROUNDOFF)

    def rounding(self, error_growth: float) -> float:
        """Returns the relative rounding error that is allowed at this `error_growth`."""
        return self.rounding_factor * error_growth * UNIT_ROUNDOFF


_ROUNDING = (
    "backward stable solve of J F = C from rounded coordinates; differences between engines stay below "
    "6 x cond(J) x unit roundoff on 1000 random states of 200 random mechanisms, and another state may be "
    "a few times worse"
)

DEFAULT = Tolerance(AGREEMENT, 20, _ROUNDING)

TOLERANCES: dict[str, Tolerance] = {
    "kane": Tolerance(AGREEMENT, 20, _ROUNDING),
    "casadi": Tolerance(AGREEMENT, 20, _ROUNDING),
    "lagrange": Tolerance(AGREEMENT, 20, _ROUNDING),
    "newton-euler": Tolerance(AGREEMENT, 20, _ROUNDING),
    "virtual-work": Tolerance(AGREEMENT, 20, _ROUNDING),
    "pinocchio": Tolerance(AGREEMENT, 20, _ROUNDING),
    "pinocchio-ball": Tolerance(AGREEMENT, 20, _ROUNDING),
    "mujoco": Tolerance(AGREEMENT, 20, _ROUNDING),
    "drake": Tolerance(AGREEMENT, 20, _ROUNDING),
    "dart": Tolerance(AGREEMENT, 20, _ROUNDING),
    "exudyn": Tolerance(AGREEMENT, 20, _ROUNDING),
    "opensim": Tolerance(AGREEMENT, 20, _ROUNDING),
    "sympy": Tolerance(AGREEMENT, 20, _ROUNDING),
}


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
