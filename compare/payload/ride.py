"""A robot on the platform of a hexapod, and both in motion: plain data, which can go to other processes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from compare.payload.catalogue import Robot
from compare.payload.mount import Mount
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of a robot's k joints at n samples.

    Attributes:
        position: (n, k) [rad], of sliding joints [m].
        velocity: (n, k) [rad/s, m/s].
        acceleration: (n, k) [rad/s^2, m/s^2].
        name: what to call it in reports.
        estimated: how velocities or accelerations were estimated; empty when they were given.
        warnings: what a reader has to know of how positions were read.
    """

    position: Array
    velocity: Array
    acceleration: Array
    name: str = "joint motion"
    estimated: str = ""
    warnings: tuple[str, ...] = ()

    def __getitem__(self, samples: slice | NDArray[np.bool_] | NDArray[np.intp]) -> JointMotion:
        parts = {name: getattr(self, name)[samples] for name in ("position", "velocity", "acceleration")}
        return replace(self, **parts)


@dataclass(frozen=True, eq=False)
class Carrier:
    """A hexapod with a robot whose base is fixed to its platform."""

    mechanism: Mechanism
    robot: Robot
    mount: Mount


@dataclass(frozen=True, eq=False)
class Ride:
    """A robot's ride at n samples.

    Attributes:
        carrier: hexapod and robot.
        platform: motion of the platform, with the external wrench on it but not the robot's.
        joints: motion of the robot's joints at the same samples.
    """

    carrier: Carrier
    platform: Motion
    joints: JointMotion

    def __len__(self) -> int:
        return len(self.platform)

    def __getitem__(self, samples: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Ride:
        return Ride(self.carrier, self.platform[samples], self.joints[samples])
