"""A mechanism and a motion as the columns of numbers that functions of the whole mechanism take."""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism

_AXES = "xyz"
_LINK_FIELDS = ("mass", "com", "transverse", "axial")
_INERTIA = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}

PARAMETERS: tuple[str, ...] = (
    *(f"gravity.{axis}" for axis in _AXES),
    *(f"base.anchors.{leg}.{axis}" for leg in range(6) for axis in _AXES),
    *(f"platform.anchors.{leg}.{axis}" for leg in range(6) for axis in _AXES),
    "platform.mass",
    *(f"platform.com.{axis}" for axis in _AXES),
    *(f"platform.inertia.{entry}" for entry in _INERTIA),
    *(
        f"legs.{leg}.{half}.{field}"
        for leg in range(6)
        for half in ("lower", "upper")
        for field in _LINK_FIELDS
    ),
)
"""Names of the entries of the parameter vector, in order."""

MOTION_COLUMNS: dict[str, tuple[tuple[str, int], ...]] = {
    "pose": (("position", 3), ("quaternion", 4)),
    "twist": (("velocity", 3), ("angular_velocity", 3)),
    "acceleration": (("acceleration", 3), ("angular_acceleration", 3)),
    "wrench": (("force", 3), ("moment", 3)),
}
"""Input -> the arrays of a `Motion` that it is made of, with their widths, in order."""


def parameter_vector(mechanism: Mechanism) -> Array:
    """Returns the (97,) numbers of a mechanism in the order of `PARAMETERS`, SI units.

    Gravity and inertia of a mechanism of geometry alone are NaN: nothing that comes of them is a number.
    """
    anchors = [mechanism.base_anchors.ravel(), mechanism.platform_anchors.ravel()]
    if not mechanism.has_inertia:
        unknown = len(PARAMETERS) - 3 - sum(len(part) for part in anchors)
        return np.concatenate([np.full(3, np.nan), *anchors, np.full(unknown, np.nan)])
    inertia = mechanism.platform.inertia
    links = [link for leg in mechanism.legs for link in (leg.lower, leg.upper)]
    return np.concatenate(
        [
            mechanism.gravity,
            *anchors,
            [mechanism.platform.mass],
            mechanism.platform.com,
            [inertia[entry] for entry in _INERTIA.values()],
            [getattr(link, field) for link in links for field in _LINK_FIELDS],
        ]
    )
