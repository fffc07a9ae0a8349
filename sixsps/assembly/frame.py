"""Coordinates in which a mechanism is of size one about its centres, and the way back to its poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.assembly.start_systems import Complex, legs_from

# Root mean square of the start systems' anchors, which have three coordinates of variance one.
_SIZE = math.sqrt(3.0)
_UNIT = 2.0**-53
# Of the mapping back: a product of quaternions, a rotation of a centre and two sums, generously.
_ROUNDINGS = 64


@dataclass(frozen=True, eq=False)
class Frame:
    """Anchors about their centres, in units of a power of two; a pose is moved there and back.

    Attributes:
        base: (6, 3) base anchors.
        platform: (6, 3) platform anchors.
        lengths: (6,) leg lengths.
        base_centre: (3,) subtracted from the base anchors [m].
        platform_centre: (3,) subtracted from the platform anchors [m].
        scale: of the unit [m], a power of two.
        base_lost: (6, 3) what rounding took from the base anchors.
        platform_lost: (6, 3) what it took from the platform anchors.
    """

    base: Array
    platform: Array
    lengths: Array
    base_centre: Array
    platform_centre: Array
    scale: float
    base_lost: Array
    platform_lost: Array

    @classmethod
    def of(cls, base: Array, platform: Array, lengths: Array) -> Frame:
        """Returns the frame of a mechanism.

        Args:
            base: (6, 3) base anchors [m].
            platform: (6, 3) platform anchors [m].
            lengths: (6,) leg lengths [m].
        """
        centres = base.mean(axis=0), platform.mean(axis=0)
        a, b = base - centres[0], platform - centres[1]
        lost = _low_sum(base, -centres[0]), _low_sum(platform, -centres[1])
        size = math.sqrt(float(np.sum(a**2) + np.sum(b**2)) / 12)
        scale = 2.0 ** round(math.log2(size / _SIZE))
        return cls(a / scale, b / scale, lengths / scale, *centres, scale, *(one / scale for one in lost))

    @property
    def legs(self) -> Complex:
        """(6, 7) d, m and l^2 of the legs."""
        return legs_from(self.base, self.platform, self.lengths**2)

    @property
    def low(self) -> Array:
        """(6, 7) what the legs lack of the exact d, m and l^2."""
        return np.concatenate([*self._low_anchors(), _low_square(self.lengths)[:, None]], axis=1)

    def _low_anchors(self) -> tuple[Array, Array]:
        a, b = self.base, self.platform
        lost = self.base_lost, self.platform_lost
        return _low_sum(a, -b) + (lost[0] - lost[1]), _low_sum(a, b) + (lost[0] + lost[1])

    @property
    def reach(self) -> Array:
        """(6, 3) |a| + |b|, which bounds d and m and, by roundoff, their errors."""
        return np.abs(self.base) + np.abs(self.platform)

    def poses(self, x: Array) -> tuple[Array, Array, Array]:
        """Returns positions (n, 3) [m], quaternions (n, 4) and rotations (n, 3, 3) at (e, G).

        Args:
            x: (n, 8) real coordinates.
        """
        e, g = x[:, :4], x[:, 4:]
        length = np.sqrt(np.sum(e**2, axis=1, keepdims=True))
        first = np.take_along_axis(e, np.argmax(e != 0, axis=1)[:, None], axis=1)
        length = np.where(first < 0, -length, length)
        q, g = e / length, g / length
        turn = rotations(q)
        # P = G e*
        local = q[:, :1] * g[:, 1:] - g[:, :1] * q[:, 1:] - np.cross(g[:, 1:], q[:, 1:])
        position = self.scale * local + self.base_centre - turn @ self.platform_centre
        return position, q, turn

    def radii(self, x: Array, radius: Array) -> tuple[Array, Array]:
        """Returns how far at most a pose is from the stated one: (n,) in position [m], (n,) in angle [rad].

        Args:
            x: (n, 8) real centres.
            radius: (n,) of the balls about them, in the maximum norm.
        """
        e, g = (np.sqrt(np.sum(part**2, axis=1)) for part in (x[:, :4], x[:, 4:]))
        apart = 2 * radius  # Euclidean, of four numbers
        angle = 2 * np.arcsin(np.minimum(apart / e, 1)) + _ROUNDINGS * _UNIT
        local = apart * (1 + g / e) / np.maximum(e - apart, 0)
        centres = np.array([math.hypot(*self.base_centre), math.hypot(*self.platform_centre)])
        rounding = _ROUNDINGS * _UNIT * (self.scale * g / e + centres.sum())
        return self.scale * local + centres[1] * angle + rounding, angle


def rotations(q: Array) -> Array:
    """Returns the matrices (n, 3, 3) of quaternions (n, 4) of length one."""
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _low_sum(a: Array, b: Array) -> Array:
    """Returns what rounding takes from a + b."""
    total = a + b
    other = total - a
    return (a - (total - other)) + (b - other)


def _low_square(a: Array) -> Array:
    """Returns what rounding takes from a^2."""
    c = (2.0**27 + 1) * a
    high = c - (c - a)
    rest = a - high
    return ((high * high - a * a) + 2 * (high * rest)) + rest * rest
