"""Inverse kinematics: platform pose, twist and acceleration to the motion of the legs.

Paper section 4; equations without a number are used there but never given.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import cross
from sixsps.singularity import condition_numbers


@dataclass(frozen=True, eq=False)
class LegKinematics:
    """Motion of the six legs at every sample; all vectors in world axes.

    Attributes:
        arms: (n, 6, 3) c_i = R b_i, platform origin to platform joint [m].
        leg_vectors: (n, 6, 3) S_i, base joint to platform joint [m].
        lengths: (n, 6) [m].
        directions: (n, 6, 3) unit vectors s_i.
        anchor_velocity: (n, 6, 3) of the platform joints B_i [m/s].
        anchor_acceleration: (n, 6, 3) of the platform joints B_i [m/s^2].
        length_rates: (n, 6) [m/s].
        length_accelerations: (n, 6) [m/s^2].
        leg_angular_velocity: (n, 6, 3) [rad/s]; no spin about the leg axis.
        leg_angular_acceleration: (n, 6, 3) [rad/s^2].
        direction_rates: (n, 6, 3) s_i' [1/s].
        direction_accelerations: (n, 6, 3) s_i'' [1/s^2].
        coordinates: (n,) largest coordinate that a leg vector is the difference of [m].
        mechanism: whose legs these are.
    """

    arms: Array
    leg_vectors: Array
    lengths: Array
    directions: Array
    anchor_velocity: Array
    anchor_acceleration: Array
    length_rates: Array
    length_accelerations: Array
    leg_angular_velocity: Array
    leg_angular_acceleration: Array
    direction_rates: Array
    direction_accelerations: Array
    coordinates: Array
    mechanism: Mechanism

    @cached_property
    def lower_velocity(self) -> Array:
        """(n, 6, 3) of the lower links' centres of mass [m/s]."""
        return self.mechanism.lower.com[:, None] * self.direction_rates

    @cached_property
    def lower_acceleration(self) -> Array:
        """(n, 6, 3) of the lower links' centres of mass [m/s^2]."""
        return self.mechanism.lower.com[:, None] * self.direction_accelerations

    @cached_property
    def upper_velocity(self) -> Array:
        """(n, 6, 3) of the upper links' centres of mass [m/s]."""
        return self.anchor_velocity - self.mechanism.upper.com[:, None] * self.direction_rates

    @cached_property
    def upper_acceleration(self) -> Array:
        """(n, 6, 3) of the upper links' centres of mass [m/s^2]."""
        return self.anchor_acceleration - self.mechanism.upper.com[:, None] * self.direction_accelerations

    @property
    def characteristic_length(self) -> float:
        """Length that makes `condition` independent of units [m]."""
        return self.mechanism.characteristic_length

    @cached_property
    def jacobian(self) -> Array:
        """(n, 6, 6) with length_rates = jacobian @ [velocity; angular_velocity].

        Row i is [s_i, c_i x s_i]; its transpose is J of eq. 31, leg forces to wrench about O1.
        """
        return np.concatenate([self.directions, cross(self.arms, self.directions)], axis=-1)

    @cached_property
    def condition(self) -> Array:
        """(n,) condition number of the Jacobian, angular columns over the characteristic length."""
        return condition_numbers(self.jacobian, self.lengths, self.characteristic_length)

    @cached_property
    def error_growth(self) -> Array:
        """(n,) what unit roundoff is multiplied by on its way to the forces, up to a small factor.

        Rounding of coordinates, relative to the shortest leg, times the condition number of the solve.
        """
        return self.condition * (1 + self.coordinates / self.lengths.min(axis=1))


def inverse_kinematics(mechanism: Mechanism, motion: Motion) -> LegKinematics:
    """Returns the motion of the legs that a motion of the platform imposes (paper section 4).

    Args:
        mechanism: geometry; its links only for the motion of their centres of mass.
        motion: n samples.

    Returns:
        Leg kinematics; entries of a leg of zero length are NaN.
    """
    omega = motion.angular_velocity[:, None]
    epsilon = motion.angular_acceleration[:, None]
    c = np.einsum("nij,kj->nki", motion.rotation, mechanism.platform_anchors)
    # In this order a world frame far away costs no digits of c.
    S = (motion.position[:, None] - mechanism.base_anchors) + c
    turning = cross(omega, c)
    dS = motion.velocity[:, None] + turning
    ddS = motion.acceleration[:, None] + cross(epsilon, c) + cross(omega, turning)
    with np.errstate(invalid="ignore", divide="ignore"):
        l = np.linalg.norm(S, axis=-1, keepdims=True)  # noqa: E741  the paper's letter
        s = S / l
        dl = _dot(s, dS)
        omega_l = cross(s, dS) / l  # eq. 5: no component along s
        epsilon_l = (cross(s, ddS) - 2 * dl * omega_l) / l
        omega_squared = _dot(omega_l, omega_l)
    ds = cross(omega_l, s)
    dds = cross(epsilon_l, s) - omega_squared * s
    return LegKinematics(
        arms=c,
        leg_vectors=S,
        lengths=l[..., 0],
        directions=s,
        anchor_velocity=dS,
        anchor_acceleration=ddS,
        length_rates=dl[..., 0],
        length_accelerations=(_dot(s, ddS) + l * omega_squared)[..., 0],
        leg_angular_velocity=omega_l,
        leg_angular_acceleration=epsilon_l,
        direction_rates=ds,
        direction_accelerations=dds,
        coordinates=np.maximum(np.abs(motion.position).max(axis=1), np.abs(mechanism.base_anchors).max()),
        mechanism=mechanism,
    )


def _dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1, keepdims=True)
