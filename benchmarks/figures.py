"""What follows from the raw times: medians with their spread, ratios, shares of the machine's peaks.

Ratios are taken round by round: what slowed a round down slowed both sides down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from benchmarks.naming import MEMORY, PEAK, TRIAD, on_threads

Results = dict[str, Any]


@dataclass(frozen=True)
class Spread:
    """A figure over the rounds: median, least and largest."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Returns the spread of some values, one at least."""
        return cls(median(values), min(values), max(values))


def ratios(upper: Sequence[float], lower: Sequence[float]) -> Spread:
    """Returns the spread of upper / lower, round by round."""
    return Spread.of([a / b for a, b in zip(upper, lower, strict=True)])


def row(results: Results, part: str, name: str) -> Results:
    """Returns a row of a part of the results; one with a reason where there is none of that name."""
    found = (one for one in results[part]["rows"] if one["name"] == name)
    return next(found, {"name": name, "reason": "not asked for"})


def all_threads(results: Results) -> int:
    """Returns how many threads all processors are."""
    return int(results["machine"]["processors"])


def share_of_arithmetic(units: float, ns_per_flop: Sequence[float], ns_per_sample: Sequence[float]) -> Spread:
    """Returns which share of the peak of arithmetic a sample's floating-point operations make use of."""
    return ratios([units * ns for ns in ns_per_flop], ns_per_sample)


def slots(operations: dict[str, int]) -> int:
    """Returns the floating-point operations that a sample's operations keep others from being done.

    A unit multiplies and adds at once: with a sum or a product alone, half of it is idle.
    """
    return 2 * sum(operations.values())


def share_allowed(kernel: Results, counts: Results, units: Results) -> Spread:
    """Returns the time that arithmetic and, for long arrays, memory need at least over that of a kernel.

    Args:
        kernel: row of the kernels.
        counts: of its operations and bytes.
        units: ns_per_unit of the kernels: of a floating-point operation and of a byte.
    """
    least = [counts["flops"] * ns for ns in units[on_threads(PEAK, kernel["threads"])]]
    if kernel["place"] == MEMORY:
        moved = [counts["bytes"] * ns for ns in units[on_threads(TRIAD, kernel["threads"])]]
        least = [max(pair) for pair in zip(least, moved, strict=True)]
    return ratios(least, kernel["ns_per_sample"])


def noise(results: Results) -> Spread:
    """Returns the times of the arithmetic loop on one thread, over the fastest of the run."""
    name = on_threads(PEAK, 1)
    times = results["batch"]["ns_per_flop"][name] + results["kernels"]["ns_per_unit"][name]
    fastest = min(times)
    return Spread.of([time / fastest for time in times])
