"""A simulated motion beside the planned one, and how far they are apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compare.forward.engine import ForcesAt, ForwardEngine
from compare.simulation.plan import Plan
from sixsps.arrays import Array
from sixsps.dynamics import State
from sixsps.motion import Motion


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A simulated motion at k samples of the planned one, world axes.

    Attributes:
        planned: (k) samples.
        state: k states; quaternions of unit length, of the sign of the planned ones.
        accelerations: (k, 6) of O1 [m/s^2] and angular [rad/s^2].
        forces: (k, 6) leg forces that drove it [N].
        closure_error: (k,) largest gap of a loop [m].
        feedback: (k, 6) the part of the forces that a controller added [N]; None without one.
    """

    planned: Motion
    state: State
    accelerations: Array
    forces: Array
    closure_error: Array
    feedback: Array | None = None

    def position_error(self) -> Array:
        """Returns (k,) distances of O1 from its planned position [m]."""
        return np.linalg.norm(self.state.position - self.planned.position, axis=1)

    def orientation_error(self) -> Array:
        """Returns (k,) angles between simulated and planned orientation [rad]."""
        return np.linalg.norm(rotation_between(self.planned.quaternion, self.state.quaternion), axis=1)

    def acceleration_error(self) -> tuple[Array, Array]:
        """Returns (k,) errors of acceleration [m/s^2] and of angular acceleration [rad/s^2]."""
        planned = np.hstack([self.planned.acceleration, self.planned.angular_acceleration])
        error = self.accelerations - planned
        return np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)

    def relative_acceleration_error(self, size: float) -> float:
        """Returns the largest acceleration error over the largest planned acceleration.

        Both are the larger of |a| and size |epsilon|; where nothing accelerates, the error is
        absolute [m/s^2].

        Args:
            size: length that makes angular accelerations comparable [m].
        """
        linear, angular = self.acceleration_error()
        error = float(np.maximum(linear, size * angular).max())
        turning = np.linalg.norm(self.planned.angular_acceleration, axis=1)
        planned = np.maximum(np.linalg.norm(self.planned.acceleration, axis=1), size * turning).max()
        return error / float(planned) if planned > 0 else error


def trajectory(
    engine: ForwardEngine, plan: Plan, states: Array, drive: ForcesAt, *, feed_forward: Array | None = None
) -> Trajectory:
    """Returns what an engine's state vectors (k, m) mean.

    Args:
        engine: whose they are.
        plan: at whose first k samples they stand.
        states: (k, m), k >= 1.
        drive: what drove them.
        feed_forward: (k, 6) part of the forces that was planned [N]; None where all of them are.
    """
    planned = plan.motion[: len(states)]
    inputs = [drive(t, y) for t, y in zip(planned.time, states, strict=True)]
    forces = np.array([given[0] for given in inputs])
    return Trajectory(
        planned=planned,
        state=_joined([engine.platform(y) for y in states], planned.quaternion),
        accelerations=np.array(
            [engine.acceleration(y, *given) for y, given in zip(states, inputs, strict=True)]
        ),
        forces=forces,
        closure_error=np.array([engine.closure_error(y) for y in states]),
        feedback=None if feed_forward is None else forces - feed_forward,
    )


def _joined(states: list[State], like: Array) -> State:
    position, quaternion, velocity, angular = (
        np.concatenate([getattr(state, name) for state in states])
        for name in ("position", "quaternion", "velocity", "angular_velocity")
    )
    quaternion = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    sign = np.where(np.einsum("ni,ni->n", quaternion, like) < 0, -1.0, 1.0)
    return State(position, sign[:, None] * quaternion, velocity, angular)


def rotation_between(first: Array, second: Array) -> Array:
    """Returns the rotation vectors (n, 3) that turn one orientation into another, world axes [rad].

    Args:
        first: (n, 4) quaternions w, x, y, z.
        second: (n, 4).
    """
    from scipy.spatial.transform import Rotation

    turned = (
        Rotation.from_quat(second, scalar_first=True) * Rotation.from_quat(first, scalar_first=True).inv()
    )
    return np.asarray(turned.as_rotvec(), dtype=np.float64)
