"""This machine's memory bandwidth: the triad a = b + s c on arrays well beyond the last cache.

24 bytes an element are counted, as STREAM does: what is read and written, not the lines of `a` that
are fetched to be overwritten. The bytes of the kernels are counted in the same way.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from benchmarks.machine import last_cache
from benchmarks.workers import Workers
from sixsps.arrays import Array

SCALE = 3.0
BYTES = 24
"""Of one element."""


@njit(nogil=True)
def triad(a, b, c, scale, start, stop):  # type: ignore[no-untyped-def]
    """Sets a[start:stop] to b + scale * c."""
    for k in range(start, stop):
        a[k] = b[k] + scale * c[k]


class Triad:
    """The three arrays, which any number of threads may share.

    Args:
        beyond_cache: size of an array over that of the last cache.
    """

    def __init__(self, beyond_cache: float) -> None:
        n = int(beyond_cache * last_cache() / 8)
        self.a, self.b, self.c = np.zeros(n), np.arange(n, dtype=np.float64), np.ones(n)
        self.bytes = BYTES * n

    def run(self, workers: Workers) -> Array:
        """Returns the first array after one pass."""
        arrays = (self.a, self.b, self.c, SCALE)
        workers.share(lambda start, stop: triad(*arrays, start, stop), len(self.a))
        return self.a
