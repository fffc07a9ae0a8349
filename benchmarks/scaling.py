"""Cost per sample along the number of samples and of threads."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

import sixsps
from benchmarks.machine import memory_left
from benchmarks.plan import Plan
from benchmarks.rounds import Contestant, Progress, interleaved
from benchmarks.states import States, long_motion
from benchmarks.workers import thread_counts
from sixsps.arrays import Array
from sixsps.kernels.model import CompiledMechanism
from sixsps.kernels.signatures import FORCES
from sixsps.motion import Motion

PASSES = 100
"""Over the same motion, where more samples are asked for than memory holds."""

# Of what takes seconds: a half and a fifth of the rounds of a plan.
_FEWER, _FEWEST = 2, 5
# A motion is made from arrays that it copies, and checked in temporary ones.
_WHILE_MADE = 3


@dataclass(frozen=True)
class Size:
    """A row of the table.

    Attributes:
        samples: of one evaluation, all passes together.
        threads: that share it.
        reused: whether it writes into an array that is there, and not into a new one.
        passes: over the same motion.
    """

    samples: int
    threads: int
    reused: bool
    passes: int = 1

    @property
    def name(self) -> str:
        """The row in words."""
        return f"{self.samples} samples, {self.threads} threads, {self.passes} passes, reused {self.reused}"


def measure(plan: Plan, states: States, progress: Progress, long: bool = False) -> dict[str, Any]:
    """Returns the entry `scaling` of the results.

    Args:
        plan: sizes and rounds.
        states: give the mechanism.
        progress: told how it gets on.
        long: whether to add 100 passes over the longest motion of no more than a million samples.
    """
    mechanism = states.mechanism
    models = {count: sixsps.compile(mechanism, count) for count in thread_counts()}
    few = list(dict.fromkeys([min(models), max(models)]))
    middle = max(size for size in plan.sizes if size <= 10**6)
    sizes: list[Size] = []
    once: list[Contestant] = []
    often: list[Contestant] = []
    for samples in plan.sizes:
        counts = list(models) if samples == middle else few
        here = [Size(samples, count, reused) for count in counts for reused in (False, True)]
        sizes += here
        if not fits(samples):
            continue
        progress(f"making a motion of {samples} samples")
        motion, out = long_motion(mechanism, samples), np.empty((samples, 6))
        once += [_contestant(size, models[size.threads], motion, out) for size in here]
        if long and samples == middle:
            longest = [Size(PASSES * samples, count, True, PASSES) for count in few]
            sizes += longest
            often += [_contestant(size, models[size.threads], motion, out) for size in longest]
    times = interleaved(once, max(2, plan.rounds // _FEWER), plan.turn, progress)
    if often:
        times |= interleaved(often, max(2, plan.rounds // _FEWEST), plan.turn, progress)
    return {"rows": [_row(size, times.get(size.name)) for size in sizes], "shared": middle}


def fits(samples: int) -> bool:
    """Returns whether there is memory for a motion of so many samples; where nothing tells, there is."""
    left = memory_left()
    return left is None or _needed(samples) < left


def _needed(samples: int) -> int:
    return _WHILE_MADE * samples * 8 * (1 + sum(FORCES.arrays.values()) + sum(FORCES.sizes.values()))


def _contestant(size: Size, model: CompiledMechanism, motion: Motion, out: Array) -> Contestant:
    one = partial(model.inverse_dynamics, motion, out if size.reused else None)

    def several() -> None:
        for _ in range(size.passes):
            one()

    return Contestant(size.name, size.samples, several)


def _row(size: Size, times: list[float] | None) -> dict[str, Any]:
    row = {"name": size.name, **asdict(size)}
    if times is None:
        return row | {"reason": f"{_needed(size.samples) / 2**30:.1f} GiB of memory are not there"}
    return row | {"ns_per_sample": times}
