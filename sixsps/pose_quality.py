"""How well a mechanism works in a pose: conditioning, forces and errors that it magnifies."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array, frozen
from sixsps.errors import InputError, MotionError
from sixsps.margins import leg_vectors
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.pose import Pose
from sixsps.rotation import cross
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# Samples whose arrays stay in the cache.
_BLOCK = 1024
# A matrix further from orthogonal than this was not meant as a rotation.
_ORTHOGONAL = 1e-6
# Of the 64 corners of a cube of errors, those that are not the opposite of another.
_CORNERS = np.array([(1.0, *signs) for signs in itertools.product((1.0, -1.0), repeat=5)])


@dataclass(frozen=True, eq=False)
class Quality:
    """Quality of n poses. J is the Jacobian, its angular columns over `characteristic_length`.

    Everything that needs J inverted is NaN where the pose is singular (condition number above 1e12).

    Attributes:
        characteristic_length: that all figures without a unit are stated with [m].
        singular_values: (n, 6) of J, largest first; NaN where a leg has no length. The last one is the
            distance, in the 2-norm, from J to the nearest singular matrix.
        condition: (n,) the largest over the least of them; infinite in a singular pose.
        manipulability: (n,) sqrt(det(J J^T)), which is |det J| (Yoshikawa 1985).
        determinant_sign: (n,) of det J, -1 or 1; 0 where the pose is singular.
        force_per_force: (n, 6) largest leg force per force on the platform at O1 [N/N].
        force_per_moment: (n, 6) largest leg force per moment on the platform [N/(N m)].
        position_error: (n,) largest displacement of O1 per error of the leg lengths, all six off by up to
            that much in the worst of ways [m/m].
        orientation_error: (n,) largest rotation per such error [rad/m].
    """

    characteristic_length: float
    singular_values: Array
    condition: Array
    manipulability: Array
    determinant_sign: Array
    force_per_force: Array
    force_per_moment: Array
    position_error: Array
    orientation_error: Array

    @property
    def dexterity(self) -> Array:
        """(n,) 1 / condition: 1 where the platform moves alike in all directions, 0 in a singular pose."""
        return 1 / self.condition

    def __len__(self) -> int:
        return len(self.condition)


def quality(mechanism: Mechanism, poses: Any, length: float | None = None) -> Quality:
    """Returns the quality of poses of a mechanism.

    Args:
        mechanism: geometry.
        poses: a motion of n samples, one pose, a list of n poses, or a pair of positions (n, 3) [m] and
            rotation matrices (n, 3, 3).
        length: characteristic length [m]; by default the mechanism's, the root mean square distance of the
            platform anchors from O1.

    Raises:
        MotionError: not poses.
        InputError: a length that is not above 0.
    """
    position, rotation = pose_arrays(poses)
    size = mechanism.characteristic_length
    if length is not None:
        size = float(frozen(length, (), "length", InputError))
        if size <= 0:
            raise InputError("length", length, "> 0 [m]")
    starts = range(0, max(len(position), 1), _BLOCK)
    blocks = [(position[start : start + _BLOCK], rotation[start : start + _BLOCK]) for start in starts]
    columns = zip(*(_block(mechanism, *block, size) for block in blocks), strict=True)
    return Quality(size, *(np.concatenate(column) for column in columns))


def pose_arrays(poses: Any) -> tuple[Array, Array]:
    """Returns positions (n, 3) [m] and rotation matrices (n, 3, 3) of what `quality` takes for poses.

    Raises:
        MotionError: not poses.
    """
    if isinstance(poses, Motion):
        return poses.position, poses.rotation
    if isinstance(poses, Pose):
        return poses.position[None], poses.rotation[None]
    if isinstance(poses, tuple | list) and poses:
        if len(poses) == 2 and _rank(poses[0]) == 2:
            return _checked(*poses)
        # One pair of position and orientation, or poses one by one.
        each = [Pose.of(pose) for pose in ([poses] if _rank(poses[0]) == 1 else poses)]
        return np.array([pose.position for pose in each]), np.array([pose.rotation for pose in each])
    return pose_arrays(Pose.of(poses))


def _rank(value: Any) -> int:
    """Returns the number of dimensions of numbers, -1 of what is no array of such."""
    try:
        array = np.asarray(value)
    except ValueError:  # a position and an orientation, which differ in shape
        return -1
    return array.ndim if array.dtype.kind in "iuf" else -1


def _checked(positions: Any, rotations: Any) -> tuple[Array, Array]:
    position = frozen(positions, (None, 3), "position", MotionError)
    rotation = frozen(rotations, (len(position), 3, 3), "rotation", MotionError)
    off = np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max(axis=(1, 2))
    wrong = (off > _ORTHOGONAL) | (np.linalg.det(rotation) < 0)
    if wrong.any():
        index = int(np.argmax(wrong))
        allowed = "orthogonal matrices of determinant +1"
        raise MotionError(f"rotation, index {index}", rotation[index].tolist(), allowed)
    return position, rotation


def jacobians(mechanism: Mechanism, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Returns (n, 6, 6) Jacobians, length_rates = jacobian @ twist, and (n, 6) leg lengths [m]."""
    legs = leg_vectors(mechanism, position, rotation)
    lengths = np.linalg.norm(legs, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        directions = legs / lengths[..., None]
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    return np.concatenate([directions, cross(arms, directions)], axis=-1), lengths


def singular_samples(
    mechanism: Mechanism, position: Array, rotation: Array, length: float
) -> NDArray[np.bool_]:
    """Returns (n,) whether poses are singular: condition number above 1e12, or a leg without direction.

    Args:
        mechanism: geometry.
        position: (n, 3) [m].
        rotation: (n, 3, 3).
        length: characteristic length [m].
    """
    found = np.zeros(len(position), dtype=bool)
    for start in range(0, len(position), _BLOCK):
        block = slice(start, start + _BLOCK)
        J, lengths = jacobians(mechanism, position[block], rotation[block])
        found[block] = ~(condition_numbers(J, lengths, length) <= SINGULAR_CONDITION)
    return found


def _block(mechanism: Mechanism, position: Array, rotation: Array, size: float) -> tuple[Array, ...]:
    J, lengths = jacobians(mechanism, position, rotation)
    condition = condition_numbers(J, lengths, size)
    regular = condition <= SINGULAR_CONDITION
    directed = (lengths > size / SINGULAR_CONDITION).all(axis=1)
    J = J / np.repeat([1.0, size], 3)
    singular_values = np.full((len(J), 6), np.nan)
    singular_values[directed] = np.linalg.svd(J[directed], compute_uv=False)
    sign = np.zeros(len(J))
    sign[regular] = np.sign(np.linalg.det(J[regular]))
    inverse = np.full(J.shape, np.nan)
    inverse[regular] = np.linalg.inv(J[regular])
    linear, angular = inverse[:, :3], inverse[:, 3:] / size
    condition = np.where(regular, condition, np.inf)
    return (
        singular_values, condition, singular_values.prod(axis=1), sign,
        np.linalg.norm(linear, axis=1), np.linalg.norm(angular, axis=1),
        _largest(linear), _largest(angular),
    )  # fmt: skip


def _largest(matrices: Array) -> Array:
    """Returns max |matrix @ e| over all e with entries within -1..1, which a corner of that cube attains."""
    return np.linalg.norm(np.einsum("nij,kj->nki", matrices, _CORNERS), axis=-1).max(axis=1)
