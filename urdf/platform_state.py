"""Pose, twist and acceleration of the platform at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arrays import Array
from sixsps.motion import Motion
from sixsps.pose import Pose


@dataclass(frozen=True, eq=False)
class PlatformState:
    """One instant of a motion of the platform, world axes; also a pose for whatever takes poses.

    Attributes:
        position: (3,) platform origin O1 [m].
        quaternion: (4,) orientation w, x, y, z, of unit length.
        velocity: (3,) of O1 [m/s].
        angular_velocity: (3,) [rad/s].
        acceleration: (3,) of O1 [m/s^2].
        angular_acceleration: (3,) [rad/s^2].
    """

    position: Array
    quaternion: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    @cached_property
    def rotation(self) -> Array:
        """(3, 3) platform axes to world axes."""
        return Pose(self.position, self.quaternion).rotation

    def motion(self, force: ArrayLike = (0, 0, 0), moment: ArrayLike = (0, 0, 0)) -> Motion:
        """Returns the motion of this one sample, for the functions of sixsps.

        Args:
            force: (3,) external force on the platform's centre of mass, world axes [N].
            moment: (3,) external moment on the platform, world axes [N m].

        Raises:
            MotionError: a shape differs, or an entry is not finite.
        """
        return Motion(
            time=np.zeros(1),
            position=self.position[None],
            quaternion=self.quaternion[None],
            velocity=self.velocity[None],
            angular_velocity=self.angular_velocity[None],
            acceleration=self.acceleration[None],
            angular_acceleration=self.angular_acceleration[None],
            force=np.asarray(force)[None],
            moment=np.asarray(moment)[None],
        )
