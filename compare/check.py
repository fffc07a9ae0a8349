"""A motion held against the limits of a mechanism, and against its singular poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from compare.metrics import finite_or_none
from compare.runner import Watcher
from compare.single import forces_calculation
from sixsps.arrays import Array
from sixsps.between_samples import extremes
from sixsps.margins import Margin, Margins, length_rates, limit_margins
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.pose_quality import Quality, quality
from sixsps.singular_poses.crossings import Crossings, singularity_crossings
from sixsps.singular_poses.nearest import SingularityDistance, singularity_distance

# Samples at which the distance to a singular pose is sought, and of them those that send out rays.
_DISTANCES, _SEARCHED = 101, 12


@dataclass(frozen=True, eq=False)
class Violation:
    """A limit that is not kept from one time to another.

    Attributes:
        limit: key of `sixsps.margins.LIMITS`.
        leg: "1" to "6", or "1-4" of a pair.
        start: time of the first sample [s].
        end: time of the last sample [s].
        samples: number of them; 0 where the samples keep the limit and the path between them does not.
        worst: time of the value furthest beyond the limit [s].
        value: that value; None where there is none, as of a force in a singular pose.
        allowed: the limit.
        unit: of value and limit.
    """

    limit: str
    leg: str
    start: float
    end: float
    samples: int
    worst: float
    value: float | None
    allowed: float
    unit: str


@dataclass(frozen=True, eq=False)
class Check:
    """What was found.

    Attributes:
        mechanism: what moved.
        motion: how.
        engine: whose forces these are; None where none were needed.
        margins: at the samples.
        quality: at the samples.
        crossings: of singular poses.
        distance: to singular poses, at some of the samples.
        distance_samples: indices of these.
    """

    mechanism: Mechanism
    motion: Motion
    engine: str | None
    margins: Margins
    quality: Quality
    crossings: Crossings
    distance: SingularityDistance
    distance_samples: NDArray[np.intp]

    @property
    def passed(self) -> bool:
        """Whether all limits are kept and no pose on the way is singular."""
        return not self.violations and not self.singular

    @property
    def singular(self) -> bool:
        """Whether a sample is singular, or a singular pose crossed or maybe touched between samples."""
        return bool(self.crossings)

    @cached_property
    def violations(self) -> list[Violation]:
        """All violations: by limit, then leg, then time."""
        found = []
        for key, margin in self.margins.limits.items():
            for column in range(len(margin.legs)):
                found += list(self._of_leg(key, margin, column))
        return found

    def _of_leg(self, key: str, margin: Margin, column: int) -> Iterator[Violation]:
        time, values = self.motion.time, margin.values[:, column]
        allowed, beyond = float(margin.limit[column]), -margin.margins[:, column]
        kind = np.where(margin.violated[:, column], np.where(np.isnan(values), 2, 1), 0)
        for start, end in runs(kind):
            worst = start + int(np.argmax(beyond[start:end]))
            value = finite_or_none(float(values[worst]))
            yield Violation(
                key, margin.legs[column], float(time[start]), float(time[end - 1]), end - start,
                float(time[worst]), value, allowed, margin.unit,
            )  # fmt: skip
        if key in self._lengths_between:
            between = self._lengths_between[key][:, column]
            excess = between - allowed if margin.is_largest else allowed - between
            open_ = (kind[1:] == 0) & (kind[:-1] == 0) & (excess > margin.allowance[column])
            for start, end in runs(open_.astype(np.intp)):
                worst = start + int(np.argmax(excess[start:end]))
                yield Violation(
                    key, margin.legs[column], float(time[start]), float(time[end]), 0,
                    float(time[worst]), float(between[worst]), allowed, margin.unit,
                )  # fmt: skip

    @cached_property
    def _lengths_between(self) -> dict[str, Array]:
        """Least and largest lengths after each sample, (n - 1, 6), of the limits that there are."""
        keys = [key for key in ("min_length", "max_length") if key in self.margins.limits]
        if not keys:
            return {}
        lengths = self.margins.limits[keys[0]].values
        least, largest = extremes(self.motion.time, lengths, length_rates(self.mechanism, self.motion))
        return {key: value for key, value in (("min_length", least), ("max_length", largest)) if key in keys}


def check(mechanism: Mechanism, motion: Motion, engine: str, watch: Watcher) -> Check:
    """Returns what a motion does to the limits of a mechanism.

    Args:
        mechanism: geometry and limits; without inertia no forces are checked.
        motion: n samples.
        engine: a name of the registry, for the forces where they are limited.
        watch: told how that gets on.

    Raises:
        MechanismError: cones without axes, of a mechanism without a home pose.
        EngineUnavailable: the library of the engine is missing.
        EngineError: it failed.
    """
    forces = None
    if mechanism.limits.force is not None and mechanism.has_inertia:
        columns = forces_calculation(engine, mechanism, reactions=False).calculate(motion, watch).columns
        forces = np.column_stack([columns[f"f{leg}"] for leg in range(1, 7)])
    n = len(motion)
    watch("limits", "running", 0)
    margins = limit_margins(mechanism, motion, forces)
    watch("limits", "ok", n)
    watch("singular poses", "running", 0)
    found, crossings = quality(mechanism, motion), singularity_crossings(mechanism, motion)
    chosen = np.unique(np.linspace(0, n - 1, min(n, _DISTANCES)).round().astype(np.intp))
    chosen = np.union1d(chosen, np.argmax(found.condition))
    distance = singularity_distance(mechanism, motion[chosen], searched=_SEARCHED)
    watch("singular poses", "ok", n)
    used = None if forces is None else engine
    return Check(mechanism, motion, used, margins, found, crossings, distance, chosen)


def runs(kind: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Returns the stretches of equal numbers other than 0 as pairs of beginning and end, end excluded."""
    edges = np.flatnonzero(np.diff(kind, prepend=0, append=0))
    pairs = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    return [(start, end) for start, end in pairs if kind[start]]
