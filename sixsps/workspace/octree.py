"""Leaves of an octree: where they are, which one holds a point, which ones touch."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

# Levels of halving: three interleaved coordinates of so many bits fill an integer.
DEEPEST = 20
CORNERS: Integers = np.array(list(product((0, 1), repeat=3)), dtype=np.int64)
"""(8, 3) the corners of a cell, 0 on the lower side."""


def morton(points: Integers) -> Integers:
    """Returns (n,) interleaved bits of (n, 3) coordinates in [0, 2^21)."""
    code = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        bits = points[:, axis].astype(np.int64)
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | (bits << shift)) & mask
        code |= bits << axis
    return code


class Leaves:
    """Disjoint cells of an octree, to find points in.

    Args:
        index: (n, 3) integer coordinates of the cells on their levels.
        level: (n,) how often the root was halved.
    """

    def __init__(self, index: Integers, level: Integers) -> None:
        self.width = np.left_shift(1, DEEPEST - level)
        self.low = index * self.width[:, None]
        starts = morton(self.low)
        self._order = np.argsort(starts)
        self._starts = starts[self._order]
        self._ends = self._starts + self.width[self._order] ** 3

    def holding(self, points: Integers) -> Integers:
        """Returns the leaf that holds the unit cube above each of (n, 3) points of the finest grid, or -1."""
        inside = np.asarray(((points >= 0) & (points < 1 << DEEPEST)).all(axis=1))
        codes = morton(np.where(inside[:, None], points, 0))
        place = np.maximum(np.searchsorted(self._starts, codes, side="right") - 1, 0)
        found = inside & (codes >= self._starts[place]) & (codes < self._ends[place])
        return np.where(found, self._order[place], -1)

    def parts(self, corners: Booleans, whole: Booleans) -> Integers:
        """Labels the parts that hang together through points.

        Args:
            corners: (n, 8) the corners that each leaf contains.
            whole: (n,) leaves that contain everything in their cells.

        Returns:
            (n,) labels; leaves with one label are joined by points that each of two neighbours contains.
        """
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        n = len(self.low)
        leaf, corner = np.nonzero(corners)
        points = self.low[leaf] + CORNERS[corner] * self.width[leaf, None]
        # 21 bits hold the far ends of the grid as well.
        _, first, vertex = np.unique(morton(points), return_index=True, return_inverse=True)
        rows, columns = [leaf], [n + vertex]
        for offset in CORNERS - 1:
            around = self.holding(points[first] + offset)
            joined = np.flatnonzero((around >= 0) & whole[around])
            rows.append(around[joined])
            columns.append(n + joined)
        i, j = np.concatenate(rows), np.concatenate(columns)
        size = n + len(first)
        graph = coo_matrix((np.ones(len(i), dtype=np.int8), (i, j)), shape=(size, size))
        return connected_components(graph, directed=False)[1][:n].astype(np.int64)
