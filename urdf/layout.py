"""Where the bodies stand when all coordinates are zero, and how large they are drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import printable
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from urdf.names import comment

# Radii of what is drawn, relative to the length of the link; on wu2012 they are the true ones.
LOWER_RADIUS = 2 / 45
UPPER_RADIUS = 1.2 / 45
_DISC_THICKNESS = 0.08


@dataclass(frozen=True)
class LegLayout:
    """Pose of one leg at home: its frame has z along the leg and no roll.

    Attributes:
        pitch: about y, then
        yaw: about z [rad].
        length: A to B at home [m].
    """

    pitch: float
    yaw: float
    length: float


@dataclass(frozen=True, eq=False)
class Disc:
    """A drawn disc through six anchors: centre (3,) [m], normal as pitch and yaw [rad], size [m]."""

    center: Array
    pitch: float
    yaw: float
    radius: float
    thickness: float


@dataclass(frozen=True, eq=False)
class Layout:
    """Layout of the whole mechanism in its home pose, orientation identity."""

    home: Array
    legs: tuple[LegLayout, ...]
    base: Disc
    platform: Disc
    anchor_radius: float

    @classmethod
    def of(cls, mechanism: Mechanism) -> Layout:
        """Returns the layout of `mechanism`."""
        home = home_position(mechanism)
        vectors = home + mechanism.platform_anchors - mechanism.base_anchors
        legs = tuple(
            LegLayout(*_pitch_and_yaw(vector), length=float(np.linalg.norm(vector))) for vector in vectors
        )
        platform = _disc(mechanism.platform_anchors)
        return cls(home, legs, _disc(mechanism.base_anchors), platform, 0.1 * platform.radius)


def first_axes(mechanism: Mechanism) -> Array:
    """Returns (6, 3) the x axes of the legs' home frames, about which universal joints turn first."""
    legs = Layout.of(mechanism).legs
    return np.array(
        [
            (
                math.cos(leg.yaw) * math.cos(leg.pitch),
                math.sin(leg.yaw) * math.cos(leg.pitch),
                -math.sin(leg.pitch),
            )
            for leg in legs
        ]
    )


def strength(mechanism: Mechanism, leg: int) -> dict[str, float]:
    """Returns what an actuator can do, as far as the mechanism says, for formats whose limits are symmetric.

    Args:
        mechanism: its `limits`.
        leg: 0 to 5.

    Returns:
        "effort", the larger magnitude of its force limits [N], and "velocity" [m/s].
    """
    limits, found = mechanism.limits, {}
    if limits.force is not None:
        found["effort"] = float(np.abs(limits.force[leg]).max())
    if limits.rate is not None:
        found["velocity"] = float(limits.rate[leg])
    return found


def provenance(mechanism: Mechanism) -> str:
    """Returns what an exported file says of its numbers, fit for an XML comment."""
    lines = [f"Given by: {mechanism.source}"] if mechanism.source else []
    lines += [f"Assumed, not given: {key}: {why}" for key, why in mechanism.assumed.items()]
    text = "".join(f"\n  {printable(line)}" for line in lines)
    return comment(f" Written by sixsps.{text} ")


def _pitch_and_yaw(direction: Array) -> tuple[float, float]:
    x, y, z = (float(value) for value in direction)
    return math.atan2(math.hypot(x, y), z), math.atan2(y, x)


def _disc(anchors: Array) -> Disc:
    center = anchors.mean(axis=0)
    radius = float(np.linalg.norm(anchors - center, axis=1).max())
    normal = np.linalg.svd(anchors - center)[2][2]
    return Disc(center, *_pitch_and_yaw(normal), radius, _DISC_THICKNESS * radius)
