"""What an engine of forward dynamics is: accelerations from leg forces, in coordinates of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from sixsps.arrays import Array
from sixsps.dynamics import State
from sixsps.mechanism import Mechanism
from sixsps.rotation import quaternion_rates

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])

Watch = Callable[[float, Array], bool]
"""Time [s] and state vector to whether a run may go on."""

ForcesAt = Callable[[float, Array], tuple[Array, Array, Array]]
"""Time [s] and state vector to leg forces (6,) [N], external force (3,) [N] and moment (3,) [N m]."""


class ForwardEngine(Protocol):
    """Forward dynamics of one mechanism, one state at a time.

    Its state vector y holds whatever coordinates and rates it integrates; quaternions in it may be
    of any length but zero. Leg forces are positive in extension; force and moment act on the
    platform's centre of mass, world axes.

    Attributes:
        formulation: how it forms the equations.
        loops: how it closes the loops.
        settings: what its figures depend on: stiffness of constraints, steps, iterations.
        steps_itself: whether it has a method `run`, which is to be used instead of a general
            integrator over `rates`; see `SteppingEngine`.
    """

    formulation: str
    loops: str
    settings: str
    steps_itself: bool

    def __init__(self, mechanism: Mechanism) -> None: ...

    @staticmethod
    def version() -> str:
        """Returns name and version of what computes: a library, or this package."""
        ...

    def initial(self, state: State) -> Array:
        """Returns the state vector y (m,) of one state of the platform, loops closed."""
        ...

    def rates(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns dy/dt (m,) under leg forces (6,) [N], external force (3,) [N] and moment (3,) [N m].

        Raises:
            EngineError: the library gave no accelerations.
        """
        ...

    def acceleration(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns (6,) acceleration of O1 [m/s^2] and angular acceleration [rad/s^2], world axes."""
        ...

    def platform(self, y: Array) -> State:
        """Returns the platform's state, n = 1."""
        ...

    def closure_error(self, y: Array) -> float:
        """Returns the largest distance between the ends of a loop [m]; 0 where none is opened."""
        ...


def unwatched(_t: float, _y: Array) -> bool:
    """Lets a run go on."""
    return True


class SteppingEngine(ForwardEngine, Protocol):
    """An engine whose library integrates better than a general integrator could: `steps_itself` is true."""

    def run(self, y: Array, time_points: Array, forces_at: ForcesAt, watch: Watch = unwatched) -> Array:
        """Returns the state vectors (k, m) at k times [s], the first of them `y`; fewer if told to stop.

        Args:
            y: (m,) state vector at the first time.
            time_points: (k,) strictly increasing [s].
            forces_at: what pushes; asked at times and states of the library's choice. What it
                raises ends the run.
            watch: asked at every one of the times but the first, and every few steps between; ends
                the run where it does not return True.

        Raises:
            EngineError: the library did not get to the end, or the state is no number any more.
        """
        ...


def ball_rates(quaternions: Array, omega: Array) -> Array:
    """Returns the time derivatives (k, 4) of ball joints' quaternions; keeps their lengths.

    Args:
        quaternions: (k, 4) w, x, y, z.
        omega: (k, 3) angular velocities in axes of the body, as Pinocchio and MuJoCo have them [rad/s].
    """
    # Seen from the body, all else turns at -omega, and its orientation is the conjugate.
    return quaternion_rates(quaternions * _CONJUGATE, -omega) * _CONJUGATE
