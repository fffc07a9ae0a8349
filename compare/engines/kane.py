"""Kane's method in NumPy."""

from __future__ import annotations

from compare.engines.formulation import FormulationEngine


class Kane(FormulationEngine):
    """The corrected equations of Wu, Xiong & Kong (2012)."""

    formulation = "Kane's method, Wu, Xiong & Kong (2012) corrected"
    loops = "none to close: leg motion in closed form"
    shares = "its leg kinematics gives lengths, condition numbers and singular samples of the report"
    name = "kane"
