"""`open-loop`: the computed forces alone, for as long as rounding lets a platform follow them.

On its legs a platform is an unstable equilibrium: whatever error there is at the start grows, in any
engine. The linearisation says how fast, and how long a run means anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compare.forward.engine import ForcesAt, ForwardEngine
from compare.simulation.guard import Guard
from compare.simulation.horizon import Forecast, forecast
from compare.simulation.integration import Accuracy, integrate
from compare.simulation.linearisation import Linearisation, deviated
from compare.simulation.outcome import Outcome
from compare.simulation.plan import INTERPOLATION, Plan, Stop
from compare.simulation.refined import refined
from compare.simulation.trajectory import rotation_between, trajectory
from sixsps.arrays import Array

# Where a run has lost its motion: distance, and angle times the platform's size [m].
LOST = 1e-6
# The smallest relative tolerance that DOP853 takes: its error grows like any other.
_RTOL = 2.3e-14
# Forces this often [s], but no more of them than that, are no worse than the integrator.
_FORCE_STEP, _MOST_STEPS = 1e-3, 4000
# The deviation that growth is measured on, and how far it shall get, of the platform's size.
_LARGEST_NUDGE, _FARTHEST = 1e-7, 1e-3
_MEASURED = 41


@dataclass(frozen=True)
class Growth:
    """Growth of a small deviation, measured and by the mean eigenvalue over the same window [1/s]."""

    measured: float
    predicted: float
    window: float
    nudge: float

    def entry(self) -> dict[str, float]:
        """Returns the entry of `simulation.json`."""
        return {
            "rate_per_s": self.measured,
            "mean_eigenvalue_per_s": self.predicted,
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
    given, plan = plan, _between_samples(plan)
    linear = Linearisation.along(plan)
    accuracy = Accuracy(_RTOL, _RTOL * min(1.0, plan.mechanism.characteristic_length))
    consistent = not plan.motion.estimated
    expected = forecast(plan, linear, accuracy, LOST, consistent=consistent)
    horizon = expected.horizon(LOST)
    end = plan.motion.time[0] + horizon
    within = given if np.count_nonzero(given.motion.time <= end) > 1 else plan
    times = within.motion.time[within.motion.time <= end]
    drive = _by_time(plan)
    run = integrate(engine, engine.initial(plan.start), times, drive, Guard.of(plan), accuracy, progress)
    stopped = run.stopped or (plan.cut if end >= plan.motion.time[-1] else None)
    if len(times) < 2:
        reason = "no sample but the first lies within the horizon: nothing was simulated"
        stopped = Stop(reason, float(times[0]))
    return Outcome(
        trajectory(engine, within, run.y, drive),
        stopped=stopped,
        settings={
            "integration": None if engine.steps_itself else accuracy.settings(),
            "forces": INTERPOLATION
            + (
                f"; {len(plan.motion)} of a motion of degree 5 between those given"
                if plan is not given
                else ""
            ),
            "lost_m": LOST,
        },
        more=_figures(linear, horizon, measured_growth(engine, plan, linear, horizon)),
        notes=tuple(_notes(engine, expected, consistent=consistent, coarse=within is not given)),
    )


def _between_samples(plan: Plan) -> Plan:
    """Returns the plan with forces as often as a run needs them, unless its rates are not of its poses."""
    if plan.motion.estimated:
        return plan
    motion = refined(plan.motion, max(_FORCE_STEP, plan.duration / _MOST_STEPS))
    if motion is plan.motion:
        return plan
    fine = Plan.of(plan.mechanism, motion)
    return replace(fine, cut=fine.cut or plan.cut)


def _notes(engine: ForwardEngine, expected: Forecast, *, consistent: bool, coarse: bool) -> Iterator[str]:
    if coarse:
        yield "no sample but the first lies within the horizon: samples were put between"
    if not consistent:
        yield (
            "rates and accelerations are estimated, and the poses off them by up to "
            f"{expected.mismatch:.1e} m from one sample to the next: the run leaves its motion before the "
            "horizon, which counts the integrator's tolerance only"
        )
    if engine.steps_itself:
        yield "the horizon counts the tolerance of DOP853, not the error of the engine's own steps"


def _figures(linear: Linearisation, horizon: float, growth: Growth | None) -> dict[str, Any]:
    return {
        "growth_rate_per_s": growth.measured if growth else None,
        "eigenvalue_per_s": linear.largest_rate(linear.time[0] + horizon),
        "largest_eigenvalue_per_s": float(linear.growth_rates.max()),
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


def measured_growth(engine: ForwardEngine, plan: Plan, linear: Linearisation, window: float) -> Growth | None:
    """Returns how fast two runs part that start on either side of the plan, in its most unstable direction.

    Args:
        engine: forward dynamics of the plan's mechanism.
        plan: motion and forces.
        linear: linearisation along it.
        window: time from the start that they are watched for [s].

    Returns:
        The slope of the logarithm of their distance; None where nothing grows, or where a run
        stopped.
    """
    predicted = linear.mean_rate(plan.motion.time[0] + window) if window > 0 else 0.0
    if predicted * window < 1:
        return None
    size = plan.mechanism.characteristic_length
    direction = linear.most_unstable()
    nudge = min(_LARGEST_NUDGE, _FARTHEST * np.exp(-predicted * window)) * size
    nudge /= _extent(direction[None, :6], size)[0]
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
