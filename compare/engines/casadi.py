"""CasADi symbolic model, exact Jacobian, J F = C by Householder QR."""

from __future__ import annotations

from compare.engines.formulation import FormulationEngine
from sixsps import symbolic
from sixsps.mechanism import Mechanism


class Casadi(FormulationEngine):
    """Jourdain's principle with all derivatives by algorithmic differentiation of positions."""

    formulation = "Jourdain's principle, derivatives of positions by CasADi"
    loops = "none to close: leg vectors as functions of the platform pose"
    shares = "the threshold of singularity with kane; gives the rate of energy of the power balance"
    name = "casadi"
    package = "casadi"

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        symbolic.forces()  # built once a process, here and not while samples are timed
        symbolic.jacobian()
        symbolic.lengths()
