"""How far a motion, or poses alone, stay within the limits of a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixsps.arguments import mechanism_of
from sixsps.arrays import Array, frozen
from sixsps.errors import MechanismError, MotionError
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.pose_arrays import checked_poses
from sixsps.rotation import cross
from sixsps.segments import segment_distances

LIMITS = {
    "min_length": "shortest length",
    "max_length": "longest length",
    "min_force": "least force",
    "max_force": "largest force",
    "max_rate": "length rate",
    "base_cone": "base cone",
    "platform_cone": "platform cone",
    "clearance": "leg-leg distance",
}
"""Key of every limit, and what a reader calls it."""

_LEGS = tuple(str(leg) for leg in range(1, 7))
# What stands at its limit is off by rounding of coordinates and of the limit's own decimal digits. A few
# thousand units of roundoff leave room for a world frame a hundred leg lengths away.
_ROUNDING = 1e-12
# Samples whose fifteen pairs of legs stay in the cache.
_BLOCK = 1024


@dataclass(frozen=True, eq=False)
class Margin:
    """How far one quantity stays within its limit: n samples, k legs or pairs of legs.

    Attributes:
        name: what a reader calls the limit.
        unit: of values, limit and margins.
        legs: k names, "1" to "6", or "1-4" of a pair.
        values: (n, k); NaN where there is none, as forces in a singular pose or a direction of no length.
        limit: (k,) infinite where a leg has none.
        is_largest: whether the limit is the largest value allowed, or the least one.
    """

    name: str
    unit: str
    legs: tuple[str, ...]
    values: Array
    limit: Array
    is_largest: bool

    @cached_property
    def margins(self) -> Array:
        """(n, k) distance to the limit: positive inside, negative outside, NaN where there is no value."""
        difference = self.values - self.limit
        return -difference if self.is_largest else difference

    @cached_property
    def allowance(self) -> Array:
        """(k,) what a value may be beyond its limit by rounding alone."""
        return _ROUNDING * np.where(np.isfinite(self.limit), np.abs(self.limit), 0.0)

    @cached_property
    def violated(self) -> NDArray[np.bool_]:
        """(n, k) whether the limit is not kept: beyond it by more than rounding, or without a value."""
        return ~(self.margins >= -self.allowance) & np.isfinite(self.limit)


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins to all limits that a mechanism has.

    Attributes:
        samples: n.
        limits: key of `LIMITS` -> margin, of those that were checked.
        unchecked: key -> why, of those that were not.
    """

    samples: int
    limits: Mapping[str, Margin]
    unchecked: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """(n,) whether all limits that were checked are kept."""
        kept = np.ones(self.samples, dtype=bool)
        for margin in self.limits.values():
            kept &= ~margin.violated.any(axis=1)
        return kept


def limit_margins(mechanism: Mechanism, motion: Motion, forces: ArrayLike | None = None) -> Margins:
    """Returns the margins to all limits along a motion, at its samples.

    Args:
        mechanism: geometry and limits; with a limit of the force and without `forces` also inertia.
        motion: n samples.
        forces: (n, 6) leg forces [N], NaN where the pose is singular; by default, where the mechanism
            limits them and has inertia, `sixsps.inverse_dynamics`.

    Raises:
        MechanismError: cones without axes, of a mechanism without a home pose.
        MotionError: forces of another shape, or that are no numbers or infinite.
        InputError: not a mechanism.
    """
    limits, n = mechanism_of(mechanism).limits, len(motion)
    found = _pose_margins(mechanism, motion.position, motion.rotation)
    entries, unchecked = dict(found.limits), dict(found.unchecked)
    if limits.rate is not None:
        rates = np.abs(length_rates(mechanism, motion))
        entries["max_rate"] = _margin("max_rate", "m/s", rates, limits.rate)
        del unchecked["max_rate"]
    if limits.force is not None:
        given = _forces(mechanism, motion, forces)
        for end, key in enumerate(("min_force", "max_force")):
            if given is None:
                unchecked[key] = "needs the inertia that this mechanism of geometry alone does not have"
            else:
                entries[key] = _margin(key, "N", given, limits.force[:, end])
                del unchecked[key]
    return Margins(n, {key: entries[key] for key in LIMITS if key in entries}, unchecked)


def pose_margins(mechanism: Mechanism, position: ArrayLike, rotation: ArrayLike) -> Margins:
    """Returns the margins to the limits that poses alone decide: strokes, cones, leg-leg distance.

    Args:
        mechanism: geometry and limits.
        position: (n, 3) platform origin O1, world frame [m].
        rotation: (n, 3, 3) platform axes to world axes, or quaternions (n, 4) w, x, y, z.

    Raises:
        MechanismError: cones without axes, of a mechanism without a home pose.
        MotionError: arrays of other shapes, entries that are not finite, or orientations that are none.
        InputError: not a mechanism.
    """
    return _pose_margins(mechanism_of(mechanism), *checked_poses(position, rotation))


