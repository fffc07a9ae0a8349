"""Kane's method, as in Wu, Xiong & Kong (2012), section 5, corrected.

Generalised speeds are the platform's twist [v; omega]. omega is a quasi-velocity, not the rate of
Euler angles as the paper's q' = [v, omega] has it. For every body, partial velocities project the
active and the inertia forces onto the six generalised speeds; the actuators are what is left:

    J F = C,    C = -(generalised active forces without actuators + generalised inertia forces).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import cross, skew
from sixsps.singularity import solve_leg_forces

_E = np.eye(3)


def inverse_dynamics(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns the leg forces along a motion (eq. 31).

    Args:
        mechanism: geometry and inertia.
        motion: n samples.

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN at singular poses.
    """
    legs = inverse_kinematics(mechanism, motion)
    C = actuator_wrench(mechanism, motion, legs)
    return solve_leg_forces(legs.jacobian, C, legs.condition, mechanism.characteristic_length)


def actuator_wrench(
    mechanism: Mechanism, motion: Motion, legs: LegKinematics, partial: PartialVelocities | None = None
) -> Array:
    """Returns C of eq. 31, the wrench that the six actuators together exert on the mechanism.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        legs: `inverse_kinematics(mechanism, motion)`.
        partial: `partial_velocities(mechanism, motion, legs)`, where they are known already.

    Returns:
        (n, 6) force [N] and moment about O1 [N m], world axes.
    """
    partial = partial or partial_velocities(mechanism, motion, legs)
    active = _active_forces(mechanism, motion, partial)
    inertia = _inertia_forces(mechanism, motion, legs, partial)
    return -(active + inertia)


@dataclass(frozen=True, eq=False)
class PartialVelocities:
    """Partial velocities with respect to [v; omega], world axes.

    Attributes:
        leg: (n, 6, 3, 6) angular, of both links of a leg.
        lower: (n, 6, 3, 6) of the lower links' centres of mass.
        upper: (n, 6, 3, 6) of the upper links' centres of mass.
        platform: (n, 3, 6) of the platform's centre of mass.
        platform_angular: (3, 6).
    """

    leg: Array
    lower: Array
    upper: Array
    platform: Array
    platform_angular: Array


def partial_velocities(mechanism: Mechanism, motion: Motion, legs: LegKinematics) -> PartialVelocities:
    """Returns the partial velocities of all thirteen bodies.

    Args:
        mechanism: the links' and the platform's centres of mass.
        motion: n samples.
        legs: `inverse_kinematics(mechanism, motion)`.
    """
    s, c, l = legs.directions, legs.arms, legs.lengths[..., None, None]  # noqa: E741
    e_d, e_u = mechanism.lower.com[:, None, None], mechanism.upper.com[:, None, None]
    s_skew = skew(s)
    ss = s[..., :, None] * s[..., None, :]
    across = _E - ss
    # Eq. 15 prints + c s^T, and the row vectors s^T and (c x s)^T for s s^T and s (c x s)^T.
    K = np.sum(s * c, axis=-1)[..., None, None] * _E - c[..., :, None] * s[..., None, :]
    along = s[..., :, None] * cross(c, s)[..., None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        leg = np.concatenate([s_skew, K], axis=-1) / l
        lower = e_d / l * np.concatenate([across, -s_skew @ K], axis=-1)  # eq. 14
        rest = 1 - e_u / l
        upper = np.concatenate([ss + rest * across, along - rest * s_skew @ K], axis=-1)  # eq. 15
    zero, one = np.zeros((3, 3)), np.broadcast_to(_E, (len(motion), 3, 3))
    r_m = motion.rotation @ mechanism.platform.com  # eqs. 6 and 11 leave r_m in platform axes
    platform = np.concatenate([one, -skew(r_m)], axis=-1)
    return PartialVelocities(leg, lower, upper, platform, np.hstack([zero, _E]))


def _active_forces(mechanism: Mechanism, motion: Motion, partial: PartialVelocities) -> Array:
    """Generalised active forces of gravity and the external wrench (eqs. 21-23, corrected).

    The print drops F_w, which does work about O1 once r_m is not 0, and dots m_w with a linear
    instead of the angular partial velocity.
    """
    g = mechanism.gravity
    weight_d = mechanism.lower.mass[:, None] * g
    weight_u = mechanism.upper.mass[:, None] * g
    load = mechanism.platform.mass * g + motion.force
    return (
        np.einsum("nkij,ki->nj", partial.lower, weight_d)
        + np.einsum("nkij,ki->nj", partial.upper, weight_u)
        + np.einsum("nij,ni->nj", partial.platform, load)
        + motion.moment @ partial.platform_angular
    )


def _inertia_forces(
    mechanism: Mechanism, motion: Motion, legs: LegKinematics, partial: PartialVelocities
) -> Array:
    """Generalised inertia forces -(m a) and -(I epsilon + omega x I omega) (eqs. 27-29, corrected)."""
    m_d, m_u = mechanism.lower.mass[:, None], mechanism.upper.mass[:, None]
    # Symmetric about s and without spin, a link has I omega_l = I_t omega_l, and nothing gyroscopic.
    I_t = (mechanism.lower.transverse + mechanism.upper.transverse)[:, None]
    platform_force, platform_moment = _platform_inertia_forces(mechanism, motion)
    return (
        np.einsum("nkij,nki->nj", partial.lower, -m_d * legs.lower_acceleration)
        + np.einsum("nkij,nki->nj", partial.upper, -m_u * legs.upper_acceleration)
        + np.einsum("nkij,nki->nj", partial.leg, -I_t * legs.leg_angular_acceleration)
        + np.einsum("nij,ni->nj", partial.platform, platform_force)
        + platform_moment @ partial.platform_angular
    )


def _platform_inertia_forces(mechanism: Mechanism, motion: Motion) -> tuple[Array, Array]:
    R, omega, epsilon = motion.rotation, motion.angular_velocity, motion.angular_acceleration
    r_m = R @ mechanism.platform.com
    a_m = motion.acceleration + cross(epsilon, r_m) + cross(omega, cross(omega, r_m))
    I_m = R @ mechanism.platform.inertia @ np.swapaxes(R, 1, 2)  # eqs. 27-29 print I_m unturned
    spin = np.einsum("nij,nj->ni", I_m, omega)
    moment = np.einsum("nij,nj->ni", I_m, epsilon) + cross(omega, spin)
    return -mechanism.platform.mass * a_m, -moment
