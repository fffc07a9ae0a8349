"""What an engine is: one way to compute leg forces, in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

Progress = Callable[[int], None]
"""Called with the number of samples done so far."""


@dataclass(frozen=True, eq=False)
class EngineForces:
    """What an engine gives for a motion.

    Attributes:
        forces: (n, 6) leg forces [N], positive in extension.
        closure_residual: (n,) what the actuator and closure forces leave of the tree's generalised
            forces, largest entry [N, N m]; None for an engine that opens no loop.
        closure_error: (n,) largest distance between the two ends of an opened loop [m], or None.
    """

    forces: Array
    closure_residual: Array | None = None
    closure_error: Array | None = None


class Engine(Protocol):
    """One way to compute leg forces, set up for one mechanism.

    Its constructor takes the mechanism: geometry, inertia and gravity, of which nothing may come
    from an engine's defaults. It raises EngineError when the library does not accept it.

    Attributes:
        formulation: how it forms the equations.
        loops: how it closes the loops.
        shares: code that it shares with other engines, besides the frozen inputs.
    """

    formulation: str
    loops: str
    shares: str

    def __init__(self, mechanism: Mechanism) -> None: ...

    @staticmethod
    def version() -> str:
        """Returns name and version of what computes: a library, or this package."""
        ...

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion.

        Args:
            motion: n samples, none of them singular.
            progress: to be called now and then.

        Raises:
            EngineError: the library gave no forces.
        """
        ...
