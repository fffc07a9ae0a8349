"""Architecture singularity: anchors with which every pose is singular."""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import MechanismError
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# Anchors that were turned or read from a drawing miss a line, a plane or a conic by rounding.
_ROUNDING = 1e-9
_POSES = 16


def check_architecture(base_anchors: Array, platform_anchors: Array, length: float) -> None:
    """Raises MechanismError, saying why, when the Jacobian is singular in every pose.

    det J is an analytic function of the pose: where it vanishes at a handful of generic poses it
    vanishes everywhere.

    Args:
        base_anchors: (6, 3) world frame [m].
        platform_anchors: (6, 3) platform frame [m].
        length: characteristic length of the platform [m].
    """
    if length > 0 and best_condition(base_anchors, platform_anchors, length) < SINGULAR_CONDITION:
        return
    for place, anchors in (("base.anchors", base_anchors), ("platform.anchors", platform_anchors)):
        _, counts = np.unique(anchors, axis=0, return_counts=True)
        if counts.max() > 3:
            found = f"{counts.max()} anchors coincide and every pose is singular"
            raise MechanismError(place, found, "at most three coincident anchors")
        if _flatness(anchors) == 1:
            raise MechanismError(place, "all on one line and every pose is singular", "anchors off one line")
    found, allowed = _reason(base_anchors, platform_anchors)
    raise MechanismError("base.anchors", f"every pose is singular: {found}", allowed)


def best_condition(base_anchors: Array, platform_anchors: Array, length: float) -> float:
    """Returns the least condition number of the Jacobian in a handful of poses at random.

    Args:
        base_anchors: (6, 3) world frame [m].
        platform_anchors: (6, 3) platform frame [m].
        length: that divides the angular columns [m].
    """
    generator = np.random.default_rng(20120531)
    size = length + float(np.ptp(base_anchors, axis=0).max())
    position = base_anchors.mean(axis=0) + size * generator.standard_normal((_POSES, 3))
    rotation, _ = np.linalg.qr(generator.standard_normal((_POSES, 3, 3)))
    rotation *= np.linalg.det(rotation)[:, None, None]
    arms = np.einsum("nij,kj->nki", rotation, platform_anchors)
    legs = position[:, None] + arms - base_anchors
    lengths = np.linalg.norm(legs, axis=-1)
    directions = legs / lengths[..., None]
    jacobian = np.concatenate([directions, np.cross(arms, directions)], axis=-1)
    return float(condition_numbers(jacobian, lengths, length).min())


def _reason(base_anchors: Array, platform_anchors: Array) -> tuple[str, str]:
    """Returns what is wrong with the anchors, and what is allowed."""
    for first in range(6):
        for second in range(first + 1, 6):
            pairs = np.hstack([base_anchors, platform_anchors])
            if np.array_equal(pairs[first], pairs[second]):
                return (
                    f"legs {first + 1} and {second + 1} have the same joints",
                    "each leg its own pair of joints",
                )
    both_flat = _flatness(base_anchors) == _flatness(platform_anchors) == 2
    if both_flat and _on_a_conic(_in_plane(base_anchors)):
        kind = _relation(_in_plane(base_anchors), _in_plane(platform_anchors))
        if kind:
            allowed = "anchors of which the platform's are not an affine image of the base's on one conic"
            return f"base and platform are {kind} polygons on one conic", allowed
    return "an architecture singularity of these anchors", "anchors with which some pose is regular"


def _flatness(anchors: Array) -> int:
    """Returns 0 for anchors in one point, 1 on a line, 2 in a plane, 3 in space."""
    spread = np.linalg.svd(anchors - anchors.mean(axis=0), compute_uv=False)
    return int((spread > _ROUNDING * np.abs(anchors).max()).sum())


def _in_plane(anchors: Array) -> Array:
    """Returns (6, 2) coordinates of planar anchors in their plane, about their centroid, of size 1."""
    centred = anchors - anchors.mean(axis=0)
    flat = centred @ np.linalg.svd(centred)[2][:2].T
    return np.asarray(flat / np.abs(flat).max())


def _on_a_conic(points: Array) -> bool:
    x, y = points.T
    powers = np.column_stack([x * x, x * y, y * y, x, y, np.ones(6)])
    return float(np.linalg.svd(powers, compute_uv=False)[-1]) < _ROUNDING


def _relation(base: Array, platform: Array) -> str:
    """Returns how the platform's points (6, 2) are an image of the base's: similar, affine, or not at all."""
    image, *_ = np.linalg.lstsq(base, platform, rcond=None)
    if np.abs(base @ image - platform).max() > _ROUNDING:
        return ""
    gram = image.T @ image
    similar = np.abs(gram - np.trace(gram) / 2 * np.eye(2)).max() <= _ROUNDING * np.trace(gram)
    return "similar" if similar else "affinely related"
