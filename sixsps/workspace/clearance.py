"""The distance between the axes of two legs, enclosed over cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.margins import leg_distances
from sixsps.mechanism import Mechanism
from sixsps.workspace.taylor import Scalars, Vectors, cross, dot, norm

Pairs = NDArray[np.intp]
# Legs closer to parallel than this sine have no direction across both.
_PARALLEL = 1e-6


def clearances(mechanism: Mechanism, pairs: Pairs, least: float, legs: Vectors, half: Array) -> Scalars:
    """Returns the distances of pairs of legs less the clearance [m], over cells.

    They change by no more than the ends of the legs move against each other; where that does not decide, the
    bounds of `_closer` do better.

    Args:
        mechanism: whose legs these are.
        pairs: (m, 2) legs.
        least: clearance [m].
        legs: leg vectors over the cells.
        half: (n, 3) half widths of the cells.
    """
    value = leg_distances(mechanism, legs.value) - least
    reach = legs.move[:, pairs].sum(axis=-1)
    slope, below, above = np.zeros((*value.shape, 3)), -reach, reach.copy()
    cell, pair = np.nonzero(np.abs(value) <= reach)
    if len(cell):
        first, second = (_picked(legs, cell, pairs[pair, k]) for k in (0, 1))
        between = mechanism.base_anchors[pairs[pair, 1]] - mechanism.base_anchors[pairs[pair, 0]]
        rough = Scalars(*(part[cell, pair][:, None] for part in (value, slope, below, above)))
        found = _closer(_constant(between[:, None]), first, second, least, half[cell], rough)
        for part, better in (
            (value, found.value),
            (slope, found.slope),
            (below, found.below),
            (above, found.above),
        ):
            part[cell, pair] = better[:, 0]
    return Scalars(value, slope, below, above)


def _closer(
    between: Vectors, first: Vectors, second: Vectors, least: float, half: Array, rough: Scalars
) -> Scalars:
    """Returns the distance less the clearance with bounds that are linear up to second order.

    With w(t, u) = D + u S_j - t S_i the distance is the least |w| for t and u in [0, 1]. At most it is |w| at
    the centre's t and u. At least it is that of the infinite lines, and where t or u is proven to stay at an
    end, that of the end from the other line or end.

    Args:
        between: (k, 1) D from A_i to A_j.
        first: (k, 1) S_i.
        second: (k, 1) S_j.
        least: clearance [m].
        half: (k, 3) half widths of the cells.
        rough: (k, 1) bounds by what the legs move.
    """
    t, u = nearest(between.value, first.value, second.value)
    upper = norm(_point_to_point(between, first, second, t, u, half)).plus(-least)
    lower = _better(rough, _lines(between, first, second, least), half)
    i, j = np.round(t), np.round(u)
    w = _point_to_point(between, first, second, i, j, half)
    ends = ((t == i, 2 * i - 1, first, second), (u == j, 1 - 2 * j, second, first))
    stay = [end & (dot(w, one).times(push).least(half) >= 0) for end, push, one, _ in ends]
    lower = _better(lower, norm(w).plus(-least), half, stay[0] & stay[1])
    for end, push, one, other in ends:
        across = cross(w, other)
        kept = end & (dot(across, cross(one, other)).times(push).least(half) >= 0)
        lower = _better(lower, _point_to_line(across, other, least), half, kept)
    turn = np.einsum("nmk,nk->nm", np.abs(upper.slope - lower.slope), half)
    above = np.minimum(upper.value + upper.above + turn - lower.value, _ceiling(rough, lower, half))
    return Scalars(lower.value, lower.slope, lower.below, above)


def _ceiling(rough: Scalars, lower: Scalars, half: Array) -> Array:
    """Returns how far above `lower` the rough bound may be."""
    return rough.most(half) - lower.value + np.einsum("nmk,nk->nm", np.abs(lower.slope), half)


def _picked(legs: Vectors, cell: Pairs, leg: Pairs) -> Vectors:
    return Vectors(*(part[cell, leg][:, None] for part in (legs.value, legs.slope, legs.error, legs.move)))


def nearest(between: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Returns t and u in [0, 1] of the nearest points of segments t S_i and D + u S_j, (..., 3) each.

    The least of the four ends against the other segment, and of the lines where that is inside both.
    """
    a, e, b = (np.sum(x * y, axis=-1) for x, y in ((first, first), (second, second), (first, second)))
    d, f = np.sum(between * first, axis=-1), np.sum(between * second, axis=-1)
    zero, one = np.zeros_like(a), np.ones_like(a)

    def part(numerator: Array, denominator: Array) -> Array:
        safe = np.where(denominator > 0, denominator, 1.0)
        return np.where(denominator > 0, np.clip(numerator / safe, 0.0, 1.0), 0.0)

    crossing = a * e - b * b
    apart = crossing > _PARALLEL**2 * a * e
    t = np.where(apart, part(d * e - f * b, np.where(apart, crossing, 0.0)), 0.0)
    candidates = [
        (zero, part(-f, e)),
        (one, part(b - f, e)),
        (part(d, a), zero),
        (part(d + b, a), one),
        (t, part(t * b - f, e)),
    ]
    sizes = [
        np.linalg.norm(between + u[..., None] * second - t[..., None] * first, axis=-1) for t, u in candidates
    ]
    best = np.argmin(sizes, axis=0)
    return tuple(np.choose(best, [pair[k] for pair in candidates]) for k in (0, 1))


