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
from sixsps.errors import SixspsError

# A run that needs more has gains or forces that no explicit method gets through.
_MOST_STEPS = 100_000
# Samples that an engine with steps of its own does between two looks at the bounds.
_BLOCK = 50


@dataclass(frozen=True)
class Accuracy:
    """Tolerances of DOP853, and the longest step [s]."""

    rtol: float
    atol: float
    longest_step: float = np.inf

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
    if len(times) < 2:
        return Run(y[None], None)
    steps = _own_steps if engine.steps_itself else _dop853
    rows = [y]
    stopped = steps(engine, rows, times, drive, guard, accuracy, progress)
    return Run(np.array(rows), stopped)


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

    def rates(t: float, y: Array) -> Array:
        # What is no number shortens the step, until it is too short for the integrator.
        return engine.rates(y, *drive(t, y)) if np.isfinite(y).all() else np.full(len(y), np.nan)

    t = times[0]
    try:
        # A run that diverges overflows on its way to the stop.
        with np.errstate(over="ignore", invalid="ignore"):
            solver = DOP853(
                rates, times[0], rows[0], times[-1],
                rtol=accuracy.rtol, atol=accuracy.atol, max_step=accuracy.longest_step,
            )  # fmt: skip
            for _ in range(_MOST_STEPS):
                message = solver.step()
                t = solver.t
                if solver.status == "failed":
                    return Stop(f"the integrator gave up: {message}", float(t))
                stop = _take(solver, engine, rows, times, guard)
                progress(len(rows))
                if stop or solver.status == "finished":
                    return stop
    except SixspsError as error:
        return Stop(str(error), float(t))
    return Stop(f"the integrator gave up: {_MOST_STEPS} steps were not enough", float(t))


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
    """As `_dop853`, in blocks of the engine's own run."""
    for first in range(0, len(times) - 1, _BLOCK):
        block = times[first : first + _BLOCK + 1]
        try:
            states = engine.run(rows[-1], block, drive)
        except SixspsError as error:
            return Stop(str(error), float(block[0]))
        for t, y in zip(block[1:], states[1:], strict=True):
            reason = guard.trouble(engine.platform(y))
            if reason:
                return Stop(reason, float(t))
            rows.append(y)
        progress(len(rows))
    return None
