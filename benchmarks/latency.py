"""One sample at a time, as a control loop asks for it: how long single calls take, and the slowest of them.

Each call is timed by itself; what reading the clock takes is stated and left in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle, islice
from time import perf_counter_ns
from typing import Any

import numpy as np

import sixsps
from benchmarks.candidates import Missing, casadi_arguments
from benchmarks.naming import CASADI, FAST, KANE, PINOCCHIO, RNEA
from benchmarks.plan import Plan
from benchmarks.rounds import Progress, undisturbed
from benchmarks.states import States
from compare import registry
from sixsps import symbolic
from sixsps.errors import EngineUnavailable
from sixsps.kernels.signatures import FORCES
from sixsps.motion import Motion

PERCENTILES = {"50 %": 50.0, "99 %": 99.0, "99.9 %": 99.9, "all": 100.0}
"""Share of the calls that take no longer."""
_STATES = 500


@dataclass(frozen=True)
class Caller:
    """Single calls of one candidate.

    Attributes:
        name: of its row.
        what: is called.
        pace: one of `candidates.PACES`.
        call: what is timed.
        arguments: of the call, a tuple a state.
    """

    name: str
    what: str
    pace: str
    call: Callable[..., Any]
    arguments: Sequence[tuple[Any, ...]]


def measure(plan: Plan, states: States, progress: Progress) -> dict[str, Any]:
    """Returns the entry `latency` of the results: a row a candidate, all its calls together."""
    progress("setting up")
    found = _callers(states, states.spread(min(_STATES, states.samples)))
    callers = [one for one in found if isinstance(one, Caller)]
    times: dict[str, list[Any]] = {one.name: [] for one in callers}
    for one in callers:
        # What is done for the first time with a state is done here.
        timed(one, min(len(one.arguments), plan.calls[one.pace]))
    for number in range(plan.rounds):
        progress(f"round {number + 1} of {plan.rounds}")
        with undisturbed():
            for one in callers:
                times[one.name].append(timed(one, -(-plan.calls[one.pace] // plan.rounds)))
    rows = [
        {"name": one.name, "reason": one.reason}
        if isinstance(one, Missing)
        else summary(one, times[one.name])
        for one in found
    ]
    return {"rows": rows, "clock_ns": clock_ns()}


def timed(caller: Caller, calls: int) -> list[int]:
    """Returns how long each of so many calls takes [ns], going round the states."""
    call, clock = caller.call, perf_counter_ns
    found: list[int] = []
    for given in islice(cycle(caller.arguments), calls):
        start = clock()
        call(*given)
        found.append(clock() - start)
    return found


def clock_ns() -> float:
    """Returns what a call that does nothing seems to take [ns]."""
    return float(np.median(timed(Caller("nothing", "", "", lambda: None, [()]), 10_000)))


def summary(caller: Caller, rounds: list[list[int]]) -> dict[str, Any]:
    """Returns the row of a caller from the times of its calls [ns], a list a round."""
    together = np.concatenate(rounds)
    slowest = np.percentile(together, list(PERCENTILES.values())).tolist()
    return {
        "name": caller.name,
        "what": caller.what,
        "calls": len(together),
        "ns": dict(zip(PERCENTILES, slowest, strict=True)),
        "median_ns": [float(np.median(one)) for one in rounds],
        "slow_ns": [float(np.percentile(one, PERCENTILES["99.9 %"])) for one in rounds],
    }


def _callers(states: States, motion: Motion) -> list[Caller | Missing]:
    mechanism = states.mechanism
    model = sixsps.compile(mechanism, 1)
    rows = list(zip(*(getattr(motion, name) for name in FORCES.arrays), strict=True))
    out = np.empty(6)
    single = [motion[k : k + 1] for k in range(len(motion))]
    function = symbolic.forces()
    kane = [(mechanism, one) for one in single]
    given = [(arguments,) for arguments in casadi_arguments(mechanism, motion)]
    return [
        Caller(FAST, "`leg_forces` with `out`", "compiled", model.leg_forces, [(*row, out) for row in rows]),
        Caller(f"{FAST}, new array", "`leg_forces`", "compiled", model.leg_forces, rows),
        Caller(KANE, "a motion of one sample", "formulation", sixsps.inverse_dynamics, kane),
        Caller(CASADI, "CasADi's VM, one call", "engine", function.call, given),
        *_of_pinocchio(states, motion),
    ]  # fmt: skip


def _of_pinocchio(states: States, motion: Motion) -> list[Caller | Missing]:
    try:
        registry.load(PINOCCHIO)
    except EngineUnavailable as error:
        return [Missing(name, error.detail) for name in (PINOCCHIO, RNEA)]
    from benchmarks.pinocchio_steps import PinocchioSteps  # it takes Pinocchio, which is there

    steps, every = PinocchioSteps(states.mechanism, motion), [(k,) for k in range(len(motion))]
    closed = "closed chain from joint positions that are ready made: rates, RNEA, solve"
    return [
        Caller(PINOCCHIO, closed, "engine", steps.closed_chain, every),
        Caller(RNEA, "`pin.rnea` of the open tree", "engine", steps.rnea, every),
    ]