def _constant(vectors: Array) -> Vectors:
    zero = np.zeros(vectors.shape[:-1])
    return Vectors(vectors, np.zeros((*vectors.shape, 3)), zero, zero)


def _point_to_point(
    between: Vectors, first: Vectors, second: Vectors, t: Array, u: Array, half: Array
) -> Vectors:
    """Returns w(t, u); where both ends move alike, as those of a displaced platform, it hardly moves."""
    value = between.value + u[..., None] * second.value - t[..., None] * first.value
    slope = u[..., None, None] * second.slope - t[..., None, None] * first.slope
    error = u * second.error + t * first.error
    linear = np.linalg.norm(np.einsum("nmjk,nk->nmj", np.abs(slope), half), axis=-1)
    return Vectors(value, slope, error, np.minimum(u * second.move + t * first.move, linear + error))


def _lines(between: Vectors, first: Vectors, second: Vectors, least: float) -> Scalars:
    """Returns (|D . S_i x S_j| - clearance |S_i x S_j|) / |S_i x S_j at the centre|."""
    across = cross(first, second)
    size = np.linalg.norm(across.value, axis=-1)
    parallel = size <= _PARALLEL * np.linalg.norm(first.value, axis=-1) * np.linalg.norm(
        second.value, axis=-1
    )
    triple = dot(between, across)
    margin = triple.times(np.where(triple.value >= 0, 1.0, -1.0)) + norm(across).times(-least)
    margin = margin.times(1 / np.where(parallel, 1.0, size))
    return Scalars(margin.value, margin.slope, np.where(parallel, -np.inf, margin.below), margin.above)


def _point_to_line(across: Vectors, line: Vectors, least: float) -> Scalars:
    """Returns (|w x S| - clearance |S|) / |S at the centre|."""
    size = np.linalg.norm(line.value, axis=-1)
    margin = norm(across) + norm(line).times(-least)
    return margin.times(1 / np.where(size > 0, size, 1.0))


def _better(one: Scalars, other: Scalars, half: Array, valid: NDArray[np.bool_] | bool = True) -> Scalars:
    """Returns of two lower bounds the one that is larger over a cell."""
    chosen = valid & (other.least(half) > one.least(half))
    return Scalars(
        np.where(chosen, other.value, one.value),
        np.where(chosen[..., None], other.slope, one.slope),
        np.where(chosen, other.below, one.below),
        np.where(chosen, other.above, one.above),
    )
