"""All measurements, one after the other, as one dictionary: the content of `results.json`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchmarks import batch, forward_kinematics, kernels, latency, machine, memory, scaling, slopes, startup
from benchmarks.plan import MECHANISM, MOTION, Plan
from benchmarks.rounds import Progress
from benchmarks.states import States

Told = Callable[[str, str], None]
"""Told the part that is being measured, and how it gets on."""


def run(plan: Plan, told: Told, long: bool = False) -> dict[str, Any]:
    """Returns the results: conditions, machine, and an entry for each part with the raw times by round.

    Args:
        plan: sizes and repeats.
        told: how it gets on.
        long: whether to add 10^8 samples, in passes over the same motion.
    """
    states = States(max(plan.states.values()))
    watch = machine.Watch()

    def of(part: str) -> Progress:
        return lambda what: told(part, what)

    results: dict[str, Any] = {
        "plan": plan.name,
        "rounds": plan.rounds,
        "turn_s": plan.turn,
        "mechanism": MECHANISM,
        "motion": MOTION,
        "machine": machine.facts(),
    }
    results["startup"] = startup.measure(plan, of("start-up"))
    results["batch"] = batch.measure(plan, states, of("batch"))
    results["latency"] = latency.measure(plan, states, of("latency"))
    results["derivatives"] = slopes.measure(plan, states, of("derivatives"))
    results["forward_kinematics"] = forward_kinematics.measure(plan, states, of("forward kinematics"))
    results["kernels"] = kernels.measure(plan, states, of("kernels"))
    results["scaling"] = scaling.measure(plan, states, of("scaling"), long)
    results["memory"] = memory.measure(plan, results["batch"]["rows"], of("memory"))
    results["disturbance"] = watch.disturbance()
    return results
