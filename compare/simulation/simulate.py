"""One simulation from names to figures: engine and mode chosen, run, and put into words and keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compare.facts import machine, mechanism_facts, motion_facts, versions
from compare.forward import FORWARD
from compare.metrics import limit_violations
from compare.registry import load_entry
from compare.simulation.modes import Mode
from compare.simulation.outcome import Outcome
from compare.simulation.plan import Plan
from sixsps.errors import InputError, UnknownNameError
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

DEFAULT_ENGINE = "closed-form"
# Driven by lengths instead of forces, it has a mode of its own and no other.
DRIVEN_ENGINE = "exudyn"


@dataclass(frozen=True)
class Request:
    """What is simulated, and how.

    Attributes:
        engine: a name of `FORWARD`.
        mode: None for what the engine and `figures` imply.
        figures: whether the paper's figures are to be drawn, which takes a simulated trajectory.
        force_step: longest time between two known forces of `feedforward` [s].
        stiffness: of the PD [N/m]; None for one that fits the mechanism.
        damping: of the PD [N s/m]; None for one that fits the mechanism.
    """

    engine: str = DEFAULT_ENGINE
    mode: Mode | None = None
    figures: bool = False
    force_step: float | None = None
    stiffness: float | None = None
    damping: float | None = None

    def __post_init__(self) -> None:
        if self.engine not in FORWARD:
            raise UnknownNameError("engine", self.engine, ", ".join(FORWARD))
        if self.engine == DRIVEN_ENGINE and self.mode is not None:
            allowed = f"none with {DRIVEN_ENGINE}, whose bodies are driven by lengths instead of forces"
            raise InputError("--mode", self.mode.value, allowed)
        if self.figures and self.mode is Mode.recover:
            raise InputError("--figures", "with --mode recover", "a mode that simulates a trajectory")
        for option in ("force_step", "stiffness", "damping"):
            if getattr(self, option) is not None and self.mode_name != Mode.feedforward:
                place = "--" + option.replace("_", "-")
                raise InputError(place, getattr(self, option), "only with --mode feedforward")

    @property
    def mode_name(self) -> str:
        """The mode that is run."""
        if self.engine == DRIVEN_ENGINE:
            return "driven"
        if self.mode is None:
            return Mode.feedforward.value if self.figures else Mode.recover.value
        return self.mode.value


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulation and the content of its `simulation.json`."""

    outcome: Outcome
    facts: dict[str, Any]

    @property
    def complete(self) -> bool:
        """Whether nothing stopped it."""
        return self.outcome.stopped is None

    @property
    def accurate(self) -> bool:
        """Whether the figures are within the tolerance of their mode, where it has one."""
        return not self.outcome.inaccurate


def simulate(
    mechanism: Mechanism,
    motion: Motion,
    request: Request,
    progress: Callable[[int], None] = lambda _done: None,
) -> Simulation:
    """Returns the simulation that was asked for; what stopped it is part of it.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        request: engine, mode and options.
        progress: called with the number of samples done so far.

    Raises:
        InputError: the options do not fit each other or the motion.
        EngineUnavailable: the engine's library is missing or broken.
        EngineError: nothing could be simulated at all.
    """
    mechanism.check_inertia()
    engine: Any = load_entry(request.engine, FORWARD[request.engine])(mechanism)
    outcome = _run(engine, mechanism, motion, request, progress)
    inaccurate = [outcome.inaccurate] if outcome.inaccurate else []
    notes = [*outcome.notes, *inaccurate, *_beyond_limits(mechanism, motion)]
    if outcome.simulated and motion.estimated:
        notes.append(
            "tracking errors hold how far the recorded poses are off those that their smoothed rates have"
        )
    stop = outcome.stopped
    facts: dict[str, Any] = {"engine": request.engine, "mode": request.mode_name, "version": engine.version()}
    facts |= outcome.measures(mechanism.characteristic_length)
    facts |= {
        "stopped": None if stop is None else {"reason": stop.reason, "t": stop.t},
        "notes": notes,
        "samples": len(outcome.trajectory.planned),
        "formulation": engine.formulation,
        "loops": engine.loops,
        "settings": {"engine": engine.settings} | dict(outcome.settings),
        "mechanism": mechanism_facts(mechanism),
        "motion": motion_facts(motion),
        "versions": versions(),
        "machine": machine(),
    }
    return Simulation(outcome, facts)


def _run(
    engine: Any, mechanism: Mechanism, motion: Motion, request: Request, progress: Callable[[int], None]
) -> Outcome:
    from compare.simulation.driven import driven
    from compare.simulation.feedforward import FORCE_STEP, Gains, feedforward
    from compare.simulation.open_loop import open_loop
    from compare.simulation.recover import recover

    if request.mode_name == Mode.recover:
        return recover(engine, mechanism, motion, progress)
    plan = Plan.of(mechanism, motion)
    if request.engine == DRIVEN_ENGINE:
        return driven(engine, plan, progress)
    if request.mode_name == Mode.open_loop:
        return open_loop(engine, plan, progress)
    # Two steps are no spline, and nobody asked for their length.
    if request.force_step is None and plan.duration <= 2 * FORCE_STEP * (1 + 1e-9):
        allowed = f"more than {2 * FORCE_STEP:g} s with forces every {FORCE_STEP:g} s, or a --force-step"
        raise InputError("motion", f"{plan.duration:g} s long", allowed)
    gains = Gains.of(plan, request.stiffness, request.damping)
    return feedforward(engine, plan, gains, progress, request.force_step or FORCE_STEP)


def _beyond_limits(mechanism: Mechanism, motion: Motion) -> list[str]:
    """Returns a line for all legs that the planned motion takes beyond their limits."""
    lengths = inverse_kinematics(mechanism, motion).lengths
    legs = [
        f"leg {found.leg + 1} to {found.length:.6g} m (limit {found.limit:.6g} m)"
        for found in limit_violations(lengths, mechanism.length_limits)
        if np.isfinite(found.length)
    ]
    return [f"the planned motion takes legs beyond their limits: {', '.join(legs)}"] if legs else []
