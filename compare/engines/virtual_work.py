"""The principle of virtual work in NumPy."""

from __future__ import annotations

from compare.engines.formulation import FormulationEngine


class VirtualWork(FormulationEngine):
    """Link Jacobians, accelerations and wrenches in leg frames, as in Tsai (2000)."""

    formulation = "principle of virtual work, link Jacobians in leg frames, Tsai (2000)"
    loops = "none to close: leg motion in closed form, in leg frames"
    shares = "the threshold of singularity with kane"
    name = "virtual-work"
