"""What a sampled quantity does between its samples, as far as its rates tell."""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array


def extremes(time: Array, values: Array, rates: Array) -> tuple[Array, Array]:
    """Returns the least and the largest values between samples, of the cubics through values and rates.

    Where the quantity has a fourth derivative m, a cubic misses it by no more than m step^4 / 384.

    Args:
        time: (n,) strictly increasing [s].
        values: (n, k).
        rates: (n, k) their time derivatives.

    Returns:
        (n - 1, k) and (n - 1, k), the samples at both ends among them; NaN where one of these is.
    """
    step = np.diff(time)[:, None]
    start, rise = values[:-1], np.diff(values, axis=0)
    first, last = step * rates[:-1], step * rates[1:]
    square, cube = 3 * rise - 2 * first - last, first + last - 2 * rise
    inner = [
        start + tau * (first + tau * (square + tau * cube)) for tau in _roots(3 * cube, 2 * square, first)
    ]
    found = [start, values[1:], *inner]
    return np.minimum.reduce(found), np.maximum.reduce(found)


def _roots(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Returns both roots of a x^2 + b x + c held to 0..1, 0 where there is none; without cancellation."""
    scale = np.maximum.reduce([np.abs(a), np.abs(b), np.abs(c)])  # so that no square leaves the floats
    a, b, c = (np.divide(part, scale, out=np.zeros_like(part), where=scale > 0) for part in (a, b, c))
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))
    q = -(b + np.copysign(root, b)) / 2
    return _quotient(q, a), _quotient(c, q)


def _quotient(numerator: Array, denominator: Array) -> Array:
    with np.errstate(over="ignore"):
        ratio = np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator != 0)
    return np.clip(ratio, 0.0, 1.0)
