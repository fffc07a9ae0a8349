"""Poses by leg lengths: the kernels of forward kinematics with one mechanism's geometry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.errors import InputError, MechanismError
from sixsps.home import home_position
from sixsps.kernels.forward_kinematics import FOUND, geometry_of, same, track
from sixsps.kernels.sharing import shared
from sixsps.mechanism import Mechanism

# Samples that follow on each other; as many at any number of threads, so that no bit depends on that.
_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class Found:
    """What became of n samples; see `sixsps.ForwardKinematics`."""

    position: Array
    quaternion: Array
    reason: NDArray[np.uint8]
    iterations: NDArray[np.int32]
    residual: Array

    @classmethod
    def space(cls, n: int) -> Found:
        """Returns arrays for n samples."""
        reason, iterations = np.empty(n, np.uint8), np.empty(n, np.int32)
        return cls(np.empty((n, 3)), np.empty((n, 4)), reason, iterations, np.empty(n))

    @property
    def arrays(self) -> tuple[Array, Array, NDArray[np.uint8], NDArray[np.int32], Array]:
        """As the kernel takes them."""
        return self.position, self.quaternion, self.reason, self.iterations, self.residual


class PoseFinder:
    """The kernels with the geometry of a mechanism; may be called from several threads at once."""

    def __init__(self, mechanism: Mechanism, threads: int) -> None:
        self.mechanism = mechanism
        self._geometry = geometry_of(mechanism.base_anchors, mechanism.platform_anchors)
        self._threads = threads

    @cached_property
    def home(self) -> Array:
        """(7,) home position [m] and the quaternion of no rotation.

        Raises:
            InputError: the mechanism has no length limits, and so no home position.
        """
        try:
            return np.concatenate([home_position(self.mechanism), [1.0, 0.0, 0.0, 0.0]])
        except MechanismError as error:
            allowed = f"a pose: without {error.place} the mechanism has no home pose to start from"
            raise InputError("guess", "missing", allowed) from None

    def one(self, lengths: Array, first: Array, most: int) -> Found:
        """Finds the pose of lengths that nobody has checked: (6,), C-contiguous."""
        found = Found.space(1)
        track(self._geometry, lengths[None], first.copy(), found.arrays, 0, 1, most)
        return found

    def along(self, lengths: Array, first: Array, most: int) -> Found:
        """Finds pose after pose, each from the last one that was found.

        Chunks are worked on at the same time, from first samples that are found beforehand, each from that
        of the chunk before. Where it turns out that the end of the chunk before leads to another pose, or
        to none, the chunk is done again from there.

        Args:
            lengths: (n, 6) C-contiguous [m].
            first: (7,) position [m] and quaternion that the first sample is reached from.
            most: iterations of a sample.
        """
        n = len(lengths)
        found, starts = Found.space(n), range(0, n, _CHUNK)
        lasts = list(self._heads(lengths, first, most)) if n > _CHUNK else [first.copy()]

        def chunk(start: int) -> None:
            stop = min(start + _CHUNK, n)
            track(self._geometry, lengths, lasts[start // _CHUNK], found.arrays, start, stop, most)

        shared(chunk, starts, self._threads)
        for number, start in list(enumerate(starts))[1:]:
            if not self._goes_on(lasts[number - 1], lengths[start : start + 1], found, start, most):
                lasts[number] = lasts[number - 1].copy()
                chunk(start)
        return found

    def each(self, lengths: Array, guesses: Array, most: int) -> Found:
        """Finds every sample's pose from a guess of its own.

        Args:
            lengths: (n, 6) C-contiguous [m].
            guesses: (n, 7) positions [m] and quaternions.
            most: iterations of a sample.
        """
        found = Found.space(len(lengths))

        def chunk(start: int) -> None:
            for n in range(start, min(start + _CHUNK, len(lengths))):
                track(self._geometry, lengths, guesses[n].copy(), found.arrays, n, n + 1, most)

        shared(chunk, range(0, len(lengths), _CHUNK), self._threads)
        return found

    def _heads(self, lengths: Array, first: Array, most: int) -> Iterator[Array]:
        """Yields what each chunk may start from: the pose of its first sample, or the last one found."""
        rows = np.ascontiguousarray(lengths[::_CHUNK])
        heads, last = Found.space(len(rows)), first.copy()
        track(self._geometry, rows, first.copy(), heads.arrays, 0, len(rows), most)
        yield last.copy()
        for number in range(1, len(rows)):
            if heads.reason[number] == FOUND:
                last = np.concatenate([heads.position[number], heads.quaternion[number]])
            yield last.copy()

    def _goes_on(self, last: Array, row: Array, found: Found, start: int, most: int) -> bool:
        """Whether the first sample of a chunk is what the last pose before it leads to."""
        if found.reason[start] != FOUND:
            return False
        one = Found.space(1)
        track(self._geometry, row, last.copy(), one.arrays, 0, 1, most)
        here = np.concatenate([found.position[start], found.quaternion[start]])
        there = np.concatenate([one.position[0], one.quaternion[0]])
        return bool(one.reason[0] == FOUND and same(self._geometry, here, there))
