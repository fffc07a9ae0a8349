"""What the formulations of this project have in common as engines: how they are called, and no equation."""

from __future__ import annotations

from importlib.metadata import version

from compare.engine import EngineForces, Progress
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


class FormulationEngine:
    """A formulation by its name in `sixsps.formulations`, in blocks of samples; see `Engine`.

    Attributes:
        name: of the formulation.
        package: distribution that computes.
    """

    name: str
    package = "sixsps"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism

    @classmethod
    def version(cls) -> str:
        """Returns name and version of the package that computes."""
        return f"{cls.package} {version(cls.package)}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        return EngineForces(inverse_dynamics(self._mechanism, motion, self.name, progress))
