"""Newton-Euler balances in NumPy."""

from __future__ import annotations

from compare.engines.formulation import FormulationEngine


class NewtonEuler(FormulationEngine):
    """Balance of force and moment body by body, in the order of Dasgupta & Mruthyunjaya (1998)."""

    formulation = "Newton-Euler, force and moment balances as in Dasgupta & Mruthyunjaya (1998)"
    loops = "none to close: leg motion by differentiating leg vectors, forces in the joints by balance"
    shares = "the threshold of singularity with kane"
    name = "newton-euler"
