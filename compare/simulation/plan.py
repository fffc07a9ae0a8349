"""What a simulation is to reproduce: a planned motion, its leg forces, and both between the samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from compare.simulation.legs import leg_states
from sixsps.arrays import Array
from sixsps.dynamics import State
from sixsps.errors import EngineError
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

INTERPOLATION = "interpolating spline of degree 5 through the samples of the motion"


@dataclass(frozen=True)
class Stop:
    """Why and when [s] something ended before its time."""

    reason: str
    t: float


class Planned(NamedTuple):
    """What is planned at a time; arrays may have a time axis in front.

    Attributes:
        forces: (6,) leg forces [N].
        force: (3,) external force on the platform's centre of mass [N].
        moment: (3,) external moment [N m].
        lengths: (6,) of the legs [m].
        rates: (6,) of the lengths [m/s].
    """

    forces: Array
    force: Array
    moment: Array
    lengths: Array
    rates: Array


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned motion as far as there are leg forces for it, n samples.

    Attributes:
        mechanism: what moves.
        motion: n samples, all regular.
        forces: (n, 6) leg forces of the inverse dynamics [N].
        cut: why the motion that was given goes on without forces; None where it does not.
    """

    mechanism: Mechanism
    motion: Motion
    forces: Array
    cut: Stop | None = None

    @classmethod
    def of(cls, mechanism: Mechanism, motion: Motion) -> Plan:
        """Returns the plan up to the first singular pose, at a sample or between two.

        Raises:
            EngineError: that comes before the third sample, and there is nothing to simulate.
        """
        forces = inverse_dynamics(mechanism, motion)
        regular = np.isfinite(forces).all(axis=1)
        first = len(motion) if regular.all() else int(np.argmin(regular))
        cut = None
        if first < len(motion):
            cut = Stop("the planned pose is singular: no leg forces hold it", float(motion.time[first]))
        crossed = _crossing(mechanism, motion[:first])
        if crossed:
            first, t = crossed
            cut = Stop("the planned pose becomes singular between two samples", t)
        if cut and first < 2:
            raise EngineError(f"{cut.reason}, at t = {cut.t:g} s already")
        return cls(mechanism, motion[:first], forces[:first], cut)

    @cached_property
    def states(self) -> State:
        """The n planned states."""
        return State.of(self.motion)

    @cached_property
    def start(self) -> State:
        """The first planned state, n = 1."""
        return State.of(self.motion[:1])

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return float(self.motion.time[-1] - self.motion.time[0])

    @cached_property
    def _spline(self) -> Any:
        legs = leg_states(self.mechanism, self.states)
        wrench = [self.motion.force, self.motion.moment]
        return spline(self.motion.time, np.hstack([self.forces, *wrench, legs.lengths, legs.rates]))

    def at(self, t: float | Array) -> Planned:
        """Returns what is planned at one time or several [s]."""
        values = self._spline(t)
        ends = ((0, 6), (6, 9), (9, 12), (12, 18), (18, 24))
        return Planned(*(values[..., first:end] for first, end in ends))


def _crossing(mechanism: Mechanism, motion: Motion) -> tuple[int, float] | None:
    """Returns the first sample beyond a singularity and when det J is zero before it [s]; None without.

    Args:
        mechanism: geometry.
        motion: n regular samples.
    """
    determinants = np.linalg.det(leg_states(mechanism, State.of(motion)).jacobian)
    changes = np.flatnonzero(np.sign(determinants[1:]) != np.sign(determinants[:-1]))
    if not changes.size:
        return None
    before = int(changes[0])
    (start, end), (d, d_end) = motion.time[before : before + 2], determinants[before : before + 2]
    return before + 1, float(start + (end - start) * d / (d - d_end))


def spline(time: Array, values: Array, degree: int = 5) -> Any:
    """Returns the spline through all values; of a lower odd degree where they are too few."""
    from scipy.interpolate import make_interp_spline

    most = len(time) - 1
    return make_interp_spline(time, values, k=min(degree, most - 1 + most % 2))
