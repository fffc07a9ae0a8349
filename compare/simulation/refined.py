"""A motion at more times than it was sampled at, its rates those of its poses everywhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from compare.simulation.plan import spline
from sixsps.arrays import Array
from sixsps.motion import Motion
from sixsps.rotation import quaternion_rates


def refined(motion: Motion, longest: float) -> Motion:
    """Returns a motion with equal steps put between samples that are too far apart.

    Positions and quaternions follow the splines of degree 5 that have the samples' values, rates and
    accelerations; twist and acceleration are their derivatives. The wrench follows a spline of degree 5.

    Args:
        motion: n >= 2 samples, the rates of which are those of its poses.
        longest: time between two samples of the result [s].
    """
    parts = np.ceil(np.diff(motion.time) / longest * (1 - 1e-9)).astype(int)
    if parts.max() <= 1:
        return motion
    ends = zip(motion.time[:-1], motion.time[1:], parts, strict=True)
    time = np.concatenate([np.linspace(a, b, m, endpoint=False) for a, b, m in ends] + [motion.time[-1:]])
    p, v, a = _curve(motion.time, motion.position, motion.velocity, motion.acceleration)(time)
    q, dq, ddq = _curve(motion.time, *_quaternions(motion))(time)
    square = np.einsum("ni,ni->n", q, q)[:, None]
    omega = 2 * _vector(dq, q) / square
    epsilon = 2 * (_vector(ddq, q) - omega * np.einsum("ni,ni->n", q, dq)[:, None]) / square
    wrench = spline(motion.time, np.hstack([motion.force, motion.moment]))(time)
    return replace(
        motion,
        time=time,
        position=p,
        quaternion=q / np.sqrt(square),
        velocity=v,
        angular_velocity=omega,
        acceleration=a,
        angular_acceleration=epsilon,
        force=wrench[:, :3],
        moment=wrench[:, 3:],
    )


def _quaternions(motion: Motion) -> tuple[Array, Array, Array]:
    """Returns quaternions (n, 4) without jumps of sign, their first and second time derivatives."""
    q = motion.quaternion / np.linalg.norm(motion.quaternion, axis=1, keepdims=True)
    flips = np.where(np.einsum("ni,ni->n", q[1:], q[:-1]) < 0, -1.0, 1.0)
    q = q * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    dq = quaternion_rates(q, motion.angular_velocity)
    ddq = quaternion_rates(q, motion.angular_acceleration) + quaternion_rates(dq, motion.angular_velocity)
    return q, dq, ddq


def _vector(first: Array, second: Array) -> Array:
    """Returns the vector part (n, 3) of first times second's conjugate, quaternions (n, 4)."""
    cross = np.cross(first[:, 1:], second[:, 1:])
    return second[:, :1] * first[:, 1:] - first[:, :1] * second[:, 1:] - cross


def _curve(time: Array, y: Array, dy: Array, ddy: Array) -> Any:
    """Returns the spline of degree 5 with these values and derivatives (n, k), and with it its own two."""
    from scipy.interpolate import BPoly

    curve = BPoly.from_derivatives(time, np.stack([y, dy, ddy], axis=1))
    derivatives = (curve, curve.derivative(1), curve.derivative(2))
    return lambda t: [each(t) for each in derivatives]
