"""Kane's method exactly as Wu, Xiong & Kong (2012) print it: expected to give wrong forces.

Every misprint that changes a number can be switched on by itself, so that its effect can be told in
newtons; with none of them the equations are the corrected ones. Where the print cannot be
evaluated as it stands, it is read as NumPy and MATLAB would compute it: a row vector added to a matrix
is added to each of its rows. The motion of the legs is that of `kinematics.py`; the print leaves out the
leg's angular acceleration and the accelerations of the links' centres of mass.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import euler_rates, skew
from sixsps.singularity import solve_leg_forces


@dataclass(frozen=True)
class Misprint:
    """One equation that does not hold as printed.

    Attributes:
        equation: number in the paper.
        printed: what it says.
        corrected: what belongs there.
    """

    equation: str
    printed: str
    corrected: str


MISPRINTS: dict[str, Misprint] = {
    "speeds": Misprint(
        "q' = [v, ω]",
        "ω is the rate of the Euler angles α, β, γ",
        "ω is a quasi-velocity; the rates of the Euler angles are E(α, β)⁻¹ ω",
    ),
    "com": Misprint("6, 11", "r_m, in platform axes", "R r_m, in world axes"),
    "sign": Misprint("15", "(s·c) E + c sᵀ", "(s·c) E − c sᵀ"),
    "rows": Misprint("15", "sᵀ and (c×s)ᵀ, added to matrices", "s sᵀ and s (c×s)ᵀ"),
    "moment": Misprint("21-23", "m_w · ∂v_m/∂ω", "m_w · ∂ω/∂ω"),
    "force": Misprint("21-23", "m_m g · ∂v_m/∂ω, without F_w", "(m_m g + F_w) · ∂v_m/∂ω"),
    "inertia": Misprint("27-29", "I_m, in platform axes", "R I_m Rᵀ, in world axes"),
}
"""The misprints that change a number."""


def inverse_dynamics(
    mechanism: Mechanism, motion: Motion, misprints: Collection[str] = tuple(MISPRINTS)
) -> Array:
    """Returns leg forces that are wrong by what the misprints make of them.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        misprints: names of `MISPRINTS`; all of them by default.

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN at singular poses.
    """
    if "speeds" in misprints:
        motion = with_euler_rates(motion)
    legs = inverse_kinematics(mechanism, motion)
    C = -_legs(mechanism, legs, misprints) - _platform(mechanism, motion, misprints)
    return solve_leg_forces(legs.jacobian, C, legs.condition, mechanism.characteristic_length)


def with_euler_rates(motion: Motion) -> Motion:
    """Returns the motion with first and second rates of its Euler angles in place of ω and ε."""
    angles = Rotation.from_quat(motion.quaternion, scalar_first=True).as_euler("XYZ")
    rates, accelerations = euler_rates(angles, motion.angular_velocity, motion.angular_acceleration)
    return replace(motion, angular_velocity=rates, angular_acceleration=accelerations)


def _legs(mechanism: Mechanism, legs: LegKinematics, misprints: Collection[str]) -> Array:
    """Returns (n, 6) generalised active and inertia forces of the twelve links."""
    g = mechanism.gravity
    lower, upper = mechanism.lower, mechanism.upper
    weight_d, weight_u = lower.mass[:, None] * g, upper.mass[:, None] * g
    inertia_d = -lower.mass[:, None] * legs.lower_acceleration
    inertia_u = -upper.mass[:, None] * legs.upper_acceleration
    moment = -(lower.transverse + upper.transverse)[:, None] * legs.leg_angular_acceleration
    return (
        np.einsum("nkij,nki->nj", _lower_partial(mechanism, legs), weight_d + inertia_d)
        + np.einsum("nkij,nki->nj", _upper_partial(mechanism, legs, misprints), weight_u + inertia_u)
        + np.einsum("nkij,nki->nj", _angular_partial(legs), moment)
    )


def _angular_partial(legs: LegKinematics) -> Array:
    s = legs.directions
    return np.concatenate([skew(s), _turning(legs, -1)], axis=-1) / legs.lengths[..., None, None]


def _lower_partial(mechanism: Mechanism, legs: LegKinematics) -> Array:
    """Eq. 14, headed "up links" in the print."""
    s, e_d = legs.directions, mechanism.lower.com[:, None, None]
    across = np.concatenate([-skew(s) @ skew(s), -skew(s) @ _turning(legs, -1)], axis=-1)
    return e_d / legs.lengths[..., None, None] * across


def _upper_partial(mechanism: Mechanism, legs: LegKinematics, misprints: Collection[str]) -> Array:
    """Eq. 15."""
    s, c = legs.directions, legs.arms
    rest = 1 - mechanism.upper.com[:, None, None] / legs.lengths[..., None, None]
    K = _turning(legs, 1 if "sign" in misprints else -1)
    along = np.ones_like(s) if "rows" in misprints else s
    linear = along[..., :, None] * s[..., None, :] - rest * skew(s) @ skew(s)
    angular = along[..., :, None] * np.cross(c, s)[..., None, :] - rest * skew(s) @ K
    return np.concatenate([linear, angular], axis=-1)


def _turning(legs: LegKinematics, sign: int) -> Array:
    """Returns (n, 6, 3, 3) (s.c) E + sign c s^T."""
    s, c = legs.directions, legs.arms
    return np.sum(s * c, axis=-1)[..., None, None] * np.eye(3) + sign * c[..., :, None] * s[..., None, :]


def _platform(mechanism: Mechanism, motion: Motion, misprints: Collection[str]) -> Array:
    """Returns (n, 6) generalised active (eqs. 18-23) and inertia forces (eqs. 24-29) of the platform."""
    platform, omega, epsilon = mechanism.platform, motion.angular_velocity, motion.angular_acceleration
    r_m = np.broadcast_to(platform.com, omega.shape) if "com" in misprints else motion.rotation @ platform.com
    acceleration = motion.acceleration + np.cross(epsilon, r_m) + np.cross(omega, np.cross(omega, r_m))
    inertia = platform.mass * (mechanism.gravity - acceleration)
    turning = inertia if "force" in misprints else inertia + motion.force
    # f . dv_m/domega is (r_m x f), for a force f on the centre of mass.
    moment = np.cross(r_m, turning) + _inertia_moment(mechanism, motion, misprints)
    moment += np.cross(r_m, motion.moment) if "moment" in misprints else motion.moment
    return np.hstack([inertia + motion.force, moment])


def _inertia_moment(mechanism: Mechanism, motion: Motion, misprints: Collection[str]) -> Array:
    R, omega, epsilon = motion.rotation, motion.angular_velocity, motion.angular_acceleration
    if "inertia" in misprints:
        R = np.broadcast_to(np.eye(3), R.shape)
    I_m = R @ mechanism.platform.inertia @ np.swapaxes(R, 1, 2)
    spin = np.einsum("nij,nj->ni", I_m, omega)
    return -np.einsum("nij,nj->ni", I_m, epsilon) - np.cross(omega, spin)