def _pose_margins(mechanism: Mechanism, place: Array, turn: Array) -> Margins:
    """Returns `pose_margins` of poses that were checked."""
    limits, legs = mechanism.limits, leg_vectors(mechanism, place, turn)
    lengths = np.linalg.norm(legs, axis=-1)
    entries = {}
    low, high = mechanism.length_limits.T
    if (low > 0).any():
        entries["min_length"] = _margin("min_length", "m", lengths, np.where(low > 0, low, -np.inf))
    if np.isfinite(high).any():
        entries["max_length"] = _margin("max_length", "m", lengths, high)
    if limits.base_cone is not None:
        axes = _axes(mechanism, "base")
        entries["base_cone"] = _margin("base_cone", "rad", angles(legs, axes), limits.base_cone)
    if limits.platform_cone is not None:
        axes = np.einsum("nij,kj->nki", turn, _axes(mechanism, "platform"))
        entries["platform_cone"] = _margin("platform_cone", "rad", angles(legs, axes), limits.platform_cone)
    if limits.clearance is not None:
        pairs = separate_pairs(mechanism)
        names = tuple(f"{i + 1}-{j + 1}" for i, j in pairs)
        values, limit = leg_distances(mechanism, legs), np.full(len(pairs), limits.clearance)
        entries["clearance"] = Margin(LIMITS["clearance"], "m", names, values, limit, is_largest=False)
    return Margins(len(place), entries, _unchecked(mechanism, entries))


def leg_vectors(mechanism: Mechanism, position: Array, rotation: Array) -> Array:
    """Returns (n, 6, 3) the vectors from A_i to B_i [m], for poses as in `pose_margins`."""
    # In this order a world frame far away costs no digits of the arms.
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    return (position[:, None] - mechanism.base_anchors) + arms


def length_rates(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns (n, 6) rates of the leg lengths along a motion [m/s]; NaN of a leg without length."""
    legs = leg_vectors(mechanism, motion.position, motion.rotation)
    arms = np.einsum("nij,kj->nki", motion.rotation, mechanism.platform_anchors)
    velocity = motion.velocity[:, None] + cross(motion.angular_velocity[:, None], arms)
    with np.errstate(invalid="ignore", divide="ignore"):
        rates: Array = np.einsum("nki,nki->nk", legs, velocity) / np.linalg.norm(legs, axis=-1)
    return rates


def angles(a: Array, b: Array) -> Array:
    """Returns the angles between vectors (..., 3) of any length [rad]; NaN where one has none.

    As accurate for small angles as for large ones, which the arc cosine of their product is not.
    """
    product = cross(a, b)
    found = np.arctan2(np.linalg.norm(product, axis=-1), np.einsum("...i,...i->...", a, b))
    there = (np.abs(a).max(axis=-1) > 0) & (np.abs(b).max(axis=-1) > 0)
    return np.where(there, found, np.nan)


def separate_pairs(mechanism: Mechanism) -> list[tuple[int, int]]:
    """Returns the pairs of legs that share neither base nor platform joint, counted from 0."""
    joints = (mechanism.base_anchors, mechanism.platform_anchors)
    return [
        (i, j)
        for i in range(6)
        for j in range(i + 1, 6)
        if not any(np.array_equal(anchors[i], anchors[j]) for anchors in joints)
    ]


def leg_distances(mechanism: Mechanism, legs: Array) -> Array:
    """Returns (n, pairs) distances between the axes of `separate_pairs` [m].

    Args:
        mechanism: whose legs these are.
        legs: (n, 6, 3) `leg_vectors` [m].
    """
    pairs = np.array(separate_pairs(mechanism), dtype=np.intp).reshape(-1, 2)
    first, second = pairs.T
    A, found = mechanism.base_anchors, np.empty((len(legs), len(pairs)))
    for start in range(0, len(legs), _BLOCK):
        block = legs[start : start + _BLOCK]
        found[start : start + _BLOCK] = segment_distances(
            A[first], block[:, first], A[second], block[:, second]
        )
    return found


def _margin(key: str, unit: str, values: Array, limit: Array) -> Margin:
    return Margin(LIMITS[key], unit, _LEGS, values, limit, is_largest=not key.startswith("min"))


def _axes(mechanism: Mechanism, joint: str) -> Array:
    """Returns (6, 3) axes of the cones: those given, or the legs at home."""
    given = getattr(mechanism.limits, f"{joint}_axes")
    if given is not None:
        return given
    try:
        home = home_position(mechanism)
    except MechanismError:
        allowed = "axes of the cones, or length limits: the axes are the legs at mid-stroke by default"
        raise MechanismError(f"limits.{joint}_axes", "missing", allowed) from None
    return leg_vectors(mechanism, home[None], np.eye(3)[None])[0]


def _unchecked(mechanism: Mechanism, entries: Mapping[str, Margin]) -> dict[str, str]:
    limits = mechanism.limits
    given = {"min_force": limits.force, "max_force": limits.force, "max_rate": limits.rate}
    reason = "poses alone do not decide it"
    others = [key for key in LIMITS if key not in entries]
    return {key: "no limit is given" if given.get(key) is None else reason for key in others}


def _forces(mechanism: Mechanism, motion: Motion, forces: ArrayLike | None) -> Array | None:
    if forces is None:
        if not mechanism.has_inertia:
            return None
        from sixsps.formulations import inverse_dynamics

        return inverse_dynamics(mechanism, motion)
    return _given(forces, len(motion))


def _given(forces: ArrayLike, n: int) -> Array:
    """Returns (n, 6) numbers, NaN where they are not known."""
    try:
        given = np.asarray(forces)
    except ValueError:  # rows of different lengths
        given = np.array(None)
    if given.dtype.kind != "f" or np.ma.is_masked(forces):
        return frozen(forces, (n, 6), "forces", MotionError)
    unknown = np.isnan(given)
    known = frozen(np.where(unknown, 0.0, given), (n, 6), "forces", MotionError)
    return np.where(unknown, np.nan, known)
