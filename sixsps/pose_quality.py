"""How well a mechanism works in a pose: conditioning, forces and errors that it magnifies."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixsps.arguments import mechanism_of
from sixsps.arrays import Array, frozen
from sixsps.errors import InputError
from sixsps.margins import leg_vectors
from sixsps.mechanism import Mechanism
from sixsps.pose_arrays import pose_arrays
from sixsps.rotation import cross
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# What a characteristic length may be off the mechanism's by: all poses are singular long before.
_FACTOR = 1e20
# Samples whose arrays stay in the cache.
_BLOCK = 1024
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
        poses: a motion of n samples, what `forward_kinematics` or `assembly_modes` returns, one pose, a list
            of n poses, or a pair of positions (n, 3) [m] and rotation matrices (n, 3, 3) or quaternions
            (n, 4) w, x, y, z.
        length: characteristic length [m]; by default the mechanism's, the root mean square distance of the
            platform anchors from O1.

    Raises:
        MotionError: not poses.
        InputError: a length that is not above 0, or not a mechanism.
    """
    position, rotation = pose_arrays(poses)
    size = characteristic_length(mechanism_of(mechanism), length)
    starts = range(0, max(len(position), 1), _BLOCK)
    blocks = [(position[start : start + _BLOCK], rotation[start : start + _BLOCK]) for start in starts]
    columns = zip(*(_block(mechanism, *block, size) for block in blocks), strict=True)
    return Quality(size, *(np.concatenate(column) for column in columns))


def characteristic_length(mechanism: Mechanism, length: float | None) -> float:
    """Returns a characteristic length [m] as given, or the mechanism's.

    Raises:
        InputError: not a length, or one so far from the mechanism's that determinants leave float64.
    """
    own = mechanism.characteristic_length
    if length is None:
        return own
    size = float(frozen(length, (), "length", InputError))
    if not own / _FACTOR <= size <= own * _FACTOR:
        raise InputError("length", length, f"{own / _FACTOR:.3g} to {own * _FACTOR:.3g} [m]")
    return size


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
