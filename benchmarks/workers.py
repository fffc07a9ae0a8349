"""Threads that share a loop, started once: what is timed is the loop."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def processors() -> int:
    """Returns how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_counts() -> list[int]:
    """Returns 1, 2, 4, .. and the number of processors, none of them twice."""
    most = processors()
    return sorted({most, *(2**k for k in range(most.bit_length()) if 2**k <= most)})


class Workers:
    """Threads that wait for work; a single one is the caller's own.

    Args:
        count: number of threads.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = ThreadPoolExecutor(count) if count > 1 else None

    def share(self, loop: Callable[[int, int], Any], n: int) -> list[Any]:
        """Returns what loop(start, stop) returns for an even share of 0..n a thread."""
        bounds = [n * k // self.count for k in range(self.count + 1)]
        if self._pool is None:
            return [loop(0, n)]
        return list(self._pool.map(loop, bounds[:-1], bounds[1:]))
