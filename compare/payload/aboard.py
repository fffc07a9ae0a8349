"""Mechanism and motion with a payload, as engines are given them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from compare.payload.ride import Ride
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


@dataclass(frozen=True, eq=False)
class Aboard:
    """What a payload makes of a mechanism and its motion.

    Attributes:
        mechanism: with a rigid payload as part of its platform.
        motion: its external wrench acts at that platform's centre of mass and includes what a robot
            exerts.
        facts: entry `payload` of the results.
        ride: of a robot, for engines that take it as it is.
    """

    mechanism: Mechanism
    motion: Motion
    facts: dict[str, Any] | None = None
    ride: Ride | None = None
