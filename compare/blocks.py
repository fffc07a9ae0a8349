"""Array formulations as engines: blocks of samples, so that memory is bounded and progress shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

_BLOCK = 4096


def in_blocks(
    formulation: Callable[[Mechanism, Motion], Array],
    mechanism: Mechanism,
    motion: Motion,
    progress: Progress,
) -> EngineForces:
    """Returns the forces of `formulation`, block by block.

    Args:
        formulation: (mechanism, motion) -> (n, 6) forces [N].
        mechanism: geometry and inertia.
        motion: n samples.
        progress: called after every block.
    """
    forces = np.empty((len(motion), 6))
    for start in range(0, len(motion), _BLOCK):
        block = slice(start, start + _BLOCK)
        forces[block] = formulation(mechanism, motion[block])
        progress(min(start + _BLOCK, len(motion)))
    return EngineForces(forces)
