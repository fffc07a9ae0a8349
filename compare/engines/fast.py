"""The symbolic graph of `casadi` as machine code, by Numba."""

from __future__ import annotations

from compare.engines.formulation import FormulationEngine
from sixsps.formulations import fast
from sixsps.mechanism import Mechanism


class Fast(FormulationEngine):
    """The equations of `casadi`, one sample a lane of the vector unit, on one thread."""

    formulation = "the equations of casadi and their solve, lowered from its graph to machine code by Numba"
    loops = "none to close: leg vectors as functions of the platform pose"
    shares = (
        "the symbolic graph with casadi, so that the two can be wrong together; the threshold of "
        "singularity with kane"
    )
    name = "fast"
    package = "numba"

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        fast.compiled(mechanism)  # compiled or read from disk here and not while samples are timed
