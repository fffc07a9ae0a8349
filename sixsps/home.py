"""The pose from which a mechanism works: above its base, the legs at mid-stroke."""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import MechanismError
from sixsps.mechanism import Mechanism
from sixsps.missing import Missing

_EPS = float(np.finfo(float).eps)
# A direction whose cosine is below has no part along a normal that rounding could not have made.
_ACROSS = 1e-9


def home_position(mechanism: Mechanism) -> Array:
    """Returns the position above the base at which the legs are on average at mid-stroke.

    The platform keeps its orientation, its anchors' centroid straight above the base anchors'
    centroid, "above" being the normal of the base that points against gravity; where gravity is not given
    or along the base, the one along z, or along y or x of a base that stands upright. Where the legs are
    too short for that at any height, half their middle length serves as the height.

    Returns:
        (3,) platform origin, world frame [m].

    Raises:
        MechanismError: a mechanism of geometry alone that has no length limits.
    """
    from scipy.optimize import brentq

    A, b = mechanism.base_anchors, mechanism.platform_anchors
    middle = float(mechanism.length_limits.mean())
    if not np.isfinite(middle):
        some = np.isfinite(mechanism.length_limits[:, 1]).any()
        allowed = "shortest and longest length of every leg [m]; the home pose is at mid-stroke"
        raise MechanismError("legs.length_limits", "a stroke without end" if some else "missing", allowed)
    normal = np.linalg.svd(A - A.mean(axis=0))[2][2]
    normal = normal if _upwards(mechanism, normal) @ normal >= 0 else -normal
    foot = A.mean(axis=0) - b.mean(axis=0)

    def excess(height: float) -> float:
        legs = foot + height * normal + b - A
        return float(np.linalg.norm(legs, axis=1).mean()) - middle

    highest = 2 * middle + float(np.abs(b - A + foot).sum())
    # To rounding, whatever the unit of length: brentq's own tolerance is 2e-12 m.
    height = brentq(excess, 0.0, highest, xtol=_EPS * middle) if excess(0.0) < 0 else middle / 2
    return np.asarray(foot + height * normal)


def _upwards(mechanism: Mechanism, normal: Array) -> Array:
    """Returns the direction against gravity; along z, or y, or x, where gravity leaves the side open."""
    gravity = np.zeros(3) if isinstance(mechanism.gravity, Missing) else mechanism.gravity
    for direction in (-gravity, *np.eye(3)[::-1]):
        if abs(direction @ normal) > _ACROSS * np.linalg.norm(direction):
            return direction
    raise AssertionError("a normal is across all three axes")
