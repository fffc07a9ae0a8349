"""Real poses that rounding of the lengths may have turned into pairs of complex ones.

Lengths computed at a singular pose are those of a double solution up to rounding, which sets the two apart:
they become two real poses, or a complex pair with imaginary parts of the order of the root of unit roundoff.
There is then no real pose with exactly these lengths, and one with lengths that differ by their rounding.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sixsps.arrays import Array
from sixsps.assembly.continua import System
from sixsps.assembly.frame import Frame
from sixsps.assembly.start_systems import Complex

# Imaginary parts, of coordinates of length one, from which on rounding has not brought them about: of an
# eightfold solution they go with the eighth root.
_NEAR = 1e-2
# Lengths are known to so many units of roundoff of the numbers that they are computed from: a rotation of an
# anchor with a rounded matrix, two sums, three squares and a root.
_ROUNDINGS = 16
_UNIT = 2.0**-53
# Gauss-Newton in the directions in which the legs hold the platform; the others are left as they are.
_CORRECTIONS, _ZERO = 4, 1e-6


def nearly_real(frame: Frame, base: Array, platform: Array, lengths: Array, x: Complex) -> Iterator[Array]:
    """Yields real coordinates (8,) next to complex solutions whose legs have the lengths up to rounding.

    Args:
        frame: of the coordinates.
        base: (6, 3) base anchors [m].
        platform: (6, 3) platform anchors [m].
        lengths: (6,) [m].
        x: (n, 8) solutions that are not real; one is yielded for each that is next to such a pose.
    """
    rounding = _ROUNDINGS * _UNIT * (np.abs(base).max() + np.abs(platform).max() + lengths.max())
    system = System.of(frame.legs)
    for one in x:
        # turned so that the imaginary part is the smallest
        square = one @ one
        turned = one * np.sqrt(np.conj(square) / abs(square)) / np.linalg.norm(one) if square else one
        if np.abs(turned.imag).max() < _NEAR:
            points = list(_polished(system, turned.real))
            residuals = [residual(frame, base, platform, lengths, point) for point in points]
            best = int(np.argmin(residuals))
            if residuals[best] <= rounding:
                yield points[best]


def residual(frame: Frame, base: Array, platform: Array, lengths: Array, x: Array) -> float:
    """Returns the largest |length - given length| [m] at real coordinates x (8,); the others as above."""
    position, _, rotation = (array[0] for array in frame.poses(x[None]))
    legs = position + platform @ rotation.T - base
    return float(np.abs(np.sqrt(np.sum(legs**2, axis=-1)) - lengths).max())


def _polished(system: System, x: Array) -> Iterator[Array]:
    """Yields x (8,), scaled to length one, and corrections of it."""
    for _ in range(_CORRECTIONS):
        x = x / np.linalg.norm(x)
        yield x
        values, rows = _equations(system, x)
        left, sizes, right = np.linalg.svd(rows, full_matrices=False)
        held = sizes > _ZERO * sizes[0]
        x = x - right[held].T @ ((left[:, held].T @ values) / sizes[held])


def _equations(system: System, x: Array) -> tuple[Array, Array]:
    """Returns the equations at x (8,) and their derivatives; for a leg without length that its ends meet.

    The square of its length has no derivative at the solution.
    """
    values, rows = system.values(x)
    none = system.squares == 0
    if not none.any():
        return values, rows
    others = np.append(~none, True)
    ends = np.concatenate([system.maps[none], np.broadcast_to(np.eye(4), (int(none.sum()), 4, 4))], axis=2)
    ends = ends.reshape(-1, 8)
    return np.append(values[others], ends @ x), np.concatenate([rows[others], ends])
