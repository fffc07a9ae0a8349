"""Formulations of the inverse dynamics: one file each, all with the same signature.

Each module has `inverse_dynamics(mechanism, motion) -> (n, 6)` leg forces [N].
"""

from __future__ import annotations

from importlib import import_module

from sixsps.arrays import Array
from sixsps.errors import UnknownNameError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

FORMULATIONS = {"kane": "sixsps.formulations.kane", "casadi": "sixsps.formulations.casadi"}


def inverse_dynamics(mechanism: Mechanism, motion: Motion, formulation: str = "kane") -> Array:
    """Returns the six leg forces along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n samples of pose, twist, acceleration and external wrench.
        formulation: a name of `FORMULATIONS`.

    Returns:
        (n, 6) leg forces [N], positive when the actuator pushes (extends the leg); a row of NaN
        where the pose is singular (condition number of J above 1e12).

    Raises:
        UnknownNameError: there is no such formulation.
    """
    if formulation not in FORMULATIONS:
        raise UnknownNameError("formulation", formulation, ", ".join(FORMULATIONS))
    forces: Array = import_module(FORMULATIONS[formulation]).inverse_dynamics(mechanism, motion)
    return forces
