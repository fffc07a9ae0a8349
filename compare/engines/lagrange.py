"""Lagrange's equations from energies of positions, by CasADi."""

from __future__ import annotations

from importlib.metadata import version

from compare.engine import EngineForces, Progress
from sixsps.formulations import inverse_dynamics, lagrange
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


class Lagrange:
    """Kinetic and potential energy as functions of positions, all else by algorithmic differentiation."""

    formulation = "Lagrange's equations, energies of positions differentiated by CasADi"
    loops = "none to close: leg vectors as functions of the platform pose"
    shares = "the threshold of singularity with kane"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        lagrange.equations()  # built once a process, here and not while samples are timed

    @staticmethod
    def version() -> str:
        """Returns the version of CasADi."""
        return f"casadi {version('casadi')}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        return EngineForces(inverse_dynamics(self._mechanism, motion, "lagrange", progress))
