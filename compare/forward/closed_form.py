"""The closed form: six accelerations of the platform from M, bias and J, legs in closed form."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from sixsps.arrays import Array
from sixsps.dynamics import State, forward_dynamics
from sixsps.mechanism import Mechanism
from sixsps.rotation import quaternion_rates

_POSITION, _QUATERNION, _VELOCITY, _OMEGA = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)


class ClosedForm:
    """y = [position, quaternion, velocity, angular velocity] of the platform."""

    formulation = "M [a; epsilon] + bias = J F + W, projected by the partial velocities of Kane's method"
    loops = "none to close: leg motion in closed form"
    settings = "none"
    steps_itself = False

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism

    @staticmethod
    def version() -> str:
        """Returns the version of sixsps."""
        return f"sixsps {version('sixsps')}"

    def initial(self, state: State) -> Array:
        """Returns y (13,); see `ForwardEngine`."""
        return np.concatenate(
            [state.position[0], state.quaternion[0], state.velocity[0], state.angular_velocity[0]]
        )

    def rates(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns dy/dt (13,); see `ForwardEngine`."""
        turning = quaternion_rates(y[_QUATERNION], y[_OMEGA])
        return np.concatenate([y[_VELOCITY], turning, self.acceleration(y, forces, force, moment)])

    def acceleration(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns (6,) accelerations; see `ForwardEngine`."""
        state = self.platform(y)
        return forward_dynamics(self._mechanism, state, forces[None], force[None], moment[None])[0]

    def platform(self, y: Array) -> State:
        """Returns the platform's state; see `ForwardEngine`."""
        return State(y[None, _POSITION], y[None, _QUATERNION], y[None, _VELOCITY], y[None, _OMEGA])

    def closure_error(self, y: Array) -> float:  # noqa: ARG002
        """Returns 0: no loop is opened."""
        return 0.0
