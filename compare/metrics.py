"""Measures of agreement: pure functions of arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sixsps.arrays import Array
from sixsps.kinematics import LegKinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION

if TYPE_CHECKING:
    from compare.reference import Reference

# A float64 has 53 bits: no more decimal digits than this can agree.
MOST_DIGITS = 53 * math.log10(2)


@dataclass(frozen=True)
class Worst:
    """The largest absolute difference: value [N], sample index, leg index."""

    value: float
    sample: int
    leg: int


def worst_difference(forces: Array, reference: Array) -> Worst:
    """Returns the largest |forces - reference|; samples with NaN in the reference do not count.

    Args:
        forces: (n, 6) [N].
        reference: (n, 6) [N], finite at one sample at least.
    """
    difference = np.where(np.isnan(reference), 0.0, np.abs(forces - reference))
    sample, leg = (int(index) for index in np.unravel_index(np.argmax(difference), difference.shape))
    return Worst(float(difference[sample, leg]), sample, leg)


def relative_error(forces: Array, reference: Array) -> float:
    """Returns max |forces - reference| / max |reference| over all samples and legs.

    Where all reference forces are zero the difference is taken relative to 1 N.
    """
    largest = float(np.nanmax(np.abs(reference)))
    return worst_difference(forces, reference).value / (largest or 1.0)


def loads(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns (n,) what the legs have to carry and to move, before anything of it cancels [N].

    Weight, external wrench and inertia of the platform's motion, moments over the characteristic
    length. Where they cancel, forces are small and their rounding errors are not.
    """
    links = mechanism.lower.mass.sum() + mechanism.upper.mass.sum()
    mass, length = mechanism.platform.mass + links, mechanism.characteristic_length
    speed = np.linalg.norm(motion.angular_velocity, axis=1)
    turning = np.linalg.norm(motion.angular_acceleration, axis=1) + speed**2
    return (
        mass * np.linalg.norm(mechanism.gravity)
        + mass * (np.linalg.norm(motion.acceleration, axis=1) + turning * length)
        + np.linalg.norm(motion.force, axis=1)
        + np.linalg.norm(motion.moment, axis=1) / length
    )


def scales(reference: Array, load: Array) -> Array:
    """Returns (n,) what errors are allowed relative to, sample by sample [N].

    A sample's own largest force or, where that is more, its load or what is usual along the motion:
    huge forces near a singularity excuse no error elsewhere, and a sample whose forces happen to
    vanish is not held to what rounding cannot give.

    Args:
        reference: (n, 6) [N]; NaN at samples that do not count.
        load: (n,) see `loads` [N].
    """
    largest = np.abs(reference).max(axis=1)
    usual = np.median(largest[np.isfinite(largest)]) if np.isfinite(largest).any() else 0.0
    scale = np.fmax(np.maximum(load, usual), largest)
    return np.where(scale == 0, 1.0, scale)


@dataclass(frozen=True)
class Excess:
    """Where an error is largest in units of what is allowed there: ratio, sample index, leg index."""

    ratio: float
    sample: int
    leg: int


def excess(forces: Array, reference: Reference, allowed: Array) -> Excess:
    """Returns the largest |forces - reference| in units of what is allowed.

    Args:
        forces: (n, 6) [N].
        reference: samples where its forces are NaN do not count.
        allowed: (n,) relative error allowed at a sample, of `reference.scale`.
    """
    counted = np.isfinite(reference.forces)
    ratio = np.abs(forces - reference.forces) / (allowed * reference.scale)[:, None]
    ratio = np.where(counted, np.where(np.isnan(ratio), np.inf, ratio), -1.0)
    sample, leg = (int(index) for index in np.unravel_index(np.argmax(ratio), ratio.shape))
    return Excess(float(ratio[sample, leg]), sample, leg)


def digits(relative: float) -> float:
    """Returns how many decimal digits agree at a relative error, at most those of a float64."""
    return MOST_DIGITS if relative == 0 else min(max(-math.log10(relative), 0.0), MOST_DIGITS)


@dataclass(frozen=True)
class PowerBalance:
    """Largest violation of the balance of power, absolute and relative to the power exchanged."""

    watts: float
    relative: float


def power_balance(
    mechanism: Mechanism, motion: Motion, legs: LegKinematics, forces: Array, energy_rate: Array
) -> PowerBalance:
    """Compares what actuators and external wrench put in with the rate of energy.

    Args:
        mechanism: for the platform's centre of mass, on which the external force acts.
        motion: n samples.
        legs: `inverse_kinematics(mechanism, motion)`.
        forces: (n, 6) leg forces [N].
        energy_rate: (n,) rate of kinetic and potential energy [W], computed without these forces.
    """
    arm = motion.rotation @ mechanism.platform.com
    velocity = motion.velocity + np.cross(motion.angular_velocity, arm)
    actuators = forces * legs.length_rates
    external = np.sum(motion.force * velocity + motion.moment * motion.angular_velocity, axis=1)
    missing = np.abs(actuators.sum(axis=1) + external - energy_rate)
    exchanged = np.abs(actuators).sum(axis=1) + np.abs(external) + np.abs(energy_rate)
    if not np.isfinite(missing).any():
        return PowerBalance(math.nan, math.nan)
    watts, scale = float(np.nanmax(missing)), float(np.nanmax(exchanged))
    return PowerBalance(watts, watts / scale if scale > 0 else 0.0)


def singular_samples(motion: Motion, legs: LegKinematics) -> list[dict[str, Any]]:
    """Returns number (from 1), time and condition number of every singular sample.

    Args:
        motion: n samples.
        legs: `inverse_kinematics(mechanism, motion)`.
    """
    return [
        {
            "sample": int(k) + 1,
            "t": float(motion.time[k]),
            "condition": finite_or_none(float(legs.condition[k])),
        }
        for k in np.flatnonzero(legs.condition > SINGULAR_CONDITION)
    ]


def finite_or_none(value: float) -> float | None:
    """Returns `value` for JSON, which has no infinity and no NaN."""
    return value if np.isfinite(value) else None


@dataclass(frozen=True)
class Violation:
    """Samples of one leg outside its length limits, and the worst of them."""

    leg: int
    samples: int
    worst_sample: int
    length: float
    limit: float


def limit_violations(lengths: Array, limits: Array) -> list[Violation]:
    """Returns the violations of length limits, one entry for a leg and a limit.

    Args:
        lengths: (n, 6) [m].
        limits: (6, 2) shortest and longest [m].
    """
    found = []
    for leg in range(6):
        for limit, excess in (
            (limits[leg, 0], limits[leg, 0] - lengths[:, leg]),
            (limits[leg, 1], lengths[:, leg] - limits[leg, 1]),
        ):
            outside = int(np.count_nonzero(excess > 0))
            if outside:
                worst = int(np.argmax(excess))
                found.append(Violation(leg, outside, worst, float(lengths[worst, leg]), float(limit)))
    return found
