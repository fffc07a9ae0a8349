"""Kane's method in NumPy."""

from __future__ import annotations

from importlib.metadata import version

from compare.engine import EngineForces, Progress
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


class Kane:
    """The corrected equations of Wu, Xiong & Kong (2012)."""

    formulation = "Kane's method, Wu, Xiong & Kong (2012) corrected"
    loops = "none to close: leg motion in closed form"
    shares = "its leg kinematics gives lengths, condition numbers and singular samples of the report"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism

    @staticmethod
    def version() -> str:
        """Returns the version of sixsps."""
        return f"sixsps {version('sixsps')}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        return EngineForces(inverse_dynamics(self._mechanism, motion, "kane", progress))
