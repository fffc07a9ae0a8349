"""`recover`: the computed forces put into forward dynamics at every sample give the accelerations back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from compare.forward.engine import ForwardEngine
from compare.simulation.outcome import Outcome
from compare.simulation.plan import Stop
from compare.simulation.trajectory import Trajectory
from sixsps.dynamics import State
from sixsps.errors import EngineError
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


def recover(
    engine: ForwardEngine, mechanism: Mechanism, motion: Motion, progress: Callable[[int], None]
) -> Outcome:
    """Returns the accelerations that an engine makes of the computed leg forces.

    Args:
        engine: forward dynamics of `mechanism`.
        mechanism: geometry and inertia.
        motion: n samples; singular ones have no forces and are left out.
        progress: called with the number of samples done so far.

    Raises:
        EngineError: every sample is singular, or the engine fails.
    """
    forces = inverse_dynamics(mechanism, motion)
    regular = np.asarray(np.isfinite(forces).all(axis=1))
    if not regular.any():
        raise EngineError("every planned pose is singular: there are no leg forces to recover from")
    given, forces = motion[regular], forces[regular]
    accelerations, gaps = np.empty((len(given), 6)), np.empty(len(given))
    for k in range(len(given)):
        y = engine.initial(State.of(given[k : k + 1]))
        accelerations[k] = engine.acceleration(y, forces[k], given.force[k], given.moment[k])
        gaps[k] = engine.closure_error(y)
        progress(k + 1)
    trajectory = Trajectory(given, State.of(given), accelerations, forces, gaps)
    linear, angular = trajectory.acceleration_error()
    absolute = {
        "max_acceleration_error_m_s2": float(linear.max()),
        "max_angular_acceleration_error_rad_s2": float(angular.max()),
    }
    return Outcome(trajectory, simulated=False, stopped=_first_singular(motion, regular), more=absolute)


def _first_singular(motion: Motion, regular: NDArray[np.bool_]) -> Stop | None:
    if regular.all():
        return None
    count = int((~regular).sum())
    samples = "1 sample, which has" if count == 1 else f"{count} samples, which have"
    reason = f"the planned pose is singular at {samples} no leg forces"
    return Stop(reason, float(motion.time[np.argmin(regular)]))
