"""CasADi symbolic model, J F = C by modified Gram-Schmidt in its graph; CasADi evaluates it."""

from __future__ import annotations

from compare.engines.formulation import FormulationEngine
from sixsps import symbolic
from sixsps.mechanism import Mechanism


class Casadi(FormulationEngine):
    """Jourdain's principle leg by leg, links as masses on a line; Newton-Euler for the platform."""

    formulation = (
        "d'Alembert's principle in Jourdain's form on each leg's vector, links as masses on that line, rates "
        "by CasADi's algorithmic differentiation; Newton-Euler for the platform"
    )
    loops = "none to close: leg vectors as functions of the platform pose"
    shares = (
        "the symbolic graph with fast, so that the two can be wrong together; the threshold of singularity "
        "with kane; gives the rate of energy of the power balance"
    )
    name = "casadi"
    package = "casadi"

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        symbolic.forces()  # built once a process, here and not while samples are timed
        symbolic.jacobian()
        symbolic.lengths()
