"""Leg forces as a linear function of the inertial parameters.

    F = regressor @ parameters + wrench_forces

The balance of momentum of a rigid body is linear in its mass m, first moment m r and inertia about the
point that r is counted from, here O1 for the platform and its own joint for a link:

    platform:  force m (a - g) + epsilon x m r + omega x (omega x m r),
               moment about O1  m r x (a - g) + I epsilon + omega x I omega
    leg:       force at its platform joint B, with P = E - s s^T across the leg and l its length,
               m_u (S'' - g) - q_u s'' + P (-q_u (S'' - g) - q_d g + (I_u + I_d) s'') / l

with q = m e the first moments and I the moments of inertia across the leg. J F is the wrench of these
forces less the external wrench. No motion shows the mass of a lower link, which the base carries: its
column is 0. Axial inertia is no parameter: legs do not spin.
"""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import MechanismError
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import skew
from sixsps.singularity import SINGULAR_CONDITION

_INERTIA = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
_PLATFORM = (
    "platform.mass",
    *(f"platform.first_moment.{axis}" for axis in "xyz"),
    *(f"platform.inertia_at_o1.{entry}" for entry in _INERTIA),
)
_LINK = ("mass", "first_moment", "inertia_at_joint")
_LEG = tuple(f"{half}.{field}" for half in ("lower", "upper") for field in _LINK)
_LEGS = tuple(f"legs.{leg}.{name}" for leg in range(6) for name in _LEG)

INERTIAL_PARAMETERS: tuple[str, ...] = (*_PLATFORM, *_LEGS)
"""Names of the 46 inertial parameters, in order: mass [kg], first moment [kg m], inertia [kg m^2].

The platform's are in platform axes about O1; inertia.xy is the entry of the matrix, as in a mechanism file.
A link's first moment is mass times com, its inertia that across the leg about its own joint.
"""

SHARED_LEG_PARAMETERS: tuple[str, ...] = (*_PLATFORM, *(f"legs.{name}" for name in _LEG))
"""Names of the 16 inertial parameters of a hexapod whose six legs are alike."""


def inertial_parameters(mechanism: Mechanism, *, shared_legs: bool = False) -> Array:
    """Returns the inertial parameters of a mechanism, SI units.

    Args:
        mechanism: inertia.
        shared_legs: in the order of `SHARED_LEG_PARAMETERS` instead of `INERTIAL_PARAMETERS`.

    Returns:
        (46,), or (16,) with shared legs.

    Raises:
        MechanismError: the legs are to be shared and have different inertia.
    """
    mass, r = mechanism.platform.mass, mechanism.platform.com
    inertia = mechanism.platform.inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))
    platform = np.concatenate([[mass], mass * r, [inertia[entry] for entry in _INERTIA.values()]])
    halves = mechanism.lower, mechanism.upper
    legs = np.concatenate([[k.mass, k.mass * k.com, k.transverse + k.mass * k.com**2] for k in halves]).T
    if not shared_legs:
        return np.concatenate([platform, legs.ravel()])
    if np.any(legs != legs[0]):
        raise MechanismError("legs", "six legs of different inertia", "six legs that share their inertia")
    return np.concatenate([platform, legs[0]])


def regressor(mechanism: Mechanism, motion: Motion, *, shared_legs: bool = False) -> Array:
    """Returns the matrices that map inertial parameters to leg forces, without an external wrench.

    Args:
        mechanism: anchors and gravity; no mass, centre of mass or inertia is read.
        motion: n samples; the external wrench is not read.
        shared_legs: for `SHARED_LEG_PARAMETERS` instead of `INERTIAL_PARAMETERS`.

    Returns:
        (n, 6, 46), or (n, 6, 16) with shared legs; NaN at singular poses.
    """
    legs = inverse_kinematics(mechanism, motion)
    platform = _platform_wrenches(mechanism, motion)
    links = _leg_wrenches(mechanism, legs)  # (n, 6 rows, 6 legs, 6 parameters)
    links = links.sum(axis=2) if shared_legs else links.reshape(len(motion), 6, 36)
    return _leg_forces(legs, np.concatenate([platform, links], axis=2), mechanism.characteristic_length)


