"""Measures of agreement: pure functions of arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sixsps.arrays import Array
from sixsps.kinematics import LegKinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION

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


def scales(reference: Array) -> Array:
    """Returns (n,) what errors are taken relative to, sample by sample [N].

    A sample's own largest force or, where that is more, what is usual along the motion: huge forces
    near a singularity excuse no error elsewhere, and a sample whose forces happen to vanish is not
    held to what rounding cannot give.

    Args:
        reference: (n, 6) [N]; NaN at samples that do not count, and in the result.
    """
    largest = np.abs(reference).max(axis=1)
    usual = np.median(largest[np.isfinite(largest)]) if np.isfinite(largest).any() else 0.0
    scale = np.maximum(largest, usual)
    return np.where(scale == 0, 1.0, scale)


def within(forces: Array, reference: Array, allowed: Array) -> bool:
    """Returns whether |forces - reference| stays within its tolerance at every sample.

    Args:
        forces: (n, 6) [N].
        reference: (n, 6) [N]; samples with NaN do not count.
        allowed: (n,) relative error allowed at a sample; see `scales`.
    """
    counted = np.isfinite(reference).all(axis=1)
    difference = np.abs(forces - reference).max(axis=1)
    return bool(np.all((difference <= allowed * scales(reference))[counted]))


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
