"""Newton-Euler: every body in balance of force and moment, the forces in the joints included.

The order of the balances is that of B. Dasgupta & T. S. Mruthyunjaya, "A Newton-Euler formulation
for the inverse dynamics of the Stewart platform manipulator", Mech. Mach. Theory 33 (1998)
1135-1152: moments of a whole leg about its base joint give the force at its platform joint across
the leg, the upper link's balance along the leg ties the rest to the actuator, and the platform's
balances are six equations for what is left. Derived here anew, for ball joints without friction:

    leg about A:        S x b = s x h,                 so  b across s = (h - (s.h) s) / l,
    upper link along s: F + s.b + m_u s.g = m_u s.a_u,
    leg:                a + b + (m_d + m_u) g = m_d a_d + m_u a_u,
    platform about O1:  -sum [b; c x b] + load and weight = rate of momentum,

with a and b the forces on the leg at A and B, and s x h the rate of its moment of momentum about A
less the moment of its weight. Leg kinematics by differentiating S = l s, without angular velocities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# Some kilobytes a sample are needed while it works; blocks keep that in the cache.
_BLOCK = 1024


@dataclass(frozen=True, eq=False)
class JointReactions:
    """Forces in the actuators and the twelve ball joints; NaN at singular poses.

    A reaction is the force that the joint exerts on the leg, at either end; base and platform
    receive the opposite. World axes. Ball joints without friction transmit no moment.

    Attributes:
        forces: (n, 6) leg forces [N], positive in extension.
        base: (n, 6, 3) force of the base joints A_i on the legs [N].
        platform: (n, 6, 3) force of the platform joints B_i on the legs [N].
    """

    forces: Array
    base: Array
    platform: Array


def inverse_dynamics(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns the leg forces along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN at singular poses.
    """
    return _actuator_forces(mechanism, motion, _legs(mechanism, motion))


def joint_reactions(
    mechanism: Mechanism, motion: Motion, progress: Callable[[int], None] = lambda _done: None
) -> JointReactions:
    """Returns the leg forces and the forces in all twelve ball joints along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        progress: called with the number of samples done so far.
    """
    n = len(motion)
    reactions = JointReactions(np.empty((n, 6)), np.empty((n, 6, 3)), np.empty((n, 6, 3)))
    for start in range(0, n, _BLOCK):
        block = slice(start, start + _BLOCK)
        legs = _legs(mechanism, motion[block])
        F = _actuator_forces(mechanism, motion[block], legs)
        b = legs.passive - F[..., None] * legs.directions
        reactions.forces[block], reactions.platform[block] = F, b
        reactions.base[block] = legs.needed - b
        progress(min(start + _BLOCK, n))
    return reactions


@dataclass(frozen=True, eq=False)
class _Legs:
    """The legs before the actuators push; all vectors in world axes.

    Attributes:
        arms: (n, 6, 3) c_i, O1 to platform joint [m].
        directions: (n, 6, 3) unit vectors s_i.
        lengths: (n, 6) [m].
        needed: (n, 6, 3) force that leg motion takes besides the weight, of both joints together [N].
        passive: (n, 6, 3) force on the leg at B_i, were the actuator force zero [N].
    """

    arms: Array
    directions: Array
    lengths: Array
    needed: Array
    passive: Array


def _legs(mechanism: Mechanism, motion: Motion) -> _Legs:
    """Returns the balances of the legs; entries of a leg of zero length are NaN."""
    c = np.einsum("nij,kj->nki", motion.rotation, mechanism.platform_anchors)
    # In this order a world frame far away costs no digits of c.
    S = (motion.position[:, None] - mechanism.base_anchors) + c
    dS = motion.velocity[:, None] + np.cross(motion.angular_velocity[:, None], c)
    ddS = _acceleration(motion, c)
    with np.errstate(invalid="ignore", divide="ignore"):
        l = np.sqrt(_dot(S, S))  # noqa: E741  the letter of the equations
        s = S / l
        # From |S|^2 = l^2 and S = l s, each differentiated twice.
        dl = _dot(s, dS)
        ddl = (_dot(dS, dS) - dl**2 + _dot(S, ddS)) / l
        ds = (dS - dl * s) / l
        dds = (ddS - ddl * s - 2 * dl * ds) / l
        e_d, e_u = mechanism.lower.com[:, None], mechanism.upper.com[:, None]
        lower = mechanism.lower.mass[:, None] * (e_d * dds - mechanism.gravity)
        upper = mechanism.upper.mass[:, None] * (ddS - e_u * dds - mechanism.gravity)
        # Symmetric about s and without spin, both links have the moment of momentum I_t s x s'.
        I_t = (mechanism.lower.transverse + mechanism.upper.transverse)[:, None]
        h = I_t * dds + e_d * lower + (l - e_u) * upper
        passive = (h - _dot(s, h) * s) / l + _dot(s, upper) * s
    return _Legs(c, s, l[..., 0], lower + upper, passive)


def _actuator_forces(mechanism: Mechanism, motion: Motion, legs: _Legs) -> Array:
    """Solves the platform's six balances for the actuator forces, by LU with partial pivoting.

    Moments are taken in units of the mechanism's characteristic length, so that pivots compare.
    """
    c, s, size = legs.arms, legs.directions, mechanism.characteristic_length
    columns = np.concatenate([s, np.cross(c, s)], axis=-1)
    condition = condition_numbers(columns, legs.lengths, size)
    force, moment = _platform_needs(mechanism, motion)
    force = force + legs.passive.sum(axis=1)
    moment = moment + np.cross(c, legs.passive).sum(axis=1)
    regular = condition <= SINGULAR_CONDITION
    units = np.repeat([1.0, size], 3)
    matrix = np.swapaxes(columns[regular] / units, 1, 2)
    right = np.concatenate([force, moment], axis=-1)[regular] / units
    forces = np.full((len(motion), 6), np.nan)
    forces[regular] = np.linalg.solve(matrix, right[..., None])[..., 0]
    return forces


def _platform_needs(mechanism: Mechanism, motion: Motion) -> tuple[Array, Array]:
    """Returns force [N] and moment about O1 [N m], (n, 3) each, that the six legs have to exert on it."""
    R, platform = motion.rotation, mechanism.platform
    r = R @ platform.com
    acceleration = _acceleration(motion, r[:, None])[:, 0]
    force = platform.mass * (acceleration - mechanism.gravity) - motion.force
    # Euler's equations, in platform axes where the inertia is constant.
    omega, epsilon = (
        np.einsum("nji,nj->ni", R, vector)
        for vector in (motion.angular_velocity, motion.angular_acceleration)
    )
    moment = epsilon @ platform.inertia + np.cross(omega, omega @ platform.inertia)
    return force, np.einsum("nij,nj->ni", R, moment) - motion.moment + np.cross(r, force)


def _acceleration(motion: Motion, arms: Array) -> Array:
    """Returns the (n, k, 3) accelerations of platform points at `arms` (n, k, 3) from O1, world axes."""
    omega, epsilon = motion.angular_velocity[:, None], motion.angular_acceleration[:, None]
    centripetal = _dot(omega, arms) * omega - _dot(omega, omega) * arms
    return motion.acceleration[:, None] + np.cross(epsilon, arms) + centripetal


def _dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1, keepdims=True)
