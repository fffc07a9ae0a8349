"""Leg forces as functions of time with few knots, for other programs, with a stated error.

What the error covers depends on what is known of the motion:

- A motion that can be sampled anywhere, like the bundled ones, is sampled finely, at least eight times
  between neighbouring knots. The error is the largest over all these times, and a tenth of the bound
  is kept in hand for the times between them, so the bound holds all along the motion.
- Of a motion that is given by samples, nothing is known between them. Knots are some of the samples
  and the error is the largest over all of them; between samples the curve is an interpolation of
  the forces at the samples, and no bound is stated.

Knots are either evenly spaced or put where they are needed, by halving steps; what takes fewer is used.
Akima's method loses an order of convergence where steps change, so it mostly is the former.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator, PPoly, make_interp_spline

from sixsps.arrays import Array
from sixsps.errors import InputError, MotionError
from sixsps.formulations import inverse_dynamics
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

TOLERANCES = (1e-12, 0.1)
"""Smallest and largest interpolation error that can be asked for, relative to the largest force."""

# Numbers of steps with so many divisors that evenly spaced knots can be had in any density.
_STEPS = (5040, 55440, 332640)
_STEPS_PER_PIECE = 8
_SHARE_OF_BOUND = 0.9
_FIRST_PIECES = 8
_EXTRA_ROUNDS = 4

_Indices = NDArray[np.intp]


class Interpolation(StrEnum):
    """How a program gets from knots to the force at any time.

    akima is the method of Akima (1970), a piecewise cubic, which ADAMS calls AKISPL; quintic is the
    spline with four continuous derivatives and not-a-knot ends; linear is a table.
    """

    linear = "linear"
    akima = "akima"
    quintic = "quintic"


_FEWEST_PIECES = {Interpolation.linear: 1, Interpolation.akima: 3, Interpolation.quintic: 5}
_DEGREE = 5


@dataclass(frozen=True, eq=False)
class DrivingFunctions:
    """The six leg forces of a mechanism as functions of time.

    Attributes:
        mechanism: its name.
        motion: its name.
        interpolation: how the curve goes through the knots.
        time: (m,) knots [s].
        forces: (m, 6) at the knots [N], positive in extension.
        breaks: (p + 1,) ends of the polynomial pieces [s]; not all knots are breaks of a quintic.
        coefficients: (order, p, 6) of powers of the time since the break before, highest power first.
        tolerance: what was allowed, relative to `largest_force`.
        largest_force: over all times that were checked and all legs [N].
        error: largest difference from the forces over all times that were checked and all legs [N].
        checked: number of these times.
        everywhere: whether the bound holds all along the motion, or at the motion's samples only.
    """

    mechanism: str
    motion: str
    interpolation: Interpolation
    time: Array
    forces: Array
    breaks: Array
    coefficients: Array
    tolerance: float
    largest_force: float
    error: float
    checked: int
    everywhere: bool

    @property
    def bound(self) -> float:
        """What the error stays below [N]."""
        return self.tolerance * self.largest_force

    def __call__(self, time: Array) -> Array:
        """Returns (n, 6) leg forces [N] at n times [s]; NaN beyond the ends of the motion."""
        curve = PPoly.construct_fast(self.coefficients, self.breaks, extrapolate=False)
        return np.asarray(curve(time))


def driving_functions(
    mechanism: Mechanism,
    motion: Motion | Callable[[int], Motion],
    interpolation: Interpolation,
    tolerance: float = 1e-6,
) -> DrivingFunctions:
    """Returns the leg forces along a motion with as few knots as the tolerance allows.

    Args:
        mechanism: geometry and inertia.
        motion: samples; or a function that samples the motion n times evenly from start to end.
        interpolation: quintic only where the motion can be sampled anywhere: through the noise of
            recorded samples it would swing.
        tolerance: interpolation error allowed, relative to the largest force.

    Raises:
        MotionError: a pose is singular, or there are too few samples.
        InputError: the tolerance is out of range or cannot be kept, or the motion is not known between
            the knots of a quintic.
    """
    if not TOLERANCES[0] <= tolerance <= TOLERANCES[1]:
        raise InputError("tolerance", tolerance, f"{TOLERANCES[0]:g} to {TOLERANCES[1]:g}")
    if isinstance(motion, Motion):
        if interpolation is Interpolation.quintic:
            raise InputError("interpolation", "quintic", "linear or akima for a motion given by samples")
        grid = _Grid.along(mechanism, motion, interpolation, tolerance, everywhere=False)
        return grid.functions(mechanism, motion, grid.fewest_knots())
    for steps in _STEPS:
        sampled = motion(steps + 1)
        grid = _Grid.along(mechanism, sampled, interpolation, tolerance, everywhere=True)
        if len(knots := grid.fewest_knots()):
            return grid.functions(mechanism, sampled, knots)
    reached = tolerance * grid.error(grid.even(grid.most_pieces)) / grid.allowed
    allowed = f"at least {float(f'{1.1 * reached:.1g}'):g} with {interpolation} interpolation"
    raise InputError("tolerance", tolerance, allowed)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Times at which the forces are known, from which knots are chosen and at which they are checked."""

    time: Array
    forces: Array
    interpolation: Interpolation
    tolerance: float
    everywhere: bool

    @classmethod
    def along(
        cls,
        mechanism: Mechanism,
        motion: Motion,
        interpolation: Interpolation,
        tolerance: float,
        *,
        everywhere: bool,
    ) -> _Grid:
        fewest = _FEWEST_PIECES[interpolation] + 1
        if len(motion) < fewest:
            allowed = f"at least {fewest} samples for {interpolation} interpolation"
            raise MotionError("samples", len(motion), allowed)
        forces = _forces(mechanism, motion)
        return cls(motion.time, forces, interpolation, tolerance, everywhere)

    @cached_property
    def largest_force(self) -> float:
        return float(np.abs(self.forces).max())

    @cached_property
    def allowed(self) -> float:
        """Largest error that may be found at the times of the grid."""
        share = _SHARE_OF_BOUND if self.everywhere else 1.0
        return share * self.tolerance * self.largest_force

    @property
    def spacing(self) -> int:
        """Fewest steps between neighbouring knots."""
        return _STEPS_PER_PIECE if self.everywhere else 1

    @property
    def most_pieces(self) -> int:
        return (len(self.time) - 1) // self.spacing

    def even(self, pieces: int) -> _Indices:
        """Returns evenly spaced knots; exactly so where `pieces` divides the number of steps."""
        return np.round(np.linspace(0, len(self.time) - 1, pieces + 1)).astype(np.intp)

    def errors(self, knots: _Indices) -> Array:
        """Returns (n,) the largest error of a leg at every time."""
        curve = _curve(self.interpolation, self.time[knots], self.forces[knots])
        return np.asarray(np.abs(curve(self.time) - self.forces).max(axis=1))

    def error(self, knots: _Indices) -> float:
        return float(self.errors(knots).max())

    def fewest_knots(self) -> _Indices:
        """Returns the indices of the knots; none where steps would have to be too short."""
        even = self._fewest_even()
        refined = self._refined(len(even) or len(self.time))
        return refined if len(refined) else even

    def _fewest_even(self) -> _Indices:
        steps = len(self.time) - 1
        counts = [
            count
            for count in range(_FEWEST_PIECES[self.interpolation], self.most_pieces + 1)
            if not self.everywhere or steps % count == 0
        ]
        place = bisect_left(counts, True, key=lambda count: self.error(self.even(count)) <= self.allowed)
        return self.even(counts[place]) if place < len(counts) else np.empty(0, dtype=np.intp)

    def _refined(self, limit: int) -> _Indices:
        """Returns fewer than `limit` knots where they are needed, or none."""
        knots = self.even(min(_FIRST_PIECES, self.most_pieces))
        # Where halving a step moves the error to the next, as Akima's method may, it would go on and on.
        for _ in range(len(self.time).bit_length() + _EXTRA_ROUNDS):
            if len(knots) >= limit:
                break
            worst = np.maximum.reduceat(self.errors(knots), knots[:-1])
            halved = worst > self.allowed
            if not halved.any():
                return knots
            if np.diff(knots)[halved].min() < 2 * self.spacing:
                break
            knots = np.union1d(knots, (knots[:-1][halved] + knots[1:][halved]) // 2)
        return np.empty(0, dtype=np.intp)

    def functions(self, mechanism: Mechanism, motion: Motion, knots: _Indices) -> DrivingFunctions:
        curve = _curve(self.interpolation, self.time[knots], self.forces[knots])
        return DrivingFunctions(
            mechanism=mechanism.name,
            motion=motion.name,
            interpolation=self.interpolation,
            time=self.time[knots],
            forces=self.forces[knots],
            breaks=np.asarray(curve.x),
            coefficients=np.asarray(curve.c),
            tolerance=self.tolerance,
            largest_force=self.largest_force,
            error=self.error(knots),
            checked=len(self.time),
            everywhere=self.everywhere,
        )


def _forces(mechanism: Mechanism, motion: Motion) -> Array:
    forces = inverse_dynamics(mechanism, motion)
    singular = ~np.isfinite(forces).all(axis=1)
    if singular.any():
        index = int(np.argmax(singular))
        condition = inverse_kinematics(mechanism, motion[index : index + 1]).condition[0]
        place = f"sample {index + 1} at t = {motion.time[index]:g} s"
        raise MotionError(place, f"cond(J) = {condition:.3g}", "a pose that is not singular")
    sides = np.linalg.slogdet(inverse_kinematics(mechanism, motion).jacobian)[0]
    across = np.flatnonzero(sides[1:] != sides[:-1])
    if len(across):
        first, last = motion.time[across[0]], motion.time[across[0] + 1]
        place = f"between t = {first:g} s and {last:g} s"
        raise MotionError(place, "a singular pose, where forces have no bound", "poses that are not singular")
    return forces


def _curve(interpolation: Interpolation, time: Array, forces: Array) -> PPoly:
    if interpolation is Interpolation.akima:
        return Akima1DInterpolator(time, forces, method="akima")
    if interpolation is Interpolation.linear:
        slopes = np.diff(forces, axis=0) / np.diff(time)[:, None]
        return PPoly(np.stack([slopes, forces[:-1]]), time)
    spline = make_interp_spline(time, forces, _DEGREE)
    breaks = spline.t[_DEGREE:-_DEGREE]
    powers = range(_DEGREE, -1, -1)
    taylor = [spline(breaks[:-1], nu=power) / math.factorial(power) for power in powers]
    return PPoly(np.stack(taylor), breaks)
