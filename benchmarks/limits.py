"""What the design asks of the speed, beside what was measured.

Medians over the rounds are judged. "Flat" is asked for without a figure, 1.25 is taken for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.figures import Results, Spread, all_threads, ratios, row, share_of_arithmetic
from benchmarks.forward_kinematics import FOLLOWED, NEXT
from benchmarks.naming import (
    EXACT,
    FAST,
    FORCES,
    HELP,
    IMPORT,
    PEAK,
    PINOCCHIO,
    RNEA,
    VECTORISED,
    on_threads,
)


@dataclass(frozen=True)
class Limit:
    """One figure that is asked for.

    Attributes:
        what: is asked.
        bound: that the figure must not fall below, or where `most` not exceed.
        unit: of the figure.
        figure: results -> spread over the rounds, or why there is none.
        most: whether the bound is an upper one.
    """

    what: str
    bound: float
    unit: str
    figure: Callable[[Results], Spread | str]
    most: bool = False

    def met(self, figure: Spread) -> bool:
        """Returns whether the median is within the bound."""
        return figure.median <= self.bound if self.most else figure.median >= self.bound


def _faster(name: str) -> Callable[[Results], Spread | str]:
    def figure(results: Results) -> Spread | str:
        other = row(results, "batch", name)
        fast = row(results, "batch", on_threads(FAST, all_threads(results)))
        return other.get("reason") or ratios(other["ns_per_sample"], fast["ns_per_sample"])

    return figure


def _share_of_peak(results: Results) -> Spread:
    name = on_threads(FAST, all_threads(results))
    peak = results["batch"]["ns_per_flop"][on_threads(PEAK, all_threads(results))]
    flops = results["kernels"]["counts"]["forces"]["flops"]
    share = share_of_arithmetic(flops, peak, row(results, "batch", name)["ns_per_sample"])
    return Spread(100 * share.median, 100 * share.low, 100 * share.high)


def _call_median(results: Results) -> Spread:
    return Spread.of([ns / 1000 for ns in row(results, "latency", FAST)["median_ns"]])


def _call_slow(results: Results) -> Spread:
    return Spread.of([ns / 1000 for ns in row(results, "latency", FAST)["slow_ns"]])


def _call_ratio(results: Results) -> Spread | str:
    other = row(results, "latency", PINOCCHIO)
    return other.get("reason") or ratios(other["median_ns"], row(results, "latency", FAST)["median_ns"])


def _derivatives(results: Results) -> Spread:
    exact, forces = (row(results, "derivatives", name)["ns_per_sample"] for name in (EXACT, FORCES))
    return ratios(exact, forces)


def _flatness(results: Results) -> Spread:
    """Largest over least cost per sample along the sizes, one thread, array reused."""
    rows = [
        one["ns_per_sample"]
        for one in results["scaling"]["rows"]
        if one["threads"] == 1 and one["reused"] and one["passes"] == 1 and "reason" not in one
    ]
    return Spread.of([max(costs) / min(costs) for costs in zip(*rows, strict=True)])


def _two_threads(results: Results) -> Spread | str:
    by_threads = {
        one["threads"]: one["ns_per_sample"]
        for one in results["scaling"]["rows"]
        if one["samples"] == results["scaling"]["shared"] and one["reused"] and one["passes"] == 1
    }
    return ratios(by_threads[1], by_threads[2]) if 2 in by_threads else "one processor"


def _poses_a_second(results: Results) -> Spread:
    name = on_threads(FOLLOWED, all_threads(results))
    times = row(results, "forward_kinematics", name)["ns_per_sample"]
    return Spread.of([1e3 / ns for ns in times])


def _next_pose(results: Results) -> Spread:
    (one,) = (call for call in results["forward_kinematics"]["calls"] if call["name"] == NEXT)
    return Spread.of([ns / 1000 for ns in one["median_ns"]])


def _wrong_poses(results: Results) -> Spread:
    """Counts poses that are called ok and are not those drawn to 1e-12."""
    rows = results["forward_kinematics"]["workspaces"]
    wrong = sum(max(one["others"], int(one["error"] > _EXACT)) for one in rows)
    return Spread.of([wrong])


def _start_up(name: str) -> Callable[[Results], Spread]:
    return lambda results: Spread.of(results["startup"]["seconds"][name])


# Of the platform's size, and radians.
_EXACT = 1e-12
START_UP = {IMPORT: 0.15, HELP: 0.3}
"""Command -> seconds that its process may take."""

_FASTER = "along a motion, all processors: times faster than"
LIMITS = (
    Limit(f"{_FASTER} Pinocchio's closed chain", 500, "", _faster(PINOCCHIO)),
    Limit(f"{_FASTER} Pinocchio's RNEA alone", 30, "", _faster(RNEA)),
    Limit(f"{_FASTER} the same graph in NumPy", 15, "", _faster(VECTORISED)),
    Limit("along a motion, all processors: share of the peak of arithmetic", 40, "%", _share_of_peak),
    Limit("one sample: median", 5, "us", _call_median, most=True),
    Limit("one sample: 99.9 % of the calls of a round within", 50, "us", _call_slow, most=True),
    Limit("one sample: times faster than Pinocchio's closed chain", 20, "", _call_ratio),
    Limit("exact derivatives: cost over that of the forces", 6, "", _derivatives, most=True),
    Limit("cost per sample: largest over least along the sizes", 1.25, "", _flatness, most=True),
    Limit("two threads: times faster than one", 1.8, "", _two_threads),
    Limit("forward kinematics along a trajectory, all processors", 1, "million a second", _poses_a_second),
    Limit("forward kinematics, one call: median", 30, "us", _next_pose, most=True),
    Limit("poses of the workspaces found wrong and called ok", 0, "", _wrong_poses, most=True),
    *(
        Limit(f"`{name}`, the whole process", bound, "s", _start_up(name), most=True)
        for name, bound in START_UP.items()
    ),
)
