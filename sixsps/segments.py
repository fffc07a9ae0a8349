"""Least distance between two line segments, parallel and degenerate ones included."""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.rotation import cross


def segment_distances(a: Array, u: Array, b: Array, v: Array) -> Array:
    """Returns the distances between the segments from a to a + u and from b to b + v.

    The least distance is taken inside both segments or at an end of one. Every candidate is the distance of
    two points that lie on the segments, so that none can be too small, and one of them is the least. The
    common normal u x v gives the inner candidate: the usual |u|^2 |v|^2 - (u . v)^2 would lose half of the
    digits where the segments are nearly parallel.

    Args:
        a: (..., 3) beginning of the first segment [m].
        u: (..., 3) from there to its end; may be zero [m].
        b: (..., 3) beginning of the second segment [m].
        v: (..., 3) from there to its end; may be zero [m].

    Returns:
        (...) distances [m].
    """
    r = b - a
    normal = cross(u, v)
    s = _ratio(_dot(cross(r, v), normal), _dot(normal, normal))
    t = _ratio(_dot(s * u - r, v), _dot(v, v))
    squares = [_square(r + t * v - s * u)]
    for end in (0.0, 1.0):
        t = _ratio(_dot(end * u - r, v), _dot(v, v))
        s = _ratio(_dot(r + end * v, u), _dot(u, u))
        squares += [_square(r + t * v - end * u), _square(r + end * v - s * u)]
    return np.sqrt(np.minimum.reduce(squares))


def _ratio(numerator: Array, denominator: Array) -> Array:
    """Returns the quotient held to 0..1, 0 where the denominator vanishes."""
    quotient = np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0)
    return np.clip(quotient, 0.0, 1.0)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)[..., None]


def _square(a: Array) -> Array:
    return np.einsum("...i,...i->...", a, a)
