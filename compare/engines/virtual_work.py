"""The principle of virtual work in NumPy."""

from __future__ import annotations

from importlib.metadata import version

from compare.engine import EngineForces, Progress
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


class VirtualWork:
    """Link Jacobians, accelerations and wrenches in leg frames, as in Tsai (2000)."""

    formulation = "principle of virtual work, link Jacobians in leg frames, Tsai (2000)"
    loops = "none to close: leg motion in closed form, in leg frames"
    shares = "the threshold of singularity with kane"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism

    @staticmethod
    def version() -> str:
        """Returns the version of sixsps."""
        return f"sixsps {version('sixsps')}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        return EngineForces(inverse_dynamics(self._mechanism, motion, "virtual-work", progress))
