"""Where a motion goes through a singularity between its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.pose_quality import singular_samples
from sixsps.singular_poses.surface import SingularSet, left_jacobians, rotation_vectors, turned

# Pieces between two samples are halved so often until they are certain to be free, then searched for a
# change of sign; and no further once there are so many of them, as on a motion along the singular set.
_HALVINGS, _MOST_PIECES = 20, 30_000
# Bisection to the last bit of a float64 within 0..1.
_BISECTIONS = 60
# Of sums of many lengths.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Crossings:
    """Crossings of the singular set along a motion, on the path through its samples and velocities.

    Between two samples the path is cubic in the position and in the rotation vector from the earlier
    sample. All of it is free of singular poses, proven up to rounding, but for what is listed here, the
    neighbourhood of singular samples, and the path from one singular sample to the next.

    Attributes:
        time: (k,) of the changes of sign of det J between samples [s].
        interval: (k,) index of the sample before each.
        position: (k, 3) platform origin there [m].
        rotation: (k, 3, 3) orientation there.
        undecided: (m,) indices of samples after which, up to the next one, the path comes so close to a
            singular pose that touching it is not ruled out, without a change of sign.
        singular_samples: (j,) indices of samples that are singular (condition number above 1e12).
    """

    time: Array
    interval: NDArray[np.intp]
    position: Array
    rotation: Array
    undecided: NDArray[np.intp]
    singular_samples: NDArray[np.intp]

    def __bool__(self) -> bool:
        return bool(len(self.time) or len(self.undecided) or len(self.singular_samples))


def singularity_crossings(mechanism: Mechanism, motion: Motion) -> Crossings:
    """Returns where a motion meets singular poses, at its samples and between them.

    A piece of the path is free where it is shorter than the radii, added up, of the balls about its ends
    that hold no singular pose. Other pieces are halved, from the whole path down to a millionth of the step
    between two samples.

    Args:
        mechanism: geometry.
        motion: n samples.
    """
    size = mechanism.characteristic_length
    singular = singular_samples(mechanism, motion.position, motion.rotation, size)
    path = _Path(motion, size)
    search = _Search(SingularSet(mechanism, size), path, singular)
    interval, before, after = search.changes()
    tau = search.bisected(interval, before, after)
    position, rotation = path.poses(interval, tau)
    return Crossings(
        time=motion.time[interval] + tau * np.diff(motion.time)[interval],
        interval=interval,
        position=size * position,
        rotation=rotation,
        undecided=search.undecided,
        singular_samples=np.flatnonzero(singular),
    )


class _Path:
    """The path through the samples of a motion, in units of L; tau runs from 0 to 1 between two of them."""

    def __init__(self, motion: Motion, length: float) -> None:
        step = np.diff(motion.time)[:, None]
        p, R, v, w = (
            motion.position / length,
            motion.rotation,
            motion.velocity / length,
            motion.angular_velocity,
        )
        turn = rotation_vectors(R[:-1], R[1:])
        end_rate = np.linalg.solve(left_jacobians(turn), (step * w[1:])[..., None])[..., 0]
        self._place, self._rotation = p, R
        start = np.hstack([step * v[:-1], step * w[:-1]])
        end = np.hstack([step * v[1:], end_rate])
        way = np.hstack([np.diff(p, axis=0), turn])
        self._coefficients = start, 3 * way - 2 * start - end, start + end - 2 * way
        # The control points of the derivative as a Bezier curve; a rotation vector changes no slower than
        # the orientation turns.
        controls = np.stack([start, 3 * way - start - end, end])
        speed = np.linalg.norm(controls, axis=2).max(axis=0, initial=0.0)
        self._speed, self._until = speed, np.concatenate([[0.0], np.cumsum(speed)])

    def lengths(self, start: Array, end: Array) -> Array:
        """Returns (k,) upper bounds of the length of the path between places (k,), in units of L.

        A place counts samples: 2.5 is halfway from the third sample to the fourth. Places less than a
        sample apart have none between them.
        """
        first, last = self.before(start), self.before(end)
        within = (end - start) * self._speed[first]
        whole = self._until[last] - self._until[first]
        across = whole + (end - last) * self._speed[last] - (start - first) * self._speed[first]
        return np.where(end - start <= 1, within, (1 + _ROUNDING) * across)

    def before(self, place: Array) -> NDArray[np.intp]:
        """Returns (k,) the sample before each place; for the last sample the one before it."""
        return np.minimum(place.astype(np.intp), len(self._speed) - 1)

    def poses(self, interval: NDArray[np.intp], tau: Array) -> tuple[Array, Array]:
        """Returns (k, 3) positions in units of L and (k, 3, 3) orientations.

        Args:
            interval: (k,) sample before.
            tau: (k,) from 0 there to 1 at the next sample.
        """
        first, second, third = (part[interval] for part in self._coefficients)
        t = tau[:, None]
        x = t * (first + t * (second + t * third))
        return self._place[interval] + x[:, :3], turned(x[:, 3:], self._rotation[interval])


class _Search:
    """Pieces of a path that may hold singular poses."""

    def __init__(self, singular_set: SingularSet, path: _Path, singular: NDArray[np.bool_]) -> None:
        self._set, self._path, self._singular = singular_set, path, singular
        self.undecided = np.empty(0, np.intp)

    def changes(self) -> tuple[NDArray[np.intp], Array, Array]:
        """Returns the sample before, and tau at both ends, of pieces in which g changes its sign."""
        last = len(self._singular) - 1
        start, end = (np.array([place] if last > 0 else [], dtype=np.float64) for place in (0, last))
        here, there = self._at(start), self._at(end)
        for _ in range(_HALVINGS + max(last, 1).bit_length()):
            blind = (end - start == 1) & self._touches(start) & self._touches(end)
            doubtful = self._doubtful(start, end, here, there) & ~blind
            start, end = start[doubtful], end[doubtful]
            here, there = here[:, doubtful], there[:, doubtful]
            within_a_step = bool((end - start <= 1).all())
            if not len(start) or (within_a_step and len(start) > _MOST_PIECES):
                break
            middle = (start + end) / 2
            middle = np.where(end - start > 1, np.floor(middle), middle)
            between = self._at(middle)
            start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
            here, there = np.hstack([here, between]), np.hstack([between, there])
        doubtful = self._doubtful(start, end, here, there) & ~self._touches(start) & ~self._touches(end)
        change = doubtful & (here[0] != there[0])
        interval = self._path.before(start)
        self.undecided = np.setdiff1d(interval[doubtful & ~change], interval[change])
        order = np.flatnonzero(change)[np.argsort(start[change])]
        interval = interval[order]
        return interval, start[order] - interval, end[order] - interval

    def bisected(self, interval: NDArray[np.intp], low: Array, high: Array) -> Array:
        """Returns (k,) tau at which g changes its sign within pieces of the path."""
        sign = self._positive(interval, low)
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            same = self._positive(interval, middle) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return (low + high) / 2

    def _doubtful(self, start: Array, end: Array, here: Array, there: Array) -> NDArray[np.bool_]:
        """Returns whether the balls about the ends of pieces do not cover them."""
        return np.asarray(~(self._path.lengths(start, end) < here[1] + there[1]))

    def _at(self, place: Array) -> Array:
        """Returns (2, k) whether g is positive, and the radius that is free of singular poses."""
        interval = self._path.before(place)
        poses = self._path.poses(interval, place - interval)
        return np.stack([self._set.values(*poses) > 0, self._set.free_radius(*poses)])

    def _positive(self, interval: NDArray[np.intp], tau: Array) -> NDArray[np.bool_]:
        return np.asarray(self._set.values(*self._path.poses(interval, tau)) > 0)

    def _touches(self, place: Array) -> NDArray[np.bool_]:
        """Returns whether these are singular samples, where the sign of g is rounding."""
        whole = place.astype(np.intp)
        return np.asarray((place == whole) & self._singular[whole])
