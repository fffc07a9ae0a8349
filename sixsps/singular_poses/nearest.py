"""The nearest singular pose, and how near one can be at most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixsps.arguments import mechanism_of, whole_number
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.pose_arrays import pose_arrays
from sixsps.pose_quality import characteristic_length, singular_samples
from sixsps.singular_poses.minimum import Neighbourhood, descended
from sixsps.singular_poses.surface import SingularSet, rotation_vectors, turned

# Poses at which rays are sent out, unless told otherwise; the others start from what these found.
SEARCHED = 32
_RAYS, _STEPS = 48, 24
# Minimisations that are begun from one pose.
_STARTS = 8
# Different minima of a pose that its neighbours begin from, and what is no other minimum, relative.
_KEPT, _ALIKE = 4, 1e-3
# Poses are minimised so many at once, which bounds the memory.
_BLOCK = 1024


@dataclass(frozen=True, eq=False)
class SingularityDistance:
    """How far n poses are from a singular one.

    The distance of two poses is sqrt(|dp|^2 + (L theta)^2), with dp the displacement of O1, theta the angle
    that turns one orientation into the other, and L the characteristic length. It is reached: the pose that
    is given at that distance is singular. It is a local minimum and the least one that was found; there
    could be a nearer one, but none within `none_within`, which is proven up to rounding.

    Attributes:
        characteristic_length: L [m].
        distance: (n,) from each pose to `position` and `rotation` [m]; infinite where none was found.
        none_within: (n,) radius within which there is no singular pose [m].
        position: (n, 3) platform origin of the nearest singular pose that was found [m].
        rotation: (n, 3, 3) its orientation.
        searched: (k,) indices of the poses from which rays were sent out in all directions.
    """

    characteristic_length: float
    distance: Array
    none_within: Array
    position: Array
    rotation: Array
    searched: NDArray[np.intp]


def singularity_distance(
    mechanism: Mechanism, poses: Any, *, length: float | None = None, searched: int = SEARCHED
) -> SingularityDistance:
    """Returns how far poses are from a singular one.

    From some of the poses rays are sent out in all directions of pose space until det J changes its sign.
    The nearest hits are where a minimisation of the distance on the singular set starts: steps to the
    nearest point of its tangent plane, with a line search. All poses then start from the nearest minima
    that any of these found, and from their own tangent plane.

    This takes more than a millisecond for each pose, two minutes for 10^5: of a long motion give every k-th
    sample, `motion[::k]`. A pose that is left out is no nearer to a singular one than the `none_within` of
    any sample less what it is apart from that. Whether a motion crosses a singular pose is what
    `sixsps.singularity_crossings` tells, far faster.

    Args:
        mechanism: geometry.
        poses: as for `sixsps.quality`.
        length: characteristic length [m]; by default the mechanism's.
        searched: poses from which rays are sent out, spread evenly, and that of the least `none_within`.

    Raises:
        MotionError: not poses.
        InputError: a length that is not above 0, nothing to be searched, or not a mechanism.
    """
    position, rotation = pose_arrays(poses)
    size = characteristic_length(mechanism_of(mechanism), length)
    return _distance(mechanism, position, rotation, size, whole_number(searched, "searched", 1))


def _distance(
    mechanism: Mechanism, position: Array, rotation: Array, size: float, searched: int
) -> SingularityDistance:
    singular_set, place, n = SingularSet(mechanism, size), position / size, len(position)
    blocks = [slice(start, start + _BLOCK) for start in range(0, n, _BLOCK)]
    free = np.concatenate([np.empty(0)] + [singular_set.free_radius(place[b], rotation[b]) for b in blocks])
    where = np.unique(np.linspace(0, n - 1, min(searched, n)).round().astype(np.intp))
    if n:
        where = np.union1d(where, np.argmin(free))
    known = _search(singular_set, place[where], rotation[where])
    distance, x = np.full(n, np.inf), np.zeros((n, 6))
    for block in blocks:
        here = place[block], rotation[block]
        starts = known.starts(*here)
        distance[block], x[block] = _nearest(singular_set, *here, starts)
    already = singular_samples(mechanism, position, rotation, size)
    distance[already], x[already], free[already] = 0.0, 0.0, 0.0
    return SingularityDistance(
        characteristic_length=size,
        distance=size * distance,
        none_within=size * free,
        position=size * (place + x[:, :3]),
        rotation=turned(x[:, 3:], rotation),
        searched=where,
    )


@dataclass(frozen=True, eq=False)
class _Known:
    """What a search from m poses has found: up to k different minima of each, nearest first.

    Attributes:
        place: (m, 3) the poses.
        rotation: (m, 3, 3).
        places: (m, k, 3) singular poses.
        rotations: (m, k, 3, 3).
    """

    place: Array
    rotation: Array
    places: Array
    rotations: Array

    def starts(self, place: Array, rotation: Array) -> Array:
        """Returns (n, k + 2, 6) ways to begin with.

        No way at all, that to the nearest minimum, and those to the minima of the nearest searched pose.
        """
        n, k = len(place), self.places.shape[1]
        flat_places, flat_turns = self.places.reshape(-1, 3), self.rotations.reshape(-1, 3, 3)
        nearest = _nearest_of(place, rotation, flat_places, flat_turns)
        searched = _nearest_of(place, rotation, self.place, self.rotation)
        chosen = np.concatenate([nearest[:, None], k * searched[:, None] + np.arange(k)], axis=1)
        ways = np.zeros((n, k + 2, 6))
        ways[:, 1:, :3] = flat_places[chosen] - place[:, None]
        start = np.repeat(rotation, k + 1, axis=0)
        ways[:, 1:, 3:] = rotation_vectors(start, flat_turns[chosen.ravel()]).reshape(n, k + 1, 3)
        return ways


def _nearest_of(place: Array, rotation: Array, places: Array, rotations: Array) -> NDArray[np.intp]:
    """Returns (n,) which of some poses (m, ...) is the nearest to each pose."""
    squares = np.sum((place[:, None] - places) ** 2, axis=2)
    cosine = (rotation.reshape(-1, 9) @ rotations.reshape(-1, 9).T - 1) / 2
    return np.argmin(squares + np.arccos(np.clip(cosine, -1, 1)) ** 2, axis=1)


def _search(singular_set: SingularSet, place: Array, rotation: Array) -> _Known:
    """Returns singular poses near some poses (m, ...), those that were found twice once."""
    directions, m = _directions(), len(place)
    starts = np.zeros((m, _STARTS + 1, 6))  # the first from the pose itself
    for k in range(m):
        hits = _hits(singular_set, place[k], rotation[k], np.pi * directions)
        nearest = hits[np.argsort(np.linalg.norm(hits, axis=1))[:_STARTS]]
        starts[k, 1 : len(nearest) + 1] = nearest
    distance, x = _minimised(singular_set, place, rotation, starts)
    order, rows = np.argsort(distance, axis=1), np.arange(m)[:, None]
    ways = _different(distance[rows, order], x[rows, order])
    places = place[:, None] + ways[..., :3]
    turns = turned(ways[..., 3:].reshape(-1, 3), np.repeat(rotation, _KEPT, axis=0))
    return _Known(place, rotation, places, turns.reshape(m, _KEPT, 3, 3))


def _different(distance: Array, x: Array) -> Array:
    """Returns (m, _KEPT, 6) the first ways that are not alike, no way at all where there are no more."""
    ways = np.zeros((len(x), _KEPT, 6))
    for k, (far, those) in enumerate(zip(distance, x, strict=True)):
        kept: list[Array] = []
        for way in those[np.isfinite(far)]:
            apart = [np.linalg.norm(way - other) > _ALIKE * np.linalg.norm(way) for other in kept]
            if all(apart) and len(kept) < _KEPT:
                kept.append(way)
        ways[k, : len(kept)] = kept
    return ways


def _directions() -> Array:
    """Returns unit vectors all over pose space, the axes among them."""
    drawn = np.random.default_rng(6).standard_normal((_RAYS, 6))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    return np.vstack([np.eye(6), -np.eye(6), drawn])


def _hits(singular_set: SingularSet, place: Array, rotation: Array, rays: Array) -> Array:
    """Returns (m, 6) where g first changes its sign along rays (k, 6) from a pose."""
    steps = np.linspace(0, 1, _STEPS + 1)
    x = (steps[:, None, None] * rays).reshape(-1, 6)
    g = singular_set.values(place + x[:, :3], turned(x[:, 3:], rotation[None]))
    positive = (g > 0).reshape(len(steps), -1)
    changes = positive[1:] != positive[:-1]
    rays_hit = np.flatnonzero(changes.any(axis=0))
    first = changes[:, rays_hit].argmax(axis=0)
    return ((first + 0.5) / _STEPS)[:, None] * rays[rays_hit]


def _minimised(
    singular_set: SingularSet, place: Array, rotation: Array, starts: Array
) -> tuple[Array, Array]:
    """Returns (n, k) distances and (n, k, 6) ways to singular poses that are locally nearest.

    Args:
        singular_set: of the mechanism.
        place: (n, 3) positions.
        rotation: (n, 3, 3) orientations.
        starts: (n, k, 6) ways from there to begin with: displacement, rotation vector.
    """
    n, k, _ = starts.shape
    around = Neighbourhood(singular_set, np.repeat(place, k, axis=0), np.repeat(rotation, k, axis=0))
    x = descended(around, starts.reshape(-1, 6))
    distance = np.where(around.are_singular(x), np.linalg.norm(x, axis=1), np.inf)
    return distance.reshape(n, k), x.reshape(n, k, 6)


def _nearest(singular_set: SingularSet, place: Array, rotation: Array, starts: Array) -> tuple[Array, Array]:
    """Returns (n,) distances and (n, 6) ways to the nearest of the minima."""
    distance, x = _minimised(singular_set, place, rotation, starts)
    best = distance.argmin(axis=1)[:, None]
    return np.take_along_axis(distance, best, 1)[:, 0], np.take_along_axis(x, best[..., None], 1)[:, 0]
