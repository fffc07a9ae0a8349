"""`open-loop`: the computed forces alone, for as long as rounding lets a platform follow them.

On its legs a platform is an unstable equilibrium: whatever error there is at the start grows, in any
engine. The linearisation says how fast, and how long a run means anything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compare.forward.engine import ForcesAt, ForwardEngine
from compare.simulation.guard import Guard
from compare.simulation.integration import Accuracy, integrate
from compare.simulation.linearisation import Linearisation, deviated
from compare.simulation.outcome import Outcome
from compare.simulation.plan import INTERPOLATION, Plan
from compare.simulation.trajectory import rotation_between, trajectory
from sixsps.arrays import Array

# Relative to the largest coordinate: the error that no run can be without.
ROUNDING = 1e-16
# Where a run has lost its motion [m].
LOST = 1e-6
# The smallest relative tolerance that DOP853 takes: its error grows like any other.
_RTOL = 2.3e-14
# The deviation that growth is measured on, of the platform's size, and by how much it shall grow.
_NUDGE, _GROWTH = 1e-7, 1e3
_MEASURED = 41


@dataclass(frozen=True)
class Growth:
    """Growth of a small deviation, measured and by the eigenvalues, over the same window [1/s]."""

    measured: float
    predicted: float
    window: float
    nudge: float

    def entry(self) -> dict[str, float]:
        """Returns the entry of `simulation.json`."""
        return {
            "rate_per_s": self.measured,
            "eigenvalue_per_s": self.predicted,
            "window_s": self.window,
            "first_deviation_m": self.nudge,
        }


def open_loop(engine: ForwardEngine, plan: Plan, progress: Callable[[int], None]) -> Outcome:
    """Returns the motion that the computed leg forces alone cause.

    Args:
        engine: forward dynamics of the plan's mechanism.
        plan: motion and forces.
        progress: called with the number of samples done so far.
    """
    linear = Linearisation.along(plan)
    size = max(float(np.abs(plan.start.position).max()), plan.mechanism.characteristic_length)
    horizon = min(linear.time_to_grow(max(LOST / (ROUNDING * size), 1.0)), plan.duration)
    end = plan.motion.time[0] + horizon
    times = plan.motion.time[plan.motion.time <= end]
    accuracy = Accuracy(_RTOL, _RTOL * min(1.0, plan.mechanism.characteristic_length))
    drive = _by_time(plan)
    run = integrate(engine, engine.initial(plan.start), times, drive, Guard.of(plan), accuracy, progress)
    growth = measured_growth(engine, plan, linear)
    stopped = run.stopped or (plan.cut if end >= plan.motion.time[-1] else None)
    few = (
        ("no sample but the first lies within the horizon: nothing was simulated",) if len(times) < 2 else ()
    )
    return Outcome(
        trajectory(engine, plan, run.y, drive),
        stopped=stopped,
        settings={
            "integration": None if engine.steps_itself else accuracy.settings(),
            "forces": INTERPOLATION,
            "rounding_rel": ROUNDING,
            "lost_m": LOST,
        },
        more=_figures(linear, horizon, growth),
        notes=few,
    )


def _figures(linear: Linearisation, horizon: float, growth: Growth | None) -> dict[str, Any]:
    return {
        "growth_rate_per_s": float(linear.growth_rates.max()),
        "horizon_s": horizon,
        "measured_growth": growth.entry() if growth else None,
        "linearisation": [
            {
                "t": float(t),
                "growth_rate_per_s": float(values[0].real),
                "eigenvalues_per_s": [[float(value.real), float(value.imag)] for value in values],
            }
            for t, values in zip(linear.time, linear.eigenvalues, strict=True)
        ],
    }


def measured_growth(engine: ForwardEngine, plan: Plan, linear: Linearisation) -> Growth | None:
    """Returns how fast two runs part that start on either side of the plan, in its most unstable direction.

    Returns:
        The slope of the logarithm of their distance; None where nothing grows, or where a run
        stopped.
    """
    window = min(linear.time_to_grow(_GROWTH), plan.duration)
    predicted = linear.mean_rate(plan.motion.time[0] + window)
    if predicted * window < 1:
        return None
    size = plan.mechanism.characteristic_length
    direction = linear.most_unstable()
    nudge = _NUDGE * size / _extent(direction[None, :6], size)[0]
    times = plan.motion.time[0] + np.linspace(0, window, _MEASURED)
    accuracy = Accuracy(1e-13, 1e-13 * min(1.0, size))
    ends = []
    for side in (nudge, -nudge):
        y = engine.initial(deviated(plan.start, side * direction[None]))
        run = integrate(engine, y, times, _by_time(plan), Guard.of(plan), accuracy)
        if run.stopped:
            return None
        states = [engine.platform(row) for row in run.y]
        ends.append(
            tuple(np.concatenate([getattr(s, name) for s in states]) for name in ("position", "quaternion"))
        )
    (p, q), (p_other, q_other) = ends
    apart = _extent(np.hstack([p - p_other, rotation_between(q_other, q)]), size)
    slope = np.polyfit(times - times[0], np.log(apart), 1)[0]
    return Growth(float(slope), predicted, window, float(apart[0]) / 2)


def _extent(deviations: Array, size: float) -> Array:
    """Returns the length (n,) of deviations (n, 6) of the pose, angles times a size [m]."""
    return np.linalg.norm(deviations * np.repeat([1.0, size], 3), axis=1)


def _by_time(plan: Plan) -> ForcesAt:
    def drive(t: float, _y: Array) -> tuple[Array, Array, Array]:
        planned = plan.at(t)
        return planned.forces, planned.force, planned.moment

    return drive
