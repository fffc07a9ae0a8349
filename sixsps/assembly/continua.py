"""Sets of poses that a path ended in: how many dimensions they have, and a real pose in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sixsps.arrays import Array
from sixsps.assembly.start_systems import Complex

# Singular values below that, relative to the largest, are zeros: ends are known to some 1e-8.
_ZERO = 1e-6
# How far along the null directions another solution is looked for, in coordinates of length one.
_STEP = 1e-2
# Gauss-Newton squares the residual, or quarters it on a double set; where it does neither, there is no set.
_CORRECTIONS, _SHRINK = 50, 0.7
# What rounding leaves of the equations.
_ROUNDING = 1e-13
_DIRECTIONS = 4
_SEED = 20151101


@dataclass(frozen=True, eq=False)
class System:
    """The seven equations of a mechanism with given lengths.

    Attributes:
        maps: (6, 4, 4) L of the legs.
        squares: (6,) l^2.
    """

    maps: Any
    squares: Any

    @classmethod
    def of(cls, legs: Complex) -> System:
        """Returns the equations of legs (6, 7); real where these are."""
        rows = legs if legs.imag.any() else legs.real
        zero = np.zeros(6)
        d0, d1, d2, m0, m1, m2 = rows[:, :6].T
        maps = [[zero, d0, d1, d2], [-d0, zero, m2, -m1], [-d1, -m2, zero, m0], [-d2, m1, -m0, zero]]
        return cls(np.moveaxis(np.array(maps), -1, 0), rows[:, 6])

    def values(self, x: Any) -> tuple[Any, Any]:
        """Returns the equations at x (8,) and their derivative (7, 8)."""
        e, g = x[:4], x[4:]
        v = g + self.maps @ e
        values, rows = np.empty(7, v.dtype), np.empty((7, 8), v.dtype)
        values[:6] = ((v * v).sum(axis=1) - self.squares * (e @ e)) / 2
        values[6] = e @ g
        rows[:6, :4] = (v[:, None] @ self.maps)[:, 0] - self.squares[:, None] * e
        rows[:6, 4:] = v
        rows[6, :4], rows[6, 4:] = g, e
        return values, rows

    def deficit(self, x: Any) -> int:
        """Returns how many dimensions the set of solutions through x (8,) has at most."""
        sizes = np.linalg.svd(self.values(x)[1], compute_uv=False)
        return int(np.sum(sizes < _ZERO * sizes[0]))

    def dimension(self, x: Any) -> int:
        """Returns how many dimensions the set of solutions through x (8,) has; 0 where x is isolated.

        Points shortly off x in null directions of the derivative are moved to the nearest solution: those of
        an isolated one come back, or there is none.
        """
        most = self.deficit(x)
        if not most:
            return 0
        _, _, rows = np.linalg.svd(self.values(x)[1])
        null = rows[7 - most :].conj()
        null = null - np.outer(null @ x.conj(), x)
        for free in range(most, 0, -1):
            points = self._around(x, null, free)
            moves = np.array([point / (x.conj() @ point) - x for point in points])
            sizes = np.linalg.svd(moves, compute_uv=False) if points else np.zeros(1)
            if sizes[0] > _STEP / 4:
                # several sets may cross at x: none has more dimensions than there are at its other points
                there = max(self.deficit(point) for point in points)
                return min(int(np.sum(sizes > _STEP / 4)), max(there, 1))
        return 0

    def _around(self, x: Any, null: Any, free: int) -> list[Any]:
        """Returns solutions shortly off x, of length one; none where the first is not found."""
        random = np.random.default_rng(_SEED)
        points: list[Any] = []
        for _ in range(_DIRECTIONS):
            weights = random.standard_normal(len(null)) + 1j * random.standard_normal(len(null))
            direction = (weights if np.iscomplexobj(x) else weights.real) @ null
            found = self.nearest(x + _STEP * direction / np.linalg.norm(direction), free)
            if found is not None:
                points.append(found)
            elif not points:
                break
        return points

    def nearest(self, x: Any, free: int) -> Any:
        """Returns a solution near x in a set of `free` dimensions, of length one, or None."""
        rank, before = 7 - free, np.inf
        for _ in range(_CORRECTIONS):
            x = x / np.linalg.norm(x)
            values, rows = self.values(x)
            left_over = np.abs(values).max()
            if left_over < _ROUNDING:
                return x
            if left_over > _SHRINK * before:
                return None
            before = left_over
            left, sizes, right = np.linalg.svd(rows, full_matrices=False)
            if not sizes[rank - 1] > 0:
                return None
            x = x - right[:rank].conj().T @ ((left[:, :rank].conj().T @ values) / sizes[:rank])
        return None

    def real_point(self, x: Complex, free: int) -> Array | None:
        """Returns a real solution (8,) in the set through x, or None where none was found."""
        for angle in np.pi * np.arange(2 * _DIRECTIONS) / (2 * _DIRECTIONS):
            found = self.nearest((x * np.exp(1j * angle)).real, free)
            if found is not None and np.linalg.norm(found[:4]) > _ZERO:
                return np.asarray(found)
        return None
