"""Where the base of a robot is fixed to the platform, and how it moves there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sixsps.arrays import LARGEST, Array, frozen
from sixsps.errors import InputError
from sixsps.motion import Motion


@dataclass(frozen=True, eq=False)
class Mount:
    """Pose of the robot's base frame, its URDF's root link, in the platform frame.

    Attributes:
        position: (3,) of its origin from O1 [m].
        rotation: (3, 3) base axes to platform axes.
    """

    position: Array
    rotation: Array

    @classmethod
    def at(cls, x: float = 0, y: float = 0, z: float = 0, *angles: float) -> Mount:
        """Returns a mount as in the `origin` of a URDF joint.

        Args:
            x: position [m].
            y: position [m].
            z: position [m].
            angles: roll, pitch, yaw about the platform's axes [rad], in this order; 0 by default.
        """
        roll, pitch, yaw = angles or (0.0, 0.0, 0.0)
        rotation = _turn(2, yaw) @ _turn(1, pitch) @ _turn(0, roll)
        position = frozen([x, y, z], (3,), "mount", InputError)
        return cls(position, frozen(rotation, (3, 3), "mount", InputError))

    @classmethod
    def parse(cls, text: str) -> Mount:
        """Returns the mount that the text x,y,z or x,y,z,roll,pitch,yaw gives.

        Raises:
            InputError: it does not.
        """
        try:
            numbers = [float(part) for part in text.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (3, 6) or not all(abs(number) <= LARGEST for number in numbers):
            raise InputError("--payload-mount", text, "x,y,z or x,y,z,roll,pitch,yaw [m, rad]")
        return cls.at(*numbers)


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Motion of the base frame, world axes; quantities as in `Motion`, of the frame's origin."""

    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array


def base_motion(platform: Motion, mount: Mount) -> BaseMotion:
    """Returns how the base moves: a fixed point and fixed axes of the platform."""
    omega, epsilon = platform.angular_velocity, platform.angular_acceleration
    arm = platform.rotation @ mount.position
    swing = np.cross(omega, arm)
    return BaseMotion(
        platform.position + arm,
        platform.rotation @ mount.rotation,
        platform.velocity + swing,
        omega,
        platform.acceleration + np.cross(epsilon, arm) + np.cross(omega, swing),
        epsilon,
    )


def _turn(axis: int, angle: float) -> Array:
    """Returns the rotation by an angle [rad] about a coordinate axis."""
    cosine, sine = math.cos(angle), math.sin(angle)
    rotation = np.eye(3)
    after, last = (axis + 1) % 3, (axis + 2) % 3
    rotation[[after, after, last, last], [after, last, after, last]] = cosine, -sine, sine, cosine
    return rotation
