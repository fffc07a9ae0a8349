"""The equations of `casadi.py` as machine code, on one thread.

Evaluates the same graph of `sixsps.symbolic`, lowered by `sixsps.kernels`: the two can be wrong together.
`sixsps.compile` is the same on all threads, with derivatives, and keeps what it knows of the mechanism.
"""

from __future__ import annotations

from sixsps.arrays import Array
from sixsps.kernels import model
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


def inverse_dynamics(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns the leg forces along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN at singular poses.
    """
    return compiled(mechanism).inverse_dynamics(motion)


def compiled(mechanism: Mechanism) -> model.CompiledMechanism:
    """Returns what computes the forces, on one thread; machine code is made or read from disk once."""
    return model.compile(mechanism, threads=1)
