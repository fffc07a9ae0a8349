"""How far from the reference an engine may be, with the reason of every figure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNIT_ROUNDOFF = float(np.finfo(np.float64).eps) / 2

AGREEMENT = 1e-10
"""Relative difference below which two engines are said to agree: far below any sensor or model
error, far above rounding on a motion that stays away from singularities."""


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of one engine.

    Attributes:
        agreement: relative error that is allowed anywhere.
        rounding_factor: what its rounding errors may reach, in units of cond(J) times unit roundoff;
            takes over from `agreement` near singularities, where no double-precision solve is better.
        reason: why these figures.
    """

    agreement: float
    rounding_factor: float
    reason: str

    def relative(self, condition: float) -> float:
        """Returns the relative error allowed where cond(J) is at most `condition`."""
        return max(self.agreement, self.rounding_factor * condition * UNIT_ROUNDOFF)


_PER_LEG = "a few hundred roundings per leg enter J and C; the solve multiplies them by cond(J)"
_TREE = "as kane, and a 30 x 24 least-squares solve whose condition exceeds cond(J)"

TOLERANCES: dict[str, Tolerance] = {
    "kane": Tolerance(AGREEMENT, 100, _PER_LEG),
    "casadi": Tolerance(AGREEMENT, 100, _PER_LEG),
    "pinocchio": Tolerance(AGREEMENT, 300, _TREE),
    "pinocchio-ball": Tolerance(AGREEMENT, 300, _TREE),
}


def rounding_bound(engine: str, condition: float) -> float:
    """Returns the relative rounding error that `engine` may have where cond(J) <= `condition`."""
    return TOLERANCES[engine].rounding_factor * condition * UNIT_ROUNDOFF
