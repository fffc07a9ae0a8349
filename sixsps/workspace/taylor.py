"""Quantities over many cells at once: linear in the cell's parameters, with a proven bound of the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.rotation import skew


@dataclass(frozen=True, eq=False)
class Vectors:
    """Vectors over cells: |v(d) - value - slope d| <= error and |v(d) - value| <= move for |d_k| <= half_k.

    Attributes:
        value: (n, m, 3) at the centres.
        slope: (n, m, 3, 3) derivatives of the three components (rows) by the three parameters.
        error: (n, m).
        move: (n, m).
    """

    value: Array
    slope: Array
    error: Array
    move: Array


@dataclass(frozen=True, eq=False)
class Scalars:
    """Numbers over cells: f(d) - value - slope . d lies in [below, above] for |d_k| <= half_k.

    Attributes:
        value: (n, m) at the centres.
        slope: (n, m, 3) derivatives by the three parameters.
        below: (n, m), <= 0.
        above: (n, m), >= 0.
    """

    value: Array
    slope: Array
    below: Array
    above: Array

    def __add__(self, other: Scalars) -> Scalars:
        return Scalars(
            self.value + other.value,
            self.slope + other.slope,
            self.below + other.below,
            self.above + other.above,
        )

    def times(self, factor: Array | float) -> Scalars:
        """Returns the product with (m,) or one constant factor of any sign."""
        factor = np.asarray(factor, dtype=np.float64)
        ends = factor * self.below, factor * self.above
        return Scalars(
            factor * self.value, factor[..., None] * self.slope, np.minimum(*ends), np.maximum(*ends)
        )

    def plus(self, constant: Array | float) -> Scalars:
        """Returns the sum with (m,) or one constant."""
        return Scalars(self.value + constant, self.slope, self.below, self.above)

    def widened(self, by: Array | float) -> Scalars:
        """Returns what also holds where every value is off by as much as `by`."""
        return Scalars(self.value, self.slope, self.below - by, self.above + by)

    def least(self, half: Array) -> Array:
        """Returns (n, m) lower bounds over cells of (n, 3) half widths."""
        return self.value + self.below - np.einsum("nmk,nk->nm", np.abs(self.slope), half)

    def most(self, half: Array) -> Array:
        """Returns (n, m) upper bounds over cells of (n, 3) half widths."""
        return self.value + self.above + np.einsum("nmk,nk->nm", np.abs(self.slope), half)


def dot(u: Vectors, v: Vectors) -> Scalars:
    """Returns u . v: of (u + du) . (v + dv) the product du . dv is what is not linear."""
    slope = np.einsum("nmj,nmjk->nmk", u.value, v.slope) + np.einsum("nmj,nmjk->nmk", v.value, u.slope)
    size_u, size_v = np.linalg.norm(u.value, axis=-1), np.linalg.norm(v.value, axis=-1)
    error = size_u * v.error + size_v * u.error + u.move * v.move
    return Scalars(np.sum(u.value * v.value, axis=-1), slope, -error, error)


def norm(v: Vectors) -> Scalars:
    """Returns |v|, a convex function of v.

    With dv = (p, q) along and across v, |v + dv| - |v| - p is at least 0, at most 2 |dv|, and at most
    q^2 / (2 (|v| - |dv|)) where that is positive.
    """
    size = np.linalg.norm(v.value, axis=-1)
    shortest = np.maximum(size - v.move, 0.25 * v.move)
    bent = np.divide(v.move**2, 2 * shortest, out=np.zeros_like(size), where=shortest > 0)
    direction = np.divide(v.value, size[..., None], out=np.zeros_like(v.value), where=size[..., None] > 0)
    slope = np.einsum("nmj,nmjk->nmk", direction, v.slope)
    return Scalars(size, slope, -v.error, v.error + bent)


def stacked(parts: list[Scalars]) -> Scalars:
    """Returns all numbers of the same cells side by side."""
    names = ("value", "slope", "below", "above")
    return Scalars(*(np.concatenate([getattr(part, name) for part in parts], axis=1) for name in names))


def cross(u: Vectors, v: Vectors) -> Vectors:
    """Returns u x v."""
    value = np.cross(u.value, v.value)
    slope = skew(u.value) @ v.slope - skew(v.value) @ u.slope
    size_u, size_v = np.linalg.norm(u.value, axis=-1), np.linalg.norm(v.value, axis=-1)
    both = u.move * v.move
    error = size_u * v.error + size_v * u.error + both
    return Vectors(value, slope, error, size_u * v.move + size_v * u.move + both)
