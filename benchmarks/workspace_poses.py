"""Random poses in the workspace of a mechanism, for what has to be shown of forward kinematics."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array
from sixsps.home import home_position
from sixsps.mechanism import Mechanism

_PLACES = np.linspace(0, 1, 21)[1:]
# Of its value at home, what det J must keep.
_LEAST = 0.01


def workspace_poses(
    mechanism: Mechanism, count: int, rng: np.random.Generator, tilt: float = 0.5
) -> tuple[Array, Array, float]:
    """Draws poses with all legs within their strokes, and a straight way of regular poses from home.

    Positions are drawn evenly from a cube about home with edges of two strokes, rotations by angles evenly
    up to `tilt` about evenly drawn axes. On the way from home, on which positions and rotation vectors grow
    in proportion, det J keeps its sign and a hundredth of its value at home, at twenty places.

    Args:
        mechanism: with length limits.
        count: of poses.
        rng: what draws them.
        tilt: largest angle [rad].

    Returns:
        (count, 3) positions [m], (count, 3, 3) rotations, and the share of what was drawn that is such.
    """
    home = home_position(mechanism)
    low, high = mechanism.length_limits.T
    kept: list[tuple[Array, Array]] = []
    drawn = found = 0
    while found < count:
        size = min(4 * count, 100_000)
        position = home + rng.uniform(-1, 1, (size, 3)) * (high - low).min()
        axis = rng.standard_normal((size, 3))
        vector = axis / np.linalg.norm(axis, axis=1)[:, None] * rng.uniform(0, tilt, (size, 1))
        lengths, _ = _legs(mechanism, position, vector)
        within = ((lengths >= low) & (lengths <= high)).all(axis=1)
        position, vector = position[within], vector[within]
        regular = _regular_from(mechanism, home, position, vector)
        kept.append((position[regular], vector[regular]))
        drawn, found = drawn + size, found + int(regular.sum())
    position, vector = (np.concatenate(parts)[:count] for parts in zip(*kept, strict=True))
    return position, np.asarray(Rotation.from_rotvec(vector).as_matrix()), found / drawn


def _regular_from(mechanism: Mechanism, home: Array, position: Array, vector: Array) -> Array:
    _, at_home = _legs(mechanism, home[None], np.zeros((1, 3)))
    regular = np.ones(len(position), bool)
    for part in _PLACES:
        _, determinant = _legs(mechanism, home + part * (position - home), part * vector)
        regular &= determinant / at_home > _LEAST
    return regular


def _legs(mechanism: Mechanism, position: Array, vector: Array) -> tuple[Array, Array]:
    """Returns lengths (n, 6) and det J (n,), angular columns over the characteristic length."""
    rotation = Rotation.from_rotvec(vector).as_matrix()
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    legs = (position[:, None] - mechanism.base_anchors) + arms
    lengths = np.linalg.norm(legs, axis=-1)
    directions = legs / lengths[..., None]
    moments = np.cross(arms, directions) / mechanism.characteristic_length
    return lengths, np.linalg.det(np.concatenate([directions, moments], axis=-1))