def wrench_forces(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns the leg forces that balance the external wrench: forces without inertia and weight.

    Args:
        mechanism: anchors, and platform.com as the point where the external force acts. That is
            geometry of the load here, so that forces stay linear in the parameters: it is not what
            is identified. Where the load is known to act at another point p of the platform,
            give a mechanism with platform.com = p.
        motion: n samples.

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN at singular poses.
    """
    legs = inverse_kinematics(mechanism, motion)
    arm = motion.rotation @ mechanism.platform.com
    wrench = np.hstack([motion.force, motion.moment + np.cross(arm, motion.force)])
    return -_leg_forces(legs, wrench[..., None], mechanism.characteristic_length)[..., 0]


def _leg_forces(legs: LegKinematics, wrenches: Array, length: float) -> Array:
    """Returns (n, 6, p) the forces that solve J F = C for (n, 6, p) wrenches; NaN at singular poses."""
    forces = np.full(wrenches.shape, np.nan)
    regular = legs.condition <= SINGULAR_CONDITION
    # Moments over a length of the mechanism: its unit must not decide what rounding does.
    scale = np.repeat([1.0, length], 3)[:, None]
    J = np.swapaxes(legs.jacobian, 1, 2)
    forces[regular] = np.linalg.solve(J[regular] / scale, wrenches[regular] / scale)
    return forces


def _platform_wrenches(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns (n, 6, 10): force and moment about O1 by parameter of the platform."""
    R, turned = motion.rotation, np.swapaxes(motion.rotation, 1, 2)
    omega, epsilon = motion.angular_velocity, motion.angular_acceleration
    a = motion.acceleration - mechanism.gravity
    body_omega, body_epsilon = (np.einsum("nij,nj->ni", turned, vector) for vector in (omega, epsilon))
    spin = _inertia_times(body_epsilon) + skew(body_omega) @ _inertia_times(body_omega)
    wrenches = np.zeros((len(motion), 6, 10))
    wrenches[:, :3, 0] = a
    wrenches[:, :3, 1:4] = (skew(epsilon) + skew(omega) @ skew(omega)) @ R
    wrenches[:, 3:, 1:4] = -skew(a) @ R
    wrenches[:, 3:, 4:] = R @ spin
    return wrenches


def _inertia_times(vectors: Array) -> Array:
    """Returns (n, 3, 6) that map xx, yy, zz, xy, xz, yz of an inertia I to I times the vectors (n, 3)."""
    x, y, z = vectors.T
    o = np.zeros_like(x)
    return np.moveaxis(np.array([[x, o, o, y, z, o], [o, y, o, x, o, z], [o, o, z, o, x, y]]), 2, 0)


def _leg_wrenches(mechanism: Mechanism, legs: LegKinematics) -> Array:
    """Returns (n, 6, 6, 6): force and moment about O1 of every leg, by its six parameters."""
    s, l, g = legs.directions, legs.lengths[..., None], mechanism.gravity  # noqa: E741  the paper's letter
    across = np.cross(legs.leg_angular_acceleration, s)
    dds = across - np.sum(legs.leg_angular_velocity**2, axis=-1, keepdims=True) * s
    load = legs.anchor_acceleration - g
    P = np.eye(3) - s[..., :, None] * s[..., None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        turning, hanging, tipping = across / l, -P @ g / l, -np.einsum("nkij,nkj->nki", P, load) / l - dds
    forces = np.stack([np.zeros_like(s), hanging, turning, load, tipping, turning], axis=-1)
    moments = np.cross(legs.arms[..., None], forces, axis=2)
    return np.moveaxis(np.concatenate([forces, moments], axis=2), 1, 2)
