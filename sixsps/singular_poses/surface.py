"""The set of singular poses as the zeros of one smooth function, and a ball that is free of them.

The rows [S_i, c_i x S_i] of a leg are l_i times those of the Jacobian. Their determinant g is polynomial in
the position and the rotation matrix, smooth also where a leg has no length, and zero where the pose is
singular or a leg has no direction. Here all lengths are in units of the characteristic length L, such that
a displacement and a rotation of one radian weigh the same: the distance of two poses is
sqrt(|dp|^2 + (L theta)^2) / L, theta being the angle that turns one orientation into the other.
"""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.rotation import cross, skew
from sixsps.singularity import SINGULAR_CONDITION

# Below this angle the series of (1 - cos)/angle^2 and (angle - sin)/angle^3 are as good as a float64.
_SMALL = 1e-4
# Of the angular columns, over L, for the bound of the distance.
_UNITS = (0.3, 1.0, 3.0)


class SingularSet:
    """The singular poses of a mechanism.

    Args:
        mechanism: geometry.
        length: characteristic length L [m].
    """

    def __init__(self, mechanism: Mechanism, length: float) -> None:
        self.length = length
        self._base = mechanism.base_anchors / length
        self._platform = mechanism.platform_anchors / length

    def matrices(self, position: Array, rotation: Array) -> Array:
        """Returns (n, 6, 6) rows [S_i, c_i x S_i].

        Args:
            position: (n, 3) in units of L.
            rotation: (n, 3, 3).
        """
        c = np.einsum("nij,kj->nki", rotation, self._platform)
        q = position[:, None] - self._base
        return np.concatenate([q + c, cross(c, q)], axis=-1)

    def values(self, position: Array, rotation: Array) -> Array:
        """Returns (n,) g, for poses as in `matrices`."""
        return np.linalg.det(self.matrices(position, rotation))

    def gradients(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Returns (n,) g and (n, 6) its derivatives by displacement and small rotation in world axes.

        From the cofactors of the matrix, by its singular values, which also holds in singular poses.
        """
        c = np.einsum("nij,kj->nki", rotation, self._platform)
        q = position[:, None] - self._base
        U, sigma, Vt = np.linalg.svd(np.concatenate([q + c, cross(c, q)], axis=-1))
        sign = np.linalg.det(U) * np.linalg.det(Vt)
        others = np.stack([np.delete(sigma, k, axis=1).prod(axis=1) for k in range(6)], axis=1)
        cofactors = np.einsum("nik,nk,nkj->nij", U, sign[:, None] * others, Vt)
        linear, angular = cofactors[..., :3], cofactors[..., 3:]
        by_place = (linear + cross(angular, c)).sum(axis=1)
        by_turn = cross(c, linear + cross(q, angular)).sum(axis=1)
        return sign * sigma.prod(axis=1), np.concatenate([by_place, by_turn], axis=1)

    def free_radius(self, position: Array, rotation: Array) -> Array:
        """Returns (n,) radii in units of L of balls that hold no singular pose, for certain up to rounding.

        Let M be the matrix with rows over the leg lengths l_i of the pose in the middle, M_0 there, and
        W its inverse. Where M z = 0, z = -W (M - M_0) z, so that the norm of W (M - M_0) is at least 1
        in every singular pose. With q_i = P - A_i and D_i the displacement of c_i by a rotation theta n,
        l_i (row i of M - M_0) = [dp + D_i, c_i x dp + D_i x q_i + D_i x dp], and D_i = theta n x c_i up to
        |b_i| theta^2 / 2 (Taylor). The part that is linear in x = (dp, theta n) has a Frobenius norm of at
        most k_1 |x|, k_1^2 being the largest eigenvalue of a Gram matrix; row i of the remainder is at
        most |b_i| (sqrt(1 + |q_i|^2) theta^2 / 2 + theta |dp|), a quadratic form, and so in all no more
        than k_2 |x|^2. No x with k_1 |x| + k_2 |x|^2 < 1 leads to a singular pose. All this holds with
        any unit of the angular columns of M; the largest radius of some units is taken.

        Args:
            position: (n, 3) in units of L.
            rotation: (n, 3, 3).
        """
        M = self.matrices(position, rotation)
        lengths = np.linalg.norm(M[..., :3], axis=-1, keepdims=True)
        radius = np.zeros(len(M))
        regular = np.flatnonzero((lengths > 0).all(axis=(1, 2)))
        M, lengths = M[regular], lengths[regular]
        M = M / lengths
        invertible = np.linalg.cond(M) <= SINGULAR_CONDITION
        regular, M, lengths = regular[invertible], M[invertible], lengths[invertible]
        linear = self.derivatives(position[regular], rotation[regular]) / lengths[:, None]
        remainder = self.remainders(position[regular]) / lengths[..., 0]
        W = np.linalg.inv(M)
        for unit in _UNITS:
            columns = np.repeat([1.0, unit], 3)
            scaled = W * columns[:, None]
            moved = np.einsum("nij,nkjl->nkil", scaled, linear / columns).reshape(len(M), 6, 36)
            first = np.sqrt(np.linalg.eigvalsh(moved @ np.swapaxes(moved, 1, 2))[:, -1])
            largest = max(1.0, 1 / unit)
            by_rows = np.sum(np.linalg.norm(scaled, axis=1) * remainder, axis=1)
            at_once = np.linalg.norm(scaled, 2, axis=(1, 2)) * np.linalg.norm(remainder, axis=1)
            second = largest * np.minimum(by_rows, at_once)
            radius[regular] = np.maximum(radius[regular], 2 / (first + np.sqrt(first**2 + 4 * second)))
        return radius

    def derivatives(self, position: Array, rotation: Array) -> Array:
        """Returns (n, 6, 6, 6) derivatives of `matrices` by the six directions of pose space."""
        c = np.einsum("nij,kj->nki", rotation, self._platform)[:, None]
        q = position[:, None, None] - self._base
        axes = np.eye(3)[:, None]
        shifted = np.concatenate([np.broadcast_to(axes, (len(c), 3, 6, 3)), cross(c, axes)], axis=-1)
        arms = cross(axes, c)
        return np.concatenate([shifted, np.concatenate([arms, cross(arms, q)], axis=-1)], axis=1)

    def remainders(self, position: Array) -> Array:
        """Returns (n, 6) bounds of what rows of `matrices` change beyond first order, over |x|^2."""
        q = np.linalg.norm(position[:, None] - self._base, axis=-1)
        form = np.sqrt(1 + q**2) / 2
        return np.linalg.norm(self._platform, axis=1) * (form + np.sqrt(form**2 + 1)) / 2


def turned(vectors: Array, rotation: Array) -> Array:
    """Returns exp([vectors]x) rotation.

    Args:
        vectors: (n, 3) rotation vectors, world axes [rad].
        rotation: (n, 3, 3).
    """
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    S = skew(vectors)
    half = np.sinc(angle / (2 * np.pi))
    exponential = np.eye(3) + np.sinc(angle / np.pi) * S + half**2 / 2 * (S @ S)
    return exponential @ rotation


def left_jacobians(vectors: Array) -> Array:
    """Returns (n, 3, 3) matrices that turn rates of rotation vectors (n, 3) into angular velocities."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    S = skew(vectors)
    first = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    large = angle > _SMALL
    safe = np.where(large, angle, 1.0)
    second = np.where(large, (safe - np.sin(safe)) / safe**3, 1 / 6 - angle**2 / 120)
    return np.eye(3) + first * S + second * (S @ S)


def rotation_vectors(start: Array, end: Array) -> Array:
    """Returns (n, 3) shortest rotation vectors, world axes, that turn `start` into `end` (n, 3, 3) [rad]."""
    from scipy.spatial.transform import Rotation

    if not len(start):
        return np.empty((0, 3))
    return np.asarray(Rotation.from_matrix(end @ np.swapaxes(start, 1, 2)).as_rotvec())
