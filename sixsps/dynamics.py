"""Dynamics of the platform with all its legs: mass matrix, bias, forward dynamics and energy.

    M [a; epsilon] + bias = J F + W,    W = [force; moment + (R com) x force]

Wrenches are taken about O1, accelerations are those of O1, world axes; J maps leg forces to wrenches.
Force and moment of the external wrench act on the platform's centre of mass. M and bias project the
inertia of all thirteen bodies by the partial velocities of Kane's method.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.formulations.kane import PartialVelocities, actuator_wrench, partial_velocities
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import cross
from sixsps.singularity import SINGULAR_CONDITION


@dataclass(frozen=True, eq=False)
class State:
    """States of the platform, world axes.

    Attributes:
        position: (n, 3) of O1 [m].
        quaternion: (n, 4) w, x, y, z; of any length but zero.
        velocity: (n, 3) of O1 [m/s].
        angular_velocity: (n, 3) [rad/s].
    """

    position: Array
    quaternion: Array
    velocity: Array
    angular_velocity: Array

    @classmethod
    def of(cls, motion: Motion) -> State:
        """Returns the states along a motion."""
        return cls(motion.position, motion.quaternion, motion.velocity, motion.angular_velocity)

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def rotation(self) -> Array:
        """(n, 3, 3) platform axes to world axes."""
        from scipy.spatial.transform import Rotation

        if len(self) == 0:
            return np.empty((0, 3, 3))
        return Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix()

    def unaccelerated(self) -> Motion:
        """Returns the motion through these states with no acceleration and no wrench, times 0, 1, ..."""
        zero = np.zeros((len(self), 3))
        return Motion(
            time=np.arange(len(self), dtype=np.float64),
            position=self.position,
            quaternion=self.quaternion / np.linalg.norm(self.quaternion, axis=1, keepdims=True),
            velocity=self.velocity,
            angular_velocity=self.angular_velocity,
            acceleration=zero,
            angular_acceleration=zero,
        )


def mass_matrix(mechanism: Mechanism, position: Array, rotation: Array) -> Array:
    """Returns M, which maps [a; epsilon] of the platform to the wrench about O1 that all bodies need.

    Args:
        mechanism: geometry and inertia.
        position: (n, 3) of O1 [m].
        rotation: (n, 3, 3) platform axes to world axes.

    Returns:
        (n, 6, 6) symmetric positive definite, world axes; NaN where a leg has no length.
    """
    motion = _at_rest(position, rotation)
    legs = inverse_kinematics(mechanism, motion)
    matrix = _mass_matrix(mechanism, motion, partial_velocities(mechanism, motion, legs))
    matrix[_without_direction(mechanism, legs)] = np.nan
    return matrix


def bias(mechanism: Mechanism, state: State) -> Array:
    """Returns the wrench about O1 that is needed at zero acceleration and without external wrench.

    Args:
        mechanism: geometry and inertia.
        state: n states.

    Returns:
        (n, 6) velocity and gravity terms, force [N] and moment [N m], world axes; NaN where a leg has
        no length.
    """
    motion = state.unaccelerated()
    legs = inverse_kinematics(mechanism, motion)
    wrench = actuator_wrench(mechanism, motion, legs)
    wrench[_without_direction(mechanism, legs)] = np.nan
    return wrench


def forward_dynamics(mechanism: Mechanism, state: State, forces: Array, force: Array, moment: Array) -> Array:
    """Returns the accelerations that leg forces and an external wrench cause.

    Args:
        mechanism: geometry and inertia.
        state: n states.
        forces: (n, 6) leg forces [N], positive in extension.
        force: (n, 3) external force on the platform's centre of mass [N].
        moment: (n, 3) external moment on the platform [N m].

    Returns:
        (n, 6) acceleration of O1 [m/s^2] and angular acceleration [rad/s^2], world axes; NaN where
        a leg has no length. Leg forces have accelerations at singular poses too.
    """
    motion = state.unaccelerated()
    legs = inverse_kinematics(mechanism, motion)
    partial = partial_velocities(mechanism, motion, legs)
    arm = motion.rotation @ mechanism.platform.com
    wrench = np.hstack([force, moment + cross(arm, force)]) + np.einsum("nij,ni->nj", legs.jacobian, forces)
    wrench = wrench - actuator_wrench(mechanism, motion, legs, partial)
    # Angles times a length of the mechanism: its unit must not decide what rounding does.
    scale = np.repeat([1.0, 1 / mechanism.characteristic_length], 3)
    matrix = scale[:, None] * _mass_matrix(mechanism, motion, partial) * scale
    accelerations = np.full(wrench.shape, np.nan)
    regular = ~_without_direction(mechanism, legs)
    solved = np.linalg.solve(matrix[regular], (scale * wrench[regular])[..., None])
    accelerations[regular] = scale * solved[..., 0]
    return accelerations


def kinetic_energy(mechanism: Mechanism, state: State) -> Array:
    """Returns (n,) the kinetic energy of all thirteen bodies [J]."""
    twist = np.hstack([state.velocity, state.angular_velocity])
    matrix = mass_matrix(mechanism, state.position, state.rotation)
    return np.einsum("ni,nij,nj->n", twist, matrix, twist) / 2


def potential_energy(mechanism: Mechanism, position: Array, rotation: Array) -> Array:
    """Returns (n,) the potential energy of all thirteen bodies, zero at the world's origin [J].

    NaN where a leg has no length.

    Args:
        mechanism: geometry and inertia.
        position: (n, 3) of O1 [m].
        rotation: (n, 3, 3) platform axes to world axes.
    """
    legs = inverse_kinematics(mechanism, _at_rest(position, rotation))
    lower, upper, platform = mechanism.lower, mechanism.upper, mechanism.platform
    s, joint = legs.directions, mechanism.base_anchors + legs.leg_vectors
    moment = platform.mass * (position + rotation @ platform.com)
    moment = moment + np.einsum("k,nki->ni", lower.mass, mechanism.base_anchors + lower.com[:, None] * s)
    moment = moment + np.einsum("k,nki->ni", upper.mass, joint - upper.com[:, None] * s)
    energy = -moment @ mechanism.gravity
    energy[_without_direction(mechanism, legs)] = np.nan
    return energy


def _without_direction(mechanism: Mechanism, legs: LegKinematics) -> NDArray[np.bool_]:
    """Returns (n,) whether a leg has no length but for rounding, and with it no direction."""
    shortest = legs.lengths.min(axis=1)
    return ~(shortest > mechanism.characteristic_length / SINGULAR_CONDITION)


def _mass_matrix(mechanism: Mechanism, motion: Motion, partial: PartialVelocities) -> Array:
    lower, upper, platform = mechanism.lower, mechanism.upper, mechanism.platform
    # Across the leg axis, where all of its angular velocity lies, a leg has one moment of inertia.
    turning = lower.transverse + upper.transverse
    matrix = platform.mass * np.swapaxes(partial.platform, 1, 2) @ partial.platform
    for inertia, velocities in (
        (lower.mass, partial.lower),
        (upper.mass, partial.upper),
        (turning, partial.leg),
    ):
        matrix = matrix + np.einsum("k,nkij,nkil->njl", inertia, velocities, velocities)
    matrix[:, 3:, 3:] += motion.rotation @ platform.inertia @ np.swapaxes(motion.rotation, 1, 2)
    return (matrix + np.swapaxes(matrix, 1, 2)) / 2


def _at_rest(position: Array, rotation: Array) -> Motion:
    from scipy.spatial.transform import Rotation

    zero = np.zeros((len(position), 3))
    quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    return State(position, quaternion, zero, zero).unaccelerated()
