"""Throughput: leg forces along a motion, every candidate turn by turn with this machine's peak."""

from __future__ import annotations

from typing import Any

import numpy as np

import sixsps
from benchmarks.arithmetic import Peak
from benchmarks.candidates import Candidate, Missing, build, names
from benchmarks.naming import PEAK, on_threads
from benchmarks.plan import Plan
from benchmarks.rounds import Contestant, Progress, interleaved
from benchmarks.states import States
from benchmarks.workers import thread_counts
from sixsps.arrays import Array
from sixsps.errors import EngineError
from sixsps.motion import Motion


def peaks() -> list[Contestant]:
    """Returns the arithmetic loop on one thread and on all; a unit is one floating-point operation."""
    found = {count: Peak(count) for count in (thread_counts()[0], thread_counts()[-1])}
    return [Contestant(on_threads(PEAK, count), peak.flops, peak.run) for count, peak in found.items()]


def measure(plan: Plan, states: States, progress: Progress) -> dict[str, Any]:
    """Returns the entry `batch` of the results: a row a candidate, and the peak in the same rounds."""
    rows: list[dict[str, Any]] = []
    contestants = peaks()
    for name in names(plan.engines):
        progress(f"setting up {name}")
        found = build(name, states.mechanism, states.spread(plan.states["arrays"]))
        row, contestant = _entered(found, plan, states)
        rows.append(row)
        contestants += [contestant] if contestant else []
    times = interleaved(contestants, plan.rounds, plan.turn, progress)
    timed = [row | {"ns_per_sample": times.pop(row["name"])} if "reason" not in row else row for row in rows]
    return {"rows": timed, "ns_per_flop": times}


def _entered(
    found: Candidate | Missing, plan: Plan, states: States
) -> tuple[dict[str, Any], Contestant | None]:
    if isinstance(found, Missing):
        return {"name": found.name, "reason": found.reason}, None
    motion = states.spread(plan.states[found.pace])
    row = {
        "name": found.name, "what": found.what, "version": found.version,
        "pace": found.pace, "threads": found.threads, "samples": len(motion),
    }  # fmt: skip
    try:
        run = found.prepare(motion)
        row["difference"] = difference(run(), states, motion)
    except EngineError as error:
        return {"name": found.name, "reason": str(error)}, None
    return row, Contestant(found.name, len(motion), run)


def difference(forces: Array | None, states: States, motion: Motion) -> float | None:
    """Returns the largest difference from `kane` over the largest force; None where there are no forces."""
    if forces is None:
        return None
    expected = sixsps.inverse_dynamics(states.mechanism, motion)
    return float(np.abs(forces - expected).max() / np.abs(expected).max())
