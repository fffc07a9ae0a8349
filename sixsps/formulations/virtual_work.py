"""The principle of virtual work with link Jacobians in leg frames, as in Tsai (2000).

L.-W. Tsai, "Solving the inverse dynamics of a Stewart-Gough manipulator by the principle of virtual
work", J. Mech. Des. 122 (2000) 3-9. His a_i, b_i, d_i are A_i, c_i = R b_i and l_i here. Each leg has
a frame of its own at A_i, z along the leg, turned from the world axes by two angles: phi about z, then
theta about the turned y. Velocities, accelerations and wrenches of a leg are written in that frame.
With x_p the platform's pose, x_1, x_2 those of a leg's lower and upper link and the tau_i the actuators'
forces, for every virtual displacement

    dq^T tau + dx_p^T F_p + sum_i (dx_1^T F_1 + dx_2^T F_2) = 0,  dq = J_p dx_p,  dx_1 = J_1 dx_p, ...

    tau = -J_p^-T (F_p + sum_i (J_1^T F_1 + J_2^T F_2)),

where F_1, F_2 are the resultants of applied and inertia forces about the links' centres of mass and F_p
is the platform's about its origin, where Tsai has its centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
    size = mechanism.characteristic_length
    with np.errstate(all="ignore"):  # a leg of no length or hardly any; its sample is dropped below
        legs = leg_motion(mechanism, motion)
        F = _generalised_wrench(mechanism, motion, legs)
    J_p = legs.joint_jacobian[:, :, 2]
    regular = condition_numbers(J_p, legs.lengths, size) <= SINGULAR_CONDITION
    scale = np.array([1.0] * 3 + [size] * 3)[:, None]
    tau = np.full((len(motion), 6), np.nan)
    rows, right = J_p[regular].swapaxes(1, 2) / scale, F[regular, :, None] / scale
    tau[regular] = -np.linalg.solve(rows, right)[..., 0]
    return tau


@dataclass(frozen=True, eq=False)
class LegMotion:
    """Motion of the six legs at every sample, vectors in their leg frames.

    Attributes:
        lengths: (n, 6) d_i [m].
        frames: (n, 6, 3, 3) rows are the leg frame's axes in world axes, z along the leg.
        joint_jacobian: (n, 6, 3, 6) J_b, the platform's twist to the velocity of B_i; the last rows
            are J_p, twist to length rates.
        velocity: (n, 6, 3) of B_i [m/s].
        acceleration: (n, 6, 3) of B_i [m/s^2].
        gravity: (n, 6, 3) [m/s^2].
    """

    lengths: Array
    frames: Array
    joint_jacobian: Array
    velocity: Array
    acceleration: Array
    gravity: Array


def leg_motion(mechanism: Mechanism, motion: Motion) -> LegMotion:
    """Returns how the legs follow the platform.

    Args:
        mechanism: geometry and gravity.
        motion: n samples.

    Returns:
        Leg motion; of a leg of zero length only the length is a number.
    """
    b = mechanism.platform_anchors @ motion.rotation.swapaxes(1, 2)
    # In this order a world frame far away costs no digits of b.
    vectors = (motion.position[:, None] - mechanism.base_anchors) + b
    d = np.linalg.norm(vectors, axis=-1)
    frames = leg_frames(vectors, d)
    # x . (omega x b) = (b x x) . omega, for each axis x of the leg frame.
    joint_jacobian = np.concatenate([frames, np.cross(b[:, :, None], frames)], axis=-1)
    twist = np.hstack([motion.velocity, motion.angular_velocity])
    rate = np.hstack([motion.acceleration, motion.angular_acceleration])
    omega = motion.angular_velocity[:, None]
    centripetal = np.cross(omega, np.cross(omega, b))
    return LegMotion(
        lengths=d,
        frames=frames,
        joint_jacobian=joint_jacobian,
        velocity=np.einsum("nkij,nj->nki", joint_jacobian, twist),
        acceleration=np.einsum("nkij,nj->nki", joint_jacobian, rate)
        + np.einsum("nkij,nkj->nki", frames, centripetal),
        gravity=frames @ mechanism.gravity,
    )


def leg_frames(vectors: Array, lengths: Array) -> Array:
    """Returns the axes of Tsai's leg frames, as rows.

    Args:
        vectors: (..., 3) from A_i to B_i, world axes [m].
        lengths: (...,) their lengths [m].

    Returns:
        (..., 3, 3) rotations from world axes to leg axes.
    """
    x, y, z = np.moveaxis(vectors, -1, 0)
    # Any phi will do for a vertical leg, whose phi is not defined; arctan2 gives one.
    phi = np.arctan2(y, x)
    c_phi, s_phi = np.cos(phi), np.sin(phi)
    c_theta, s_theta = z / lengths, np.hypot(x, y) / lengths
    rows = (
        (c_phi * c_theta, s_phi * c_theta, -s_theta),
        (-s_phi, c_phi, np.zeros_like(phi)),
        (c_phi * s_theta, s_phi * s_theta, c_theta),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def link_jacobians(mechanism: Mechanism, legs: LegMotion) -> tuple[Array, Array]:
    """Returns J_1 and J_2 of the links, from the platform's twist to theirs.

    Args:
        mechanism: the links' centres of mass.
        legs: `leg_motion` of the samples.

    Returns:
        (n, 6, 6, 6) of the lower and of the upper links: rows are the velocity of the centre of mass
        and the angular velocity, in the leg frame.
    """
    x, y, z = np.moveaxis(legs.joint_jacobian, 2, 0)
    d = legs.lengths[..., None]
    e_1, e_2 = mechanism.lower.com[:, None], mechanism.upper.com[:, None]
    zero = np.zeros_like(x)
    turning = (-y / d, x / d, zero)
    J_1 = np.stack([e_1 / d * x, e_1 / d * y, zero, *turning], axis=2)
    J_2 = np.stack([(d - e_2) / d * x, (d - e_2) / d * y, z, *turning], axis=2)
    return J_1, J_2


@dataclass(frozen=True, eq=False)
class LinkAccelerations:
    """Accelerations of the links, in their leg frames.

    Attributes:
        lower: (n, 6, 3) of the lower links' centres of mass [m/s^2].
        upper: (n, 6, 3) of the upper links' centres of mass [m/s^2].
        angular: (n, 6, 3) of both links of a leg [rad/s^2].
    """

    lower: Array
    upper: Array
    angular: Array


def link_accelerations(mechanism: Mechanism, legs: LegMotion) -> LinkAccelerations:
    """Returns the accelerations of the links, which do not spin about their leg.

    Args:
        mechanism: the links' centres of mass.
        legs: `leg_motion` of the samples.
    """
    v_x, v_y, v_z = np.moveaxis(legs.velocity, -1, 0)
    a_x, a_y, a_z = np.moveaxis(legs.acceleration, -1, 0)
    d, e_1, e_2 = legs.lengths, mechanism.lower.com, mechanism.upper.com
    # Second derivative of the unit vector along the leg.
    s_x, s_y = (a_x - 2 * v_z * v_x / d) / d, (a_y - 2 * v_z * v_y / d) / d
    s_z = -(v_x * v_x + v_y * v_y) / d**2
    return LinkAccelerations(
        lower=np.stack([e_1 * s_x, e_1 * s_y, e_1 * s_z], axis=-1),
        upper=np.stack([a_x - e_2 * s_x, a_y - e_2 * s_y, a_z - e_2 * s_z], axis=-1),
        angular=np.stack([-s_y, s_x, np.zeros_like(d)], axis=-1),
    )


def _generalised_wrench(mechanism: Mechanism, motion: Motion, legs: LegMotion) -> Array:
    """F_p + sum_i (J_1^T F_1 + J_2^T F_2), (n, 6): what the actuators have to balance."""
    J_1, J_2 = link_jacobians(mechanism, legs)
    F_1, F_2 = _link_wrenches(mechanism, legs)
    links = np.einsum("nkij,nki->nj", J_1, F_1) + np.einsum("nkij,nki->nj", J_2, F_2)
    return _platform_wrench(mechanism, motion) + links


def _link_wrenches(mechanism: Mechanism, legs: LegMotion) -> tuple[Array, Array]:
    """F_1 and F_2, (n, 6, 6): weight and inertia forces of the links, in the leg frame."""
    accelerations = link_accelerations(mechanism, legs)
    wrenches = []
    for links, acceleration in (
        (mechanism.lower, accelerations.lower),
        (mechanism.upper, accelerations.upper),
    ):
        force = links.mass[:, None] * (legs.gravity - acceleration)
        # I omega = I_t omega without spin, so that omega x I omega is zero.
        moment = -links.transverse[:, None] * accelerations.angular
        wrenches.append(np.concatenate([force, moment], axis=-1))
    return wrenches[0], wrenches[1]


def _platform_wrench(mechanism: Mechanism, motion: Motion) -> Array:
    """F_p, (n, 6): load, weight and inertia forces of the platform about its origin, world axes."""
    platform, R = mechanism.platform, motion.rotation
    omega, epsilon = motion.angular_velocity, motion.angular_acceleration
    r = R @ platform.com
    acceleration = motion.acceleration + np.cross(epsilon, r) + np.cross(omega, np.cross(omega, r))
    force = motion.force + platform.mass * (mechanism.gravity - acceleration)
    inertia = R @ platform.inertia @ R.swapaxes(1, 2)
    spin, spin_up = (np.einsum("nij,nj->ni", inertia, vector) for vector in (omega, epsilon))
    moment = motion.moment - spin_up - np.cross(omega, spin)
    return np.hstack([force, moment + np.cross(r, force)])
