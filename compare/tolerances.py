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


_ROUNDING = (
    "backward stable solve of J F = C from rounded coordinates; differences between engines stay below "
    "6 x cond(J) x unit roundoff on 1000 random states of 200 random mechanisms, and another state may be "
    "a few times worse"
)

TOLERANCES: dict[str, Tolerance] = {
    "kane": Tolerance(AGREEMENT, 20, _ROUNDING),
    "casadi": Tolerance(AGREEMENT, 20, _ROUNDING),
    "pinocchio": Tolerance(AGREEMENT, 20, _ROUNDING),
    "pinocchio-ball": Tolerance(AGREEMENT, 20, _ROUNDING),
}


def rounding_bound(engine: str, error_growth: float) -> float:
    """Returns the relative rounding error that `engine` may have at this `error_growth`."""
    return TOLERANCES[engine].rounding_factor * error_growth * UNIT_ROUNDOFF
