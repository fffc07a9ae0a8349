"""Poses as close to a singularity as is asked for, and loads that a mechanism can carry there."""

import dataclasses

import numpy as np
from cases import random_motion
from scipy.spatial.transform import Rotation

import sixsps
from compare.metrics import loads
from sixsps.formulations.kane import actuator_wrench
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled


def near_singular(mechanism, condition, seed=0, samples=6):
    """Random twists, accelerations and wrenches in one pose with this condition number.

    The platform turns about a random axis until det J changes its sign; the condition number is in inverse
    proportion to the angle from there.
    """
    axis = np.random.default_rng(seed).standard_normal(3)

    def legs(*angles):
        return inverse_kinematics(mechanism, _turned(mechanism, axis, angles))

    def determinants(*angles):
        return np.linalg.det(legs(*angles).jacobian)

    grid = np.linspace(0.1, 2 * np.pi - 0.1, 400)
    signs = np.sign(determinants(*grid))
    change = np.flatnonzero(signs[1:] != signs[:-1])[0]
    low, high = grid[change], grid[change + 1]
    while low < (middle := (low + high) / 2) < high:
        a, b = determinants(low, middle)
        low, high = (middle, high) if a * b > 0 else (low, middle)
    known = 1e-5
    away = known * legs(low - known).condition[0] / condition
    pose = _turned(mechanism, axis, [low - away] * samples)
    motion = random_motion(mechanism, seed, samples=samples)
    return dataclasses.replace(motion, position=pose.position, quaternion=pose.quaternion)


def flat(mechanism, condition, samples=7):
    """The sinusoids, but with platform and base, both plane, parallel and nearly in one plane.

    The condition number, in inverse proportion to the height, is the one asked for at the first sample.
    """
    motion = bundled("sinusoids", mechanism, 7)[:samples]
    level = np.tile([1.0, 0, 0, 0], (samples, 1))

    def lowered(height):
        position = np.column_stack([motion.position[:, :2], np.full(samples, height)])
        return dataclasses.replace(motion, position=position, quaternion=level)

    known = 1e-4 * mechanism.characteristic_length
    return lowered(known * inverse_kinematics(mechanism, lowered(known)).condition[0] / condition)


def carried(mechanism, motion, seed=0):
    """The motion with a wrench that moderate leg forces balance, however close to a singularity."""
    nothing = np.zeros_like(motion.force)
    motion = dataclasses.replace(motion, force=nothing, moment=nothing)
    legs = inverse_kinematics(mechanism, motion)
    drawn = np.random.default_rng(seed).standard_normal((len(motion), 6))
    forces = loads(mechanism, motion)[:, None] * drawn
    needed = actuator_wrench(mechanism, motion, legs) - np.einsum("nij,ni->nj", legs.jacobian, forces)
    force, arm = needed[:, :3], motion.rotation @ mechanism.platform.com
    return dataclasses.replace(motion, force=force, moment=needed[:, 3:] - np.cross(arm, force))


def _turned(mechanism, axis, angles):
    """The platform at rest at home, turned about an axis."""
    unit, zero = axis / np.linalg.norm(axis), np.zeros((len(angles), 3))
    return sixsps.Motion(
        time=np.arange(len(angles)),
        position=zero + home_position(mechanism),
        quaternion=Rotation.from_rotvec(np.outer(angles, unit)).as_quat(scalar_first=True),
        velocity=zero,
        angular_velocity=zero,
        acceleration=zero,
        angular_acceleration=zero,
    )
