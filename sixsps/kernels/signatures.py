"""What goes into and comes out of each kernel, known without building a graph."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sixsps.parameters import MOTION_COLUMNS

REGULARITY = "regularity"
"""Output of a function that tells how far a sample is from being singular; no array of a kernel."""


@dataclass(frozen=True, eq=False)
class Signature:
    """Arrays of a kernel, one row a sample.

    Attributes:
        name: of the function of `sixsps.symbolic` that it evaluates.
        inputs: of that function, without the parameters.
        outputs: name -> shape of one sample.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: dict[str, tuple[int, ...]]

    @property
    def arrays(self) -> dict[str, int]:
        """Array of a `Motion` -> its width, in the order in which the kernel takes them."""
        return dict(array for name in self.inputs for array in MOTION_COLUMNS[name])

    @property
    def sizes(self) -> dict[str, int]:
        """Output -> number of its entries a sample."""
        return {name: math.prod(shape) for name, shape in self.outputs.items()}


_POSE = ("pose",)
_ACCELERATION = ("pose", "twist", "acceleration")
_MOTION = ("pose", "twist", "acceleration", "wrench")
_BLOCK = (6, 6)

FORCES = Signature("forces", _MOTION, {"F": (6,)})
FORCE_DERIVATIVES = Signature(
    "force_derivatives",
    _MOTION,
    {"F": (6,), "by_pose": _BLOCK, "by_twist": _BLOCK, "by_acceleration": _BLOCK, "by_wrench": _BLOCK},
)
PARAMETER_DERIVATIVES = Signature("parameter_derivatives", _MOTION, {"by_parameters": (6, 97)})
EQUATIONS = Signature("equations", _MOTION, {"J": _BLOCK, "C": (6,)})
LEG_MOTION = Signature(
    "leg_motion",
    _ACCELERATION,
    {"lengths": (6,), "length_rates": (6,), "length_accelerations": (6,)},
)
SIGNATURES = {
    one.name: one for one in (FORCES, FORCE_DERIVATIVES, PARAMETER_DERIVATIVES, EQUATIONS, LEG_MOTION)
}
"""Function -> its kernel's arrays."""
