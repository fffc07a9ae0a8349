"""The part of a cube on one side of a plane."""

from __future__ import annotations

from itertools import product

import numpy as np

from sixsps.arrays import Array

# Slopes below this part of the largest are raised to it, so that the alternating sum keeps ten digits.
_FLAT = 1e-3
# What rounding leaves of the alternating sum: some 1e-16 / (6 _FLAT^2).
_ROUNDING = 1e-9


def fraction_bounds(low: Array, high: Array, slope: Array) -> tuple[Array, Array]:
    """Bounds the part of the cube |u_k| <= 1 where a function is at least 0.

    Args:
        low: (n,) the function is at least low + slope . u.
        high: (n,) the function is at most high + slope . u.
        slope: (n, 3).

    Returns:
        (n,) lower and (n,) upper bounds in [0, 1].
    """
    size = np.abs(slope)
    raised = np.maximum(size, _FLAT * size.max(axis=1, keepdims=True))
    change = (raised - size).sum(axis=1)
    lower = _fraction(low - change, raised) - _ROUNDING
    upper = _fraction(high + change, raised) + _ROUNDING
    return np.clip(lower, 0.0, 1.0), np.clip(upper, 0.0, 1.0)


def _fraction(offset: Array, slope: Array) -> Array:
    """Returns the volume of offset + slope . u >= 0 in the cube |u_k| <= 1, of all its volume; slopes >= 0.

    In the corner's coordinates t = (1 - u) / 2 the plane is 2 slope . t = offset + sum(slope), and the volume
    under it is the alternating sum of the corners' cubes (Barrow & Smith 1979).
    """
    reach = slope.sum(axis=1)
    result = np.where(offset >= 0, 1.0, 0.0)
    cut = np.abs(offset) < reach
    # The smaller side, where less cancels.
    side, a = -np.abs(offset[cut]), 2 * slope[cut]
    height = side + reach[cut]
    total = np.zeros_like(height)
    for corner in product((0, 1), repeat=3):
        total += (-1) ** sum(corner) * np.maximum(height - a @ np.array(corner, dtype=float), 0.0) ** 3
    part = total / (6 * a.prod(axis=1))
    result[cut] = np.where(offset[cut] >= 0, 1 - part, part)
    return result
