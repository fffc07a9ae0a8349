"""Derivatives of recorded poses: twist and acceleration where a motion does not give them.

Positions are smoothed as they are. Orientations are smoothed on the unit quaternions, the double
cover of SO(3): a smoothing spline through the sign-continuous quaternions in R^4, brought back to
the sphere by normalising and differentiated there. Turning the world or the platform frame is a
linear isometry of R^4, so the estimate does not depend on either, has no singular orientation and
no limit on how far the platform turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import MotionError
from sixsps.motion import Motion
from sixsps.smoothing import FEWEST_SAMPLES, fit

_DERIVATIVES = ("velocity", "angular_velocity", "acceleration", "angular_acceleration")


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Estimated derivatives of poses, world axes.

    Attributes:
        velocity: (n, 3) [m/s].
        angular_velocity: (n, 3) [rad/s].
        acceleration: (n, 3) [m/s^2].
        angular_acceleration: (n, 3) [rad/s^2].
        position_cutoff, rotation_cutoff: corner frequencies of the smoothing [Hz].
        position_noise: RMS distance of a coordinate from its spline [m].
        rotation_noise: RMS angle between given and smoothed orientation [rad].
    """

    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array
    position_cutoff: float
    rotation_cutoff: float
    position_noise: float
    rotation_noise: float


def differentiate(
    time: Array, position: Array, quaternion: Array, cutoff: float | None = None
) -> Derivatives:
    """Estimates twist and acceleration of a recorded motion.

    Args:
        time: (n,) strictly increasing, n >= 6 [s].
        position: (n, 3) [m].
        quaternion: (n, 4) w, x, y, z, either sign.
        cutoff: corner frequency of the smoothing [Hz]; chosen from the data by default.

    Raises:
        MotionError: fewer than six samples, or a cutoff that they cannot resolve.
    """
    if len(time) < FEWEST_SAMPLES:
        allowed = f"at least {FEWEST_SAMPLES} samples, or twist and acceleration columns"
        raise MotionError("rows", f"{len(time)} samples without derivatives", allowed)
    translation = fit(time, position, cutoff)
    continuous = _sign_continuous(quaternion)
    turning = fit(time, continuous, cutoff)
    curve = [turning(time, order) for order in range(3)]
    unit, omega, epsilon = _angular_motion(*curve)
    chord = np.linalg.norm(unit - continuous, axis=1)
    deviation = 4 * np.arcsin(np.minimum(chord / 2, 1))
    return Derivatives(
        translation(time, 1),
        omega,
        translation(time, 2),
        epsilon,
        translation.cutoff,
        turning.cutoff,
        translation.noise,
        float(np.sqrt(np.mean(deviation**2))),
    )


def complete(arrays: dict[str, Array], cutoff: float | None, name: str) -> Motion:
    """Returns the motion of `arrays`, derivatives that are missing estimated from its poses.

    Args:
        arrays: fields of `Motion` by name; time and position at least.
        cutoff: corner frequency of the smoothing [Hz]; chosen from the data when None.
        name: of the motion.

    Raises:
        MotionError: as `Motion`, or too few samples to differentiate.
    """
    if cutoff is not None and not (np.isfinite(cutoff) and cutoff > 0):
        raise MotionError("cutoff", cutoff, "a finite frequency > 0 [Hz]")
    missing = [field for field in _DERIVATIVES if field not in arrays]
    estimated: dict[str, str] = {}
    if cutoff is not None and not missing:
        raise MotionError("cutoff", cutoff, "none where twist and acceleration are given")
    if missing:
        time, position = arrays["time"], arrays["position"]
        still = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))
        quaternion = arrays.get("quaternion", still)
        _check_poses(time, position, quaternion)
        found = differentiate(time, position, quaternion, cutoff)
        arrays = arrays | {field: getattr(found, field) for field in missing}
        chosen = "chosen from the data" if cutoff is None else "set"
        translation = (
            f"quintic smoothing spline, cutoff {found.position_cutoff:.3g} Hz ({chosen}), "
            f"residual {found.position_noise:.2g} m RMS"
        )
        turning = (
            f"quintic smoothing spline on unit quaternions, cutoff {found.rotation_cutoff:.3g} Hz "
            f"({chosen}), residual {found.rotation_noise:.2g} rad RMS"
        )
        estimated = {field: turning if "angular" in field else translation for field in missing}
    return Motion(**arrays, name=name, estimated=estimated)  # type: ignore[arg-type]


def _check_poses(time: Array, position: Array, quaternion: Array) -> None:
    rest = np.zeros(np.shape(position))
    Motion(
        time=time,
        position=position,
        quaternion=quaternion,
        velocity=rest,
        angular_velocity=rest,
        acceleration=rest,
        angular_acceleration=rest,
    )


def _sign_continuous(quaternion: Array) -> Array:
    unit = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    turned = np.sum(unit[1:] * unit[:-1], axis=1) < 0
    signs = np.cumprod(np.where(np.r_[False, turned], -1.0, 1.0))
    return unit * signs[:, None]


def _angular_motion(q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
    """Returns the curve q / |q|, and angular velocity and acceleration along it, world axes.

    From u' = (0, omega) u / 2 follows (0, omega) = 2 u' u*, whose vector part does not change when
    u is replaced by q / |q|: with w = Im(q' q*) / |q|^2, omega = 2 w and epsilon = 2 w'.
    """
    squared = np.sum(q * q, axis=1, keepdims=True)
    omega = 2 * _vector_of_product(dq, q) / squared
    stretch = 2 * np.sum(q * dq, axis=1, keepdims=True) / squared
    epsilon = 2 * _vector_of_product(ddq, q) / squared - stretch * omega
    return q / np.sqrt(squared), omega, epsilon


def _vector_of_product(a: Array, b: Array) -> Array:
    """Returns the vector part of the quaternion product of a and the conjugate of b."""
    return b[:, :1] * a[:, 1:] - a[:, :1] * b[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
