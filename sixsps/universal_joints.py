"""What universal joints at the base cost: the spin of the legs, and the actuator forces that it takes.

A leg on ball joints does not spin. A universal joint lets it turn about the first axis x, fixed in
the base, and the second, square to x and to the leg, but not about the normal of the two. With the leg's
angular velocity omega without spin, p = x.s and D = 1 - p^2 the leg spins at p (omega.x) / D about s.
The moment that its axial inertia needs for that comes from the joint along its normal; what of this
is square to the leg has to be held, with the gyroscopic moment, by a force at the platform joint.
"""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import solve_leg_forces


def spin_forces(mechanism: Mechanism, motion: Motion, first_axes: Array) -> Array:
    """Returns what legs on universal joints add to the leg forces of legs that do not spin.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        first_axes: (6, 3) unit vectors of the joints' axes in the base, world axes.

    Returns:
        (n, 6) [N]; NaN at singular poses, without bound where a leg lies along its first axis.
    """
    legs = inverse_kinematics(mechanism, motion)
    s, omega = legs.directions, legs.leg_angular_velocity
    x = np.broadcast_to(first_axes, s.shape)
    p, w = _dot(x, s), _dot(omega, x)
    p_dot, w_dot = _dot(x, np.cross(omega, s)), _dot(legs.leg_angular_acceleration, x)
    with np.errstate(divide="ignore", invalid="ignore"):
        D = 1 - p**2
        spin = p * w / D
        spin_dot = (p_dot * w + p * w_dot) / D + 2 * p**2 * p_dot * w / D**2
        inertia = (mechanism.lower.axial + mechanism.upper.axial)[:, None]
        moment = inertia * (spin * np.cross(omega, s) - spin_dot * p * (p * s - x) / D)
        force = np.cross(moment, s) / legs.lengths[..., None]
    wrench = np.concatenate([force, np.cross(legs.arms, force)], axis=-1).sum(axis=1)
    return solve_leg_forces(legs.jacobian, wrench, legs.condition, mechanism.characteristic_length)


def _dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1, keepdims=True)
