"""Integration of an engine's state along a motion, step by step, up to whatever stops it.

scipy's DOP853 on the engine's own coordinates, orientation as quaternion rates; an engine that
integrates by itself takes its own steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compare.forward.engine import ForcesAt, ForwardEngine
from compare.simulation.guard import Guard
from compare.simulation.plan import Stop
from sixsps.arrays import Array
from sixsps.errors import InputError, SixspsError

# The slowest engine takes 20 ms for a step: a run is given up after 40 s that brought it next to no
# further. Its gains or forces are none that an explicit method gets through.
_TRIED_STEPS = 2000
# What those have to be long on average [s], or of the longest step, whichever is less.
_AVERAGE_STEP, _OF_LONGEST_STEP = 2.5e-4, 0.05
_DIVERGED = "the integrator gave up: the run diverged (gains too high, or the pose singular)"
# What arithmetic on a state that makes no sense any more raises, NumPy's LinAlgError among them.
_FAILURES = (SixspsError, ValueError, ArithmeticError)


@dataclass(frozen=True)
class Accuracy:
    """Tolerances of DOP853, and the longest step [s]."""

    rtol: float
    atol: float
    longest_step: float = np.inf

    @property
    def least_progress(self) -> float:
        """What the integrator has to get through in 2000 steps [s]."""
        return _TRIED_STEPS * min(_AVERAGE_STEP, _OF_LONGEST_STEP * self.longest_step)

    def settings(self) -> dict[str, Any]:
        """Returns the entry of `simulation.json`."""
        longest = self.longest_step if np.isfinite(self.longest_step) else None
        return {"method": "DOP853", "rtol": self.rtol, "atol": self.atol, "longest_step_s": longest}


@dataclass(frozen=True, eq=False)
class Run:
    """What was integrated: state vectors (k, m) at the first k times, and why there are no more."""

    y: Array
    stopped: Stop | None


def integrate(
    engine: ForwardEngine,
    y: Array,
    times: Array,
    drive: ForcesAt,
    guard: Guard,
    accuracy: Accuracy,
    progress: Callable[[int], None] = lambda _done: None,
) -> Run:
    """Integrates from `y` at the first of `times` to the last.

    Args:
        engine: what gives the rates.
        y: (m,) its state vector.
        times: (n,) strictly increasing [s].
        drive: forces and external wrench.
        guard: what stops the run.
        accuracy: of DOP853; an engine with steps of its own has its own.
        progress: called with the number of times done so far.

    Returns:
        States up to the end or the stop; an error of the engine or of the integrator is a stop.
    """
    reason = guard.trouble(engine.platform(y))
    if reason or len(times) < 2:
        return Run(y[None], Stop(reason, float(times[0])) if reason else None)
    steps = _own_steps if engine.steps_itself else _dop853
    rows = [y]
    # A run that diverges overflows on its way to the stop.
    with np.errstate(over="ignore", invalid="ignore"):
        stopped = steps(engine, rows, times, drive, guard, accuracy, progress)
        while stopped and len(rows) > 1 and not _accelerates(engine, rows[-1], times[len(rows) - 1], drive):
            rows.pop()
    return Run(np.array(rows), stopped)


def _accelerates(engine: ForwardEngine, y: Array, t: float, drive: ForcesAt) -> bool:
    """Returns whether a state on the way to a stop still has accelerations."""
    try:
        return bool(np.isfinite(engine.acceleration(y, *drive(t, y))).all())
    except _FAILURES:
        return False


def _failed(error: Exception, t: float) -> Stop:
    """Returns the stop that an error is: only an engine's own words tell anything."""
    says = isinstance(error, SixspsError) and not isinstance(error, InputError)
    return Stop(str(error) if says else _DIVERGED, float(t))


def _dop853(
    engine: ForwardEngine,
    rows: list[Array],
    times: Array,
    drive: ForcesAt,
    guard: Guard,
    accuracy: Accuracy,
    progress: Callable[[int], None],
) -> Stop | None:
    """Appends the state at each of `times`; returns what stopped it."""
    from scipy.integrate import DOP853

    error: Exception | None = None

    def rates(t: float, y: Array) -> Array:
        # What is no number shortens the step, until it is too short for the integrator: a stage of a long
        # step may lie where no state of the motion does.
        nonlocal error
        try:
            return engine.rates(y, *drive(t, y)) if np.isfinite(y).all() else np.full(len(y), np.nan)
        except _FAILURES as raised:
            error = raised
            return np.full(len(y), np.nan)

    t = times[0]
    try:
        solver = DOP853(
            rates, times[0], rows[0], times[-1],
            rtol=accuracy.rtol, atol=accuracy.atol, max_step=accuracy.longest_step,
        )  # fmt: skip
        while True:
            first = t
            for _ in range(_TRIED_STEPS):
                error = None
                message = solver.step()
                t = solver.t
                if solver.status == "failed":
                    return (
                        _failed(error, t) if error else Stop(f"the integrator gave up: {message}", float(t))
                    )
                stop = _take(solver, engine, rows, times, guard)
                progress(len(rows))
                if stop or solver.status == "finished":
                    return stop
            if t - first < accuracy.least_progress:
                reason = f"{_TRIED_STEPS} steps brought it {t - first:.3g} s further (gains too high?)"
                return Stop(f"the integrator gave up: {reason}", float(t))
    except _FAILURES as raised:
        return _failed(raised, t)


def _take(solver: Any, engine: ForwardEngine, rows: list[Array], times: Array, guard: Guard) -> Stop | None:
    """Appends the states at those of `times` that the last step passed; returns what stops it there."""
    trouble = guard.trouble(engine.platform(solver.y))
    if not trouble and times[len(rows)] > solver.t:
        return None
    inside = solver.dense_output()
    stop = (
        guard.first_trouble(solver.t_old, solver.t, lambda t: engine.platform(inside(t))) if trouble else None
    )
    end = stop.t if stop else solver.t
    while len(rows) < len(times) and times[len(rows)] <= end:
        rows.append(inside(times[len(rows)]))
    return stop


def _own_steps(
    engine: Any,
    rows: list[Array],
    times: Array,
    drive: ForcesAt,
    guard: Guard,
    _accuracy: Accuracy,
    progress: Callable[[int], None],
) -> Stop | None:
    """As `_dop853`, by the engine's own run."""
    reached, stop = float(times[0]), None

    def watch(t: float, y: Array) -> bool:
        nonlocal reached, stop
        reached = t
        reason = guard.trouble(engine.platform(y))
        if reason:
            stop = Stop(reason, t)
            return False
        if t >= times[len(rows)]:
            rows.append(y)
            progress(len(rows))
        return True

    try:
        engine.run(rows[0], times, drive, watch)
    except _FAILURES as error:
        return _failed(error, reached)
    return stop
