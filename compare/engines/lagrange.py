"""Lagrange's equations from energies of positions, by CasADi."""

from __future__ import annotations

from compare.engines.formulation import FormulationEngine
from sixsps.formulations import lagrange
from sixsps.mechanism import Mechanism


class Lagrange(FormulationEngine):
    """Kinetic and potential energy as functions of positions, all else by algorithmic differentiation."""

    formulation = "Lagrange's equations, energies of positions differentiated by CasADi"
    loops = "none to close: leg vectors as functions of the platform pose"
    shares = "the threshold of singularity with kane"
    name = "lagrange"
    package = "casadi"

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        lagrange.equations()  # built once a process, here and not while samples are timed
