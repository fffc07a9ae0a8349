"""Formulations of the inverse dynamics: one file each, all with the same signature.

Each module has `inverse_dynamics(mechanism, motion) -> (n, 6)` leg forces [N].
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import UnknownNameError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

FORMULATIONS = {
    "kane": "sixsps.formulations.kane",
    "casadi": "sixsps.formulations.casadi",
    "fast": "sixsps.formulations.fast",
    "lagrange": "sixsps.formulations.lagrange",
    "newton-euler": "sixsps.formulations.newton_euler",
    "virtual-work": "sixsps.formulations.virtual_work",
    "wu2012-printed": "sixsps.formulations.wu2012_printed",
}
"""Name -> module. `wu2012-printed` is wrong, as the paper's print is."""


# A formulation needs some kilobytes a sample while it works; blocks keep that in the cache.
_BLOCK = 1024
# Machine code needs none, and to cut a block out of a motion takes longer than to compute its forces.
_WHOLE = ("fast",)


def inverse_dynamics(
    mechanism: Mechanism,
    motion: Motion,
    formulation: str = "kane",
    progress: Callable[[int], None] = lambda _done: None,
) -> Array:
    """Returns the six leg forces along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n samples of pose, twist, acceleration and external wrench.
        formulation: a name of `FORMULATIONS`.
        progress: called with the number of samples done so far.

    Returns:
        (n, 6) leg forces [N], positive when the actuator pushes (extends the leg); a row of NaN
        where the pose is singular (condition number of J above 1e12).

    Raises:
        UnknownNameError: there is no such formulation.
        MechanismError: a mechanism of geometry alone.
    """
    mechanism.check_inertia()
    if formulation not in FORMULATIONS:
        raise UnknownNameError("formulation", formulation, ", ".join(FORMULATIONS))
    of_block = import_module(FORMULATIONS[formulation]).inverse_dynamics
    if formulation in _WHOLE:
        whole: Array = of_block(mechanism, motion)
        progress(len(motion))
        return whole
    forces = np.empty((len(motion), 6))
    for start in range(0, len(motion), _BLOCK):
        block = slice(start, start + _BLOCK)
        forces[block] = of_block(mechanism, motion[block])
        progress(min(start + _BLOCK, len(motion)))
    return forces
