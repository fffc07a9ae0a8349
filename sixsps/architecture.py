"""Architecture singularity: anchors with which every pose is singular."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import MechanismError
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# Anchors that were turned or read from a drawing miss a point, a line, a plane or a conic by rounding.
_ROUNDING = 1e-9
_POSES = 16
# Ordinary hexapods have some pose with a condition number below 200 among those. Anchors of an architecture
# singularity that were typed with five digits or more are beyond this, and their forces are those of the
# digits that were left out.
_NEARLY_SINGULAR = 1e5
# Such anchors miss what makes them singular by this much over the condition number, and less.
_NEAR = 100.0


def check_architecture(base_anchors: Array, platform_anchors: Array, length: float) -> None:
    """Raises MechanismError, saying why, when the Jacobian is singular, or nearly so, in every pose.

    det J is an analytic function of the pose: where it vanishes at a handful of generic poses it
    vanishes everywhere.

    Args:
        base_anchors: (6, 3) world frame [m].
        platform_anchors: (6, 3) platform frame [m].
        length: largest distance at which coordinates round, as of the anchors from O1 [m].
    """
    spread = _size(platform_anchors) > _ROUNDING * length
    best = best_condition(base_anchors, platform_anchors) if spread else np.inf
    if best < _NEARLY_SINGULAR:
        return
    if best < SINGULAR_CONDITION:
        found = f"every pose is nearly singular, condition number {best:.0e} at best"
        reason = _reason(base_anchors, platform_anchors, max(_NEAR / best, _ROUNDING))
        allowed = f"anchors with which some pose is regular; here, to {math.log10(best):.0f} digits, {reason}"
        raise MechanismError("base.anchors", found, allowed)
    for place, anchors in (("base.anchors", base_anchors), ("platform.anchors", platform_anchors)):
        most = max(len(group) for group in _groups(anchors, _ROUNDING))
        if most > 3:
            found = f"{most} anchors coincide and every pose is singular"
            raise MechanismError(place, found, "at most three coincident anchors")
        if _flatness(anchors, _ROUNDING) == 1:
            raise MechanismError(place, "all on one line and every pose is singular", "anchors off one line")
    allowed = (
        f"anchors with which some pose is regular; here {_reason(base_anchors, platform_anchors, _ROUNDING)}"
    )
    raise MechanismError("base.anchors", "every pose is singular", allowed)


def best_condition(base_anchors: Array, platform_anchors: Array) -> float:
    """Returns the least condition number of the Jacobian in a handful of poses at random.

    It belongs to the centroid of the platform anchors and their root mean square distance from there, so
    that it does not depend on where the platform frame sits.

    Args:
        base_anchors: (6, 3) world frame [m].
        platform_anchors: (6, 3) platform frame [m].
    """
    size = _size(platform_anchors)
    jacobian, lengths = _random_jacobians(base_anchors, platform_anchors)
    return float(condition_numbers(jacobian, lengths, size).min())


def _size(anchors: Array) -> float:
    """Returns the root mean square distance of anchors from their centroid [m]."""
    return float(np.sqrt(np.mean(np.sum((anchors - anchors.mean(axis=0)) ** 2, axis=1))))


def _random_jacobians(base_anchors: Array, platform_anchors: Array) -> tuple[Array, Array]:
    """Returns (n, 6, 6) Jacobians about the centroid of the platform anchors and (n, 6) leg lengths [m]."""
    generator = np.random.default_rng(20120531)
    size = _size(platform_anchors) + float(np.ptp(base_anchors, axis=0).max())
    position = size * generator.standard_normal((_POSES, 3))
    rotation, _ = np.linalg.qr(generator.standard_normal((_POSES, 3, 3)))
    rotation *= np.linalg.det(rotation)[:, None, None]
    arms = np.einsum("nij,kj->nki", rotation, platform_anchors - platform_anchors.mean(axis=0))
    legs = position[:, None] + arms - (base_anchors - base_anchors.mean(axis=0))
    lengths = np.linalg.norm(legs, axis=-1)
    directions = legs / lengths[..., None]
    return np.concatenate([directions, np.cross(arms, directions)], axis=-1), lengths


def _reason(base: Array, platform: Array, near: float) -> str:
    """Returns what is wrong with the anchors."""
    legs = _dependent_legs(base, platform, near)
    if len(legs) == 6:
        return _reason_of_all(base, platform, near)
    A, b, names = base[legs], platform[legs], _listed(legs)
    if len(legs) == 2:
        return f"legs {names} have the same joints"
    if len(legs) == 3 and _flatness(A, near) == 0:
        return f"legs {names} meet in one base joint, and their platform joints are on one line"
    if len(legs) == 3 and _flatness(b, near) == 0:
        return f"legs {names} meet in one platform joint, and their base joints are on one line"
    if len(legs) == 4 and _flatness(A, near) == _flatness(b, near) == 1:
        return f"the joints of legs {names} divide a line of the base and one of the platform alike"
    return f"legs {names} alone depend on each other"


def _reason_of_all(base: Array, platform: Array, near: float) -> str:
    """Returns the same where any five legs are independent."""
    for place, points, other, others in (
        ("base", base, "platform", platform),
        ("platform", platform, "base", base),
    ):
        for group in _groups(points, near):
            rest = [leg for leg in range(6) if leg not in group]
            if len(group) == 3 and _flatness(others[rest], near) == 0:
                found = (
                    f"legs {_listed(group)} meet in one {place} joint, legs {_listed(rest)} in one {other}"
                )
                return f"{found} joint, and the line through both meets all six"
    if _flatness(base, near) == _flatness(platform, near) == 2:
        flat = _in_plane(base), _in_plane(platform)
        kind = _relation(*flat, near)
        if kind and _on_a_conic(flat[0], near):
            return f"base and platform are {kind} polygons, each on a conic"
    return "the lines of the legs always belong to one linear complex"


def _dependent_legs(base: Array, platform: Array, near: float) -> list[int]:
    """Returns the fewest legs whose lines depend on each other in every pose."""
    jacobian, _ = _random_jacobians(base, platform)
    size = _size(platform) or 1.0
    rows = jacobian / np.repeat([1.0, size], 3)
    for number in range(2, 6):
        for legs in combinations(range(6), number):
            values = np.linalg.svd(rows[:, legs], compute_uv=False)
            if (values[:, -1] < near * values[:, 0]).all():
                return list(legs)
    return list(range(6))


def _groups(anchors: Array, near: float) -> list[list[int]]:
    """Returns the anchors, from 0, in groups that coincide."""
    distance = near * np.abs(anchors).max()
    groups: list[list[int]] = []
    for index, anchor in enumerate(anchors):
        for group in groups:
            if np.abs(anchors[group[0]] - anchor).max() <= distance:
                group.append(index)
                break
        else:
            groups.append([index])
    return groups


def _flatness(anchors: Array, near: float) -> int:
    """Returns 0 for anchors in one point, 1 on a line, 2 in a plane, 3 in space."""
    spread = np.linalg.svd(anchors - anchors.mean(axis=0), compute_uv=False)
    return int((spread > near * np.abs(anchors).max()).sum())


def _in_plane(anchors: Array) -> Array:
    """Returns (6, 2) coordinates of planar anchors in their plane, about their centroid, of size 1."""
    centred = anchors - anchors.mean(axis=0)
    flat = centred @ np.linalg.svd(centred)[2][:2].T
    return np.asarray(flat / np.abs(flat).max())


def _on_a_conic(points: Array, near: float) -> bool:
    x, y = points.T
    powers = np.column_stack([x * x, x * y, y * y, x, y, np.ones(6)])
    return float(np.linalg.svd(powers, compute_uv=False)[-1]) < near


def _relation(base: Array, platform: Array, near: float) -> str:
    """Returns how the platform's points (6, 2) are an image of the base's, "" where they are none."""
    image, *_ = np.linalg.lstsq(base, platform, rcond=None)
    if np.abs(base @ image - platform).max() <= near:
        gram = image.T @ image
        similar = np.abs(gram - np.trace(gram) / 2 * np.eye(2)).max() <= near * np.trace(gram)
        return "similar" if similar else "affinely related"
    if any(_flatness(points[list(three)], near) < 2 for points in (base, platform) for three in _TRIPLES):
        return ""  # three on a line: a homography would fit more than it says
    points, images = np.column_stack([base, np.ones(6)]), platform
    zero = np.zeros((6, 3))
    rows = [
        np.hstack([points, zero, -images[:, :1] * points]),
        np.hstack([zero, points, -images[:, 1:] * points]),
    ]
    fits = float(np.linalg.svd(np.vstack(rows), compute_uv=False)[-1]) < near
    return "projectively related" if fits else ""


_TRIPLES = list(combinations(range(6), 3))


def _listed(legs: list[int]) -> str:
    numbers = [leg + 1 for leg in legs]
    return ", ".join(map(str, numbers[:-1])) + f" and {numbers[-1]}"
