"""Many paths at once, on threads."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.assembly.tracker import ARRIVED, track_paths

Complex = NDArray[np.complex128]

# Paths that a thread takes at a time: some tenths of a millisecond.
_SHARE = 2


@dataclass(frozen=True)
class Settings:
    """How carefully paths are followed.

    Attributes:
        tolerance: of the series' last terms, relative to the coordinates.
        contraction: second correction over the first, at most.
        least_step: along the line from 0 to 1; below it a path has stalled.
        most_steps: after so many a path is lost.
    """

    tolerance: float = 3e-3
    contraction: float = 0.04
    least_step: float = 1e-7
    most_steps: int = 400


@dataclass(frozen=True, eq=False)
class Paths:
    """Where n paths ended.

    Attributes:
        ends: (n, 8) coordinates where each ended, at the last place that it reached.
        status: (n,) ARRIVED, STALLED or LOST.
        steps: (n,) taken.
        places: (n,) how far each came, from 0 to 1.
    """

    ends: Complex
    status: NDArray[np.int64]
    steps: NDArray[np.int64]
    places: Array

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """(n,) whether each came to its end."""
        return self.status == ARRIVED


def follow(start: Complex, end: Complex, solutions: Complex, settings: Settings) -> Paths:
    """Follows solutions of one mechanism to those of another.

    Args:
        start: (6, 7) legs of which the solutions are.
        end: (6, 7) legs.
        solutions: (n, 8).
        settings: how carefully.
    """
    n = len(solutions)
    given = tuple(np.ascontiguousarray(array, np.complex128) for array in (start, end, solutions))
    ends = np.zeros((n, 8), np.complex128)
    facts, places = np.zeros((n, 2), np.int64), np.zeros(n)
    limits = (settings.tolerance, settings.contraction, settings.least_step, float(settings.most_steps))
    turns = count(0, _SHARE)

    def work() -> None:
        for first in _until(turns, n):
            track_paths(*given, first, min(first + _SHARE, n), limits, ends, facts, places)

    threads = [Thread(target=work) for _ in range(min(_threads(), -(-n // _SHARE)) - 1)]
    for thread in threads:
        thread.start()
    work()
    for thread in threads:
        thread.join()
    return Paths(ends, facts[:, 0], facts[:, 1], places)


def _until(turns: Iterator[int], end: int) -> Iterator[int]:
    for first in turns:
        if first >= end:
            return
        yield first


def _threads() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
