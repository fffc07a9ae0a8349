"""Lengths, rates and Jacobian of the legs at a state, without what only inverse dynamics needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.dynamics import State
from sixsps.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class LegStates:
    """The legs at n states.

    Attributes:
        lengths: (n, 6) [m].
        rates: (n, 6) [m/s].
        jacobian: (n, 6, 6) with rates = jacobian @ [velocity; angular_velocity].
    """

    lengths: Array
    rates: Array
    jacobian: Array


def leg_states(mechanism: Mechanism, state: State) -> LegStates:
    """Returns the legs at n states; NaN where a leg has no length."""
    c = mechanism.platform_anchors @ np.swapaxes(state.rotation, 1, 2)
    S = (state.position[:, None] - mechanism.base_anchors) + c
    lengths = np.sqrt(np.einsum("nki,nki->nk", S, S))
    with np.errstate(invalid="ignore", divide="ignore"):
        s = S / lengths[..., None]
    # Written out: this is done at every stage of every step, and np.cross takes most of the time.
    x, y, z = c[..., 0], c[..., 1], c[..., 2]
    u, v, w = s[..., 0], s[..., 1], s[..., 2]
    jacobian = np.empty((len(c), 6, 6))
    jacobian[..., :3] = s
    jacobian[..., 3], jacobian[..., 4], jacobian[..., 5] = y * w - z * v, z * u - x * w, x * v - y * u
    twist = np.hstack([state.velocity, state.angular_velocity])
    return LegStates(lengths, np.einsum("nki,ni->nk", jacobian, twist), jacobian)
