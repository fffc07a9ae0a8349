"""Jourdain's principle leg by leg, rates by algorithmic differentiation, in CasADi.

Evaluates `sixsps.symbolic`; shares with `kane.py` the frozen inputs and the threshold of singularity.
"""

from __future__ import annotations

import numpy as np

from sixsps import symbolic
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers


def inverse_dynamics(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns the leg forces along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN at singular poses.
    """
    jacobian = symbolic.evaluate(symbolic.jacobian(), mechanism, motion)["jacobian"]
    lengths = symbolic.evaluate(symbolic.lengths(), mechanism, motion)["lengths"]
    condition = condition_numbers(jacobian, lengths, mechanism.characteristic_length)
    forces = symbolic.evaluate(symbolic.forces(), mechanism, motion)["F"]
    return np.where((condition <= SINGULAR_CONDITION)[:, None], forces, np.nan)
