"""Newton-Euler balances in NumPy."""

from __future__ import annotations

from importlib.metadata import version

from compare.engine import EngineForces, Progress
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


class NewtonEuler:
    """Balance of force and moment body by body, in the order of Dasgupta & Mruthyunjaya (1998)."""

    formulation = "Newton-Euler, force and moment balances as in Dasgupta & Mruthyunjaya (1998)"
    loops = "none to close: leg motion by differentiating leg vectors, forces in the joints by balance"
    shares = "the threshold of singularity with kane"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism

    @staticmethod
    def version() -> str:
        """Returns the version of sixsps."""
        return f"sixsps {version('sixsps')}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        return EngineForces(inverse_dynamics(self._mechanism, motion, "newton-euler", progress))
