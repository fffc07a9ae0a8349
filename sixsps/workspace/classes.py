"""Which cells keep all limits, which break one, and how much of the others is allowed."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np

from sixsps.arrays import Array
from sixsps.workspace.constraints import SINGULARITY, Constraints
from sixsps.workspace.fractions import fraction_bounds
from sixsps.workspace.octree import CORNERS, Booleans, Integers
from sixsps.workspace.taylor import Scalars

OUTSIDE, BOUNDARY, INSIDE = 0, 1, 2
# Cells that are enclosed at a time, so that memory does not grow with their number.
_BLOCK = 4096
_WORKERS = 4
# A point on a face of a cell, up to rounding, is in it.
EDGE = 1e-9
# Rounding of a cell's place, of the size of the root.
_PLACED = 8 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Verdicts:
    """What is proven of n cubes of parameters.

    Attributes:
        state: (n,) INSIDE, OUTSIDE or BOUNDARY.
        lower: (n,) part of the cube that is allowed, at least; that part is convex.
        upper: (n,) at most.
        limit: (n,) number of the limit that decides: the one broken, or the nearest.
        corners: (n, 8) whether a corner of the cube is in the part that is allowed.
        holds_reference: (n,) whether the parameters 0 are in that part.
        near: (n,) distance from the parameters 0 within which no limit is broken in the cube.
        far: (n,) distance of a point of the cube that breaks a limit; infinite where none is known.
        regular: (n,) whether all of the cube is on the right side of the singularity.
    """

    state: Integers
    lower: Array
    upper: Array
    limit: Integers
    corners: Booleans
    holds_reference: Booleans
    near: Array
    far: Array
    regular: Booleans

    @classmethod
    def joined(cls, parts: list[Verdicts]) -> Verdicts:
        """Returns the verdicts on all cubes one after the other."""
        return cls(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(cls)))

    def __getitem__(self, chosen: Integers | Booleans) -> Verdicts:
        return Verdicts(*(getattr(self, one.name)[chosen] for one in fields(self)))


def judge(constraints: Constraints, centre: Array, half: Array, regular: Booleans) -> Verdicts:
    """Returns the verdicts on cubes.

    Args:
        constraints: to be kept.
        centre: (n, 3) parameters.
        half: (n,) half edges.
        regular: (n,) cubes that are known to be on the right side of the singularity.
    """
    blocks = [slice(at, at + _BLOCK) for at in range(0, len(centre), _BLOCK)]

    def verdicts(at: slice) -> Verdicts:
        return _judge(constraints, centre[at], half[at], regular[at])

    # NumPy lets go of the interpreter's lock where it works on blocks.
    with ThreadPoolExecutor(min(os.cpu_count() or 1, _WORKERS)) as pool:
        return Verdicts.joined(list(pool.map(verdicts, blocks)))


def _judge(constraints: Constraints, centre: Array, half: Array, regular: Booleans) -> Verdicts:
    f = constraints.over(centre, np.repeat(half[:, None], 3, axis=1), regular)
    f = Scalars(f.value, f.slope * half[:, None, None], f.below, f.above)
    reach = np.abs(f.slope).sum(axis=-1)
    least, most = f.value + f.below - reach, f.value + f.above + reach
    state = np.where((most < 0).any(axis=1), OUTSIDE, np.where((least >= 0).all(axis=1), INSIDE, BOUNDARY))
    spread = reach + np.maximum(f.above, -f.below)
    nearness = np.divide(f.value, spread, out=np.zeros_like(spread), where=np.isfinite(spread) & (spread > 0))
    nearness = np.where(least >= 0, np.inf, nearness)
    everything = np.where(most < 0, -np.inf, nearness)
    limit = np.where(state == INSIDE, -1, everything.argmin(axis=1))
    lower, upper = np.where(state == INSIDE, 1.0, 0.0), np.where(state == OUTSIDE, 0.0, 1.0)
    box = half * np.linalg.norm(np.maximum(np.abs(centre) / half[:, None] - 1, 0), axis=1)
    slack = _PLACED * float(np.abs(constraints.chart.root[0]).max() + constraints.chart.root[1])
    near = np.where(state == INSIDE, np.inf, np.maximum(box - slack, 0.0))
    far = np.where(state == OUTSIDE, box + slack, np.inf)
    corners = np.repeat((state == INSIDE)[:, None], 8, axis=1)
    holds = (state == INSIDE) & (np.abs(centre) <= half[:, None] * (1 + EDGE)).all(axis=1)
    at = np.flatnonzero(state == BOUNDARY)
    if len(at):
        inner = Scalars(f.value[at], f.slope[at], f.below[at], f.above[at])
        zero = -centre[at] / half[at, None]
        lower[at], upper[at] = _fractions(inner, least[at])
        corners[at] = _contains(inner, np.broadcast_to(2.0 * CORNERS - 1, (len(at), 8, 3)))
        holds[at] = (np.abs(zero) <= 1 + EDGE).all(axis=1) & _contains(inner, zero[:, None])[:, 0]
        distances = _distances(inner, zero, least[at])
        near[at] = np.maximum(near[at], half[at] * distances[0])
        far[at] = half[at] * distances[1]
    if SINGULARITY in constraints.names:
        regular = least[:, constraints.names.index(SINGULARITY)] >= 0
    return Verdicts(state, lower, upper, limit, corners, holds, near, far, regular)


def _fractions(f: Scalars, least: Array) -> tuple[Array, Array]:
    """Bounds what of the cubes |u| <= 1 keeps all limits: no more than each leaves, no less than all take."""
    lower, upper = np.where(least >= 0, 1.0, 0.0), np.ones_like(least)
    cut = (least < 0) & np.isfinite(f.above - f.below)
    low, high = (f.value + f.below)[cut], (f.value + f.above)[cut]
    lower[cut], upper[cut] = fraction_bounds(low, high, f.slope[cut])
    return np.maximum(1 - (1 - lower).sum(axis=1), 0.0), upper.min(axis=1)


def _contains(f: Scalars, points: Array) -> Booleans:
    """Returns (n, k) whether (n, k, 3) points of the cubes |u| <= 1 are in their allowed convex parts."""
    margins = (f.value + f.below)[:, None] + np.einsum("nmj,nkj->nkm", f.slope, points)
    return np.asarray((margins >= 0).all(axis=-1))


def _distances(f: Scalars, point: Array, least: Array) -> tuple[Array, Array]:
    """Returns (n,) `near` and `far` of points (n, 3), in half edges."""
    steep = np.linalg.norm(f.slope, axis=-1)
    flat = steep == 0
    here = np.einsum("nmj,nj->nm", f.slope, point)
    safe = np.where(flat, 1.0, steep)
    with np.errstate(invalid="ignore"):
        inner, outer = (f.value + f.below + here) / safe, (f.value + f.above + here) / safe
    near = np.where(least >= 0, np.inf, np.where(flat, 0.0, np.maximum(inner, 0.0))).min(axis=1)
    # The nearest point of the plane beyond which the limit is broken counts where it is in the cube.
    reached = np.where(flat | ~np.isfinite(outer), 0.0, outer)
    foot = point[:, None] - (reached / safe)[..., None] * f.slope
    known = ~flat & np.isfinite(outer) & (np.abs(foot) <= 1).all(axis=-1)
    # Of a point that is not in the cube, that plane says nothing: it may seem to be beyond it.
    far = np.where(known, np.abs(outer), np.inf).min(axis=1)
    return near, far
