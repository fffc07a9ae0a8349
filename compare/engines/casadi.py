"""CasADi symbolic model, exact Jacobian, J F = C by Householder QR."""

from __future__ import annotations

from importlib.metadata import version

from compare.engine import EngineForces, Progress
from sixsps import symbolic
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


class Casadi:
    """Jourdain's principle with all derivatives by algorithmic differentiation of positions."""

    formulation = "Jourdain's principle, derivatives of positions by CasADi"
    loops = "none to close: leg vectors as functions of the platform pose"
    shares = "the threshold of singularity with kane; gives the rate of energy of the power balance"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        symbolic.forces()  # built once a process, here and not while samples are timed
        symbolic.jacobian()
        symbolic.lengths()

    @staticmethod
    def version() -> str:
        """Returns the version of CasADi."""
        return f"casadi {version('casadi')}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        return EngineForces(inverse_dynamics(self._mechanism, motion, "casadi", progress))
