"""How far a motion of the tree tears the loops: velocities and accelerations of tips less those of anchors.

Closed forms of the legs' geometry; Jc v and Jc a + Jc' v are the same in Pinocchio's Jacobians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import MotionError
from sixsps.rotation import cross

# As far as loops may gape in q, relative to what moves: an integrator leaves less, and forces are wrong by no
# more than this times the condition number. Twists in other axes and accelerations of another kind are off
# by far more, unless the platform hardly turns, where they are the same.
GAP = 1e-6


@dataclass(frozen=True, eq=False)
class ClosureRates:
    """Of the six loops.

    Attributes:
        gaps: (6, 3) of the tips less those of the anchors, world axes [m/s] or [m/s^2].
        sizes: (6,) the largest terms in them, which say how large a gap is.
    """

    gaps: Array
    sizes: Array

    def check(self, name: str, unit: str, maker: str) -> None:
        """Raises MotionError where a loop gapes at more than `GAP` of what moves.

        Args:
            name: argument that says so, for the error.
            unit: of the gaps.
            maker: function that makes it closed.
        """
        gaps = np.linalg.norm(self.gaps, axis=1)
        excess = gaps - GAP * self.sizes
        leg = int(np.argmax(excess))
        if not excess[leg] <= 0:
            found = f"tears the loop of leg {leg + 1} at {gaps[leg]:.3g} {unit}"
            allowed = f"at most {GAP * self.sizes[leg]:.3g} {unit}, {GAP:g} of what moves; see `{maker}`"
            raise MotionError(name, found, allowed)


@dataclass(frozen=True, eq=False)
class Ends:
    """Where the ends of the loops are, world axes.

    Attributes:
        rotation: (3, 3) of the platform.
        arms: (6, 3) O1 to platform joints [m].
        axes: (6, 3, 3) of the legs, in columns, z along the leg.
        lengths: (6,) [m].
    """

    rotation: Array
    arms: Array
    axes: Array
    lengths: Array

    def velocities(self, v: Array) -> ClosureRates:
        """Returns the rates at which v (30,) tears the loops [m/s]."""
        (velocity, omega), (turning, rates) = self._platform(v), self._legs(v)
        s, l = self.axes[:, :, 2], self.lengths[:, None]  # noqa: E741
        terms = [rates * s, l * cross(turning, s)], [np.tile(velocity, (6, 1)), cross(omega, self.arms)]
        return _rates(*terms)

    def accelerations(self, v: Array, a: Array) -> ClosureRates:
        """Returns the accelerations at which v (30,) and a (30,) tear the loops [m/s^2]."""
        (velocity, omega), (turning, rates) = self._platform(v), self._legs(v)
        (spatial, epsilon), (alpha, growing) = self._platform(a), self._legs(a)
        s, l = self.axes[:, :, 2], self.lengths[:, None]  # noqa: E741
        across = cross(turning, s)
        tip = [growing * s, 2 * rates * across, l * cross(alpha, s), l * cross(turning, across)]
        linear = np.tile([spatial, cross(omega, velocity)], (6, 1, 1)).swapaxes(0, 1)
        turned = cross(omega, self.arms)
        return _rates(tip, [*linear, cross(epsilon, self.arms), cross(omega, turned)])

    def _platform(self, rates: Array) -> tuple[Array, Array]:
        return self.rotation @ rates[:3], self.rotation @ rates[3:6]

    def _legs(self, rates: Array) -> tuple[Array, Array]:
        """Returns (6, 3) of the balls, world axes, and (6, 1) of the actuators."""
        legs = rates[6:].reshape(6, 4)
        return np.einsum("kij,kj->ki", self.axes, legs[:, :3]), legs[:, 3:]


def _rates(tip: list[Array], anchor: list[Array]) -> ClosureRates:
    terms = np.array([*tip, *(-term for term in anchor)])
    return ClosureRates(terms.sum(axis=0), np.linalg.norm(terms, axis=2).max(axis=0))
