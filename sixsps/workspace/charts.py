"""The two spaces that a workspace is sought in, by three parameters that are 0 at the reference pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.rotation import skew
from sixsps.workspace.taylor import Scalars, Vectors

# Gauss points in each direction: the measure of rotations is smooth, a cell is at most 1 rad wide.
_POINTS = 6


class Chart(Protocol):
    """Three parameters of a pose, and what legs and joints do over boxes of them."""

    kind: ClassVar[str]
    unit: ClassVar[str]

    @property
    def mechanism(self) -> Mechanism:
        """Whose poses these are."""

    @property
    def position(self) -> Array:
        """(3,) of the reference pose [m]."""

    @property
    def rotation(self) -> Array:
        """(3, 3) of the reference pose."""

    @property
    def box(self) -> Array:
        """(3, 2) ranges of the parameters."""

    @property
    def root(self) -> tuple[Array, float]:
        """Centre (3,) and half edge of a cube of parameters around the box."""

    def poses(self, parameters: Array) -> tuple[Array, Array]:
        """Returns positions (n, 3) and rotations (n, 3, 3) of (n, 3) parameters."""

    def legs(self, centre: Array, half: Array) -> Vectors:
        """Returns the leg vectors over cells of (n, 3) centres and (n, 3) half widths."""

    def carried(self, vectors: Array, centre: Array, half: Array) -> Vectors:
        """Returns (6, 3) vectors of the platform frame in world axes, over cells."""

    def ends(self, centre: Array, half: Array) -> list[Scalars]:
        """Returns what has to be >= 0 for the parameters to be in their own range."""

    def measure(self, centre: Array, half: Array) -> Array:
        """Returns the (n,) volumes of cubes of (n,) half edges."""

    def glued(self, centre: Array, half: Array) -> NDArray[np.bool_]:
        """Returns (n,) whether cubes of (n,) half edges hold poses that also have other parameters."""

    def density(self, centre: Array, half: Array) -> tuple[Array, Array]:
        """Returns the (n,) least and largest volume by volume of parameters in cubes of (n,) half edges."""


@dataclass(frozen=True, eq=False)
class Translation:
    """Displacements of O1 from `position` at one orientation [m]."""

    mechanism: Mechanism
    position: Array
    rotation: Array

    kind: ClassVar[str] = "translation"
    unit: ClassVar[str] = "m"

    @cached_property
    def _feet(self) -> Array:
        """(6, 3) where O1 is when a leg has no length, from `position`."""
        turned = self.mechanism.platform_anchors @ self.rotation.T
        return (self.mechanism.base_anchors - self.position) - turned

    @cached_property
    def box(self) -> Array:
        """(3, 2) the box that the longest legs leave."""
        longest = self.mechanism.length_limits[:, 1:]
        return np.column_stack([(self._feet - longest).max(axis=0), (self._feet + longest).min(axis=0)])

    @cached_property
    def root(self) -> tuple[Array, float]:
        """A cube around the box."""
        return self.box.mean(axis=1), float(np.ptp(self.box, axis=1).max()) / 2

    def poses(self, parameters: Array) -> tuple[Array, Array]:
        """Returns positions (n, 3) and rotations (n, 3, 3) of (n, 3) parameters."""
        return self.position + parameters, np.broadcast_to(self.rotation, (len(parameters), 3, 3))

    def legs(self, centre: Array, half: Array) -> Vectors:
        """Returns the leg vectors over cells, which are exactly linear."""
        value = centre[:, None] - self._feet
        slope = np.broadcast_to(np.eye(3), (*value.shape, 3))
        move = np.broadcast_to(np.linalg.norm(half, axis=1)[:, None], value.shape[:2])
        return Vectors(value, slope, np.zeros(value.shape[:2]), move)

    def carried(self, vectors: Array, centre: Array, half: Array) -> Vectors:  # noqa: ARG002
        """Returns (6, 3) vectors of the platform frame in world axes, constant."""
        value = np.broadcast_to(vectors @ self.rotation.T, (len(centre), *vectors.shape))
        zero = np.zeros(value.shape[:2])
        return Vectors(value, np.zeros((*value.shape, 3)), zero, zero)

    def ends(self, centre: Array, half: Array) -> list[Scalars]:  # noqa: ARG002
        """Returns nothing: every displacement is one."""
        return []

    def measure(self, centre: Array, half: Array) -> Array:  # noqa: ARG002
        """Returns the (n,) volumes [m^3] of cubes of (n,) half edges."""
        return (2 * half) ** 3

    def glued(self, centre: Array, half: Array) -> NDArray[np.bool_]:  # noqa: ARG002
        """Returns False everywhere."""
        return np.zeros(len(half), dtype=bool)

    def density(self, centre: Array, half: Array) -> tuple[Array, Array]:  # noqa: ARG002
        """Returns ones."""
        return np.ones(len(half)), np.ones(len(half))


@dataclass(frozen=True, eq=False)
class Turning:
    """Rotation vectors r in the ball of radius pi [rad]: orientation exp(r) `rotation` at one position.

    Neighbouring rotation vectors are no further apart as rotations than as vectors, since exp(r + dr) exp(-r)
    turns by at most |dr|. Volumes are Haar's measure, scaled to be dr at r = 0: all rotations have 8 pi^2.
    """

    mechanism: Mechanism
    position: Array
    rotation: Array

    kind: ClassVar[str] = "orientation"
    unit: ClassVar[str] = "rad"

    @property
    def box(self) -> Array:
        """(3, 2) the box around the ball."""
        return np.tile([-math.pi, math.pi], (3, 1))

    @property
    def root(self) -> tuple[Array, float]:
        """The cube around the ball."""
        return np.zeros(3), math.pi

    def poses(self, parameters: Array) -> tuple[Array, Array]:
        """Returns positions (n, 3) and rotations (n, 3, 3) of (n, 3) parameters."""
        return np.broadcast_to(self.position, parameters.shape), exponential(parameters) @ self.rotation

    def legs(self, centre: Array, half: Array) -> Vectors:
        """Returns the leg vectors over cells."""
        arms = self.carried(self.mechanism.platform_anchors, centre, half)
        value = (self.position - self.mechanism.base_anchors) + arms.value
        return Vectors(value, arms.slope, arms.error, arms.move)

    def carried(self, vectors: Array, centre: Array, half: Array) -> Vectors:
        """Returns (6, 3) vectors of the platform frame in world axes, over cells.

        With v = exp(r) v0 and w = J(r) dr, J(r) the mean of exp(t r) over t in [0, 1]: dv = w x v,
        |w| <= |dr| and |ddv| <= |dw| |v| + |w|^2 |v| <= (1/2 + 1) |dr|^2 |v|.
        """
        value = np.einsum("nij,mj->nmi", exponential(centre) @ self.rotation, vectors)
        slope = -skew(value) @ left_jacobian(centre)[:, None]
        size = np.linalg.norm(vectors, axis=1)
        angle = np.linalg.norm(half, axis=1)[:, None]
        move = 2 * size * np.sin(np.minimum(angle, math.pi) / 2)
        return Vectors(value, slope, 0.75 * size * angle**2, move)

    def ends(self, centre: Array, half: Array) -> list[Scalars]:
        """Returns (pi^2 - |r|^2) / (2 pi), the way to the end of the ball."""
        squared = np.sum(centre**2, axis=1, keepdims=True)
        below = -np.sum(half**2, axis=1, keepdims=True) / (2 * math.pi)
        value = (math.pi**2 - squared) / (2 * math.pi)
        return [Scalars(value, -centre[:, None] / math.pi, below, np.zeros_like(below))]

    def measure(self, centre: Array, half: Array) -> Array:
        """Returns the (n,) volumes [rad^3] of cubes of (n,) half edges, by Gauss' rule."""
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        total = np.zeros(len(half))
        for x, a in zip(nodes, weights, strict=True):
            for y, b in zip(nodes, weights, strict=True):
                for z, c in zip(nodes, weights, strict=True):
                    point = centre + half[:, None] * np.array([x, y, z])
                    total += a * b * c * _haar(np.linalg.norm(point, axis=1))
        return total * half**3

    def glued(self, centre: Array, half: Array) -> NDArray[np.bool_]:
        """Returns (n,) whether cubes reach the ball's surface, where opposite points are one rotation."""
        farthest = np.linalg.norm(np.abs(centre) + half[:, None], axis=1)
        return np.asarray(farthest >= math.pi)

    def density(self, centre: Array, half: Array) -> tuple[Array, Array]:
        """Returns the (n,) least and largest density; it falls with the angle."""
        size = np.abs(centre)
        nearest = np.linalg.norm(np.maximum(size - half[:, None], 0.0), axis=1)
        farthest = np.linalg.norm(size + half[:, None], axis=1)
        return _haar(np.minimum(farthest, 2 * math.pi)), _haar(nearest)


def _haar(angle: Array) -> Array:
    return np.sinc(angle / (2 * math.pi)) ** 2


def exponential(vectors: Array) -> Array:
    """Returns the (n, 3, 3) rotations of (n, 3) rotation vectors [rad]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vectors).as_matrix()).reshape(-1, 3, 3)


def left_jacobian(vectors: Array) -> Array:
    """Returns (n, 3, 3) J with exp(r + dr) = exp(J dr) exp(r) for small dr."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    K = skew(vectors)
    first = 0.5 * np.sinc(angle / (2 * math.pi)) ** 2  # (1 - cos a) / a^2
    small = angle < 0.05  # where a - sin a would lose digits
    safe = np.where(small, 1.0, angle)
    series = 1 / 6 - angle**2 / 120 + angle**4 / 5040 - angle**6 / 362880
    second = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * K + second * (K @ K)
