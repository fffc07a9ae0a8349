"""`driven`: Exudyn moves its bodies by the leg lengths alone, and its multipliers are the leg forces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from compare.simulation.guard import Guard
from compare.simulation.outcome import Outcome
from compare.simulation.plan import Plan, Stop, spline
from compare.simulation.trajectory import Trajectory

# Of the largest force: more than what its steps leave of a smooth motion.
TOLERANCE = 1e-5


def driven(engine: Any, plan: Plan, progress: Callable[[int], None]) -> Outcome:
    """Returns the motion of bodies that are driven by the planned leg lengths.

    Args:
        engine: `compare.forward.exudyn.Exudyn` of the plan's mechanism.
        plan: motion, and the forces that the multipliers are compared with.
        progress: called with the number of samples done so far.

    Raises:
        EngineError: Exudyn does not get to the second sample.
    """
    run = engine.driven(plan.motion, progress, trouble=Guard.of(plan).trouble)
    planned, forces = plan.motion[: len(run.time)], plan.forces[: len(run.time)]
    # Its integrator has positions only; its velocities are smooth enough to be differentiated.
    twist = np.hstack([run.state.velocity, run.state.angular_velocity])
    accelerations = spline(planned.time, twist).derivative()(planned.time)
    trajectory = Trajectory(planned, run.state, accelerations, run.forces, run.closure_error)
    later = planned.time > planned.time[0] + run.transient
    difference = np.abs(run.forces - forces)[later]
    largest = float(np.abs(forces).max())
    off = float(difference.max()) if later.any() else None
    notes = () if later.any() else ("no sample lies after the start-up transient",)
    return Outcome(
        trajectory,
        stopped=Stop(run.stopped, run.end) if run.stopped else plan.cut,
        settings={
            "time_step_s": run.step,
            "accelerations": "derivative of the spline through the velocities",
        },
        more={
            "max_force_difference_N": off,
            "max_relative_force_difference": None if off is None else off / largest,
            "within_tolerance": None if off is None else off <= TOLERANCE * largest,
            "force_error_estimate_N": run.error_estimate,
            "transient_s": run.transient,
        },
        notes=notes,
        inaccurate=_inaccurate(off, largest, run.error_estimate) if off is not None else "",
    )


def _inaccurate(off: float, largest: float, estimate: float) -> str:
    """Returns what is to be said of multipliers that are `off` [N]; nothing within the tolerance."""
    if off <= TOLERANCE * largest:
        return ""
    explained = "which explains it: " if estimate >= off else "which does not explain all of it: "
    return (
        f"multipliers differ by {off / largest:.2g} of the largest force, more than {TOLERANCE:g}; the "
        f"integrator's own estimate of its error is {estimate:.2g} N, {explained}the motion is too fast for "
        f"its step, or its poses are not smooth enough"
    )
