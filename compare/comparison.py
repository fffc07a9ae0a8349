"""The main job: every engine along one motion, measured against certified forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from compare import facts, metrics
from compare.judgement import judged, judged_with_spin, trapped
from compare.payload.aboard import Aboard
from compare.reference import SPREAD, Reference, find_reference
from compare.registry import TRAPS
from compare.runner import Outcome, Watcher, run
from compare.tolerances import tolerance_of
from sixsps.arrays import Array
from sixsps.kinematics import inverse_kinematics
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION
from sixsps.universal_joints import spin_forces

SCHEMA = 2


@dataclass(frozen=True, eq=False)
class Comparison:
    """What a comparison found.

    Attributes:
        results: content of `results.json`, plain data.
        outcomes: forces and closure checks of every engine.
        traps: the same of calls that are known to be wrong.
        motion: the motion they belong to.
        reference: what errors are taken from.
        largest_error_growth: of all samples; see `LegKinematics.error_growth`.
    """

    results: dict[str, Any]
    outcomes: list[Outcome]
    traps: list[Outcome]
    motion: Motion
    reference: Reference
    largest_error_growth: float

    @property
    def agreed(self) -> bool:
        """Whether every engine gave forces within its tolerance at every sample."""
        entries = self.results["engines"].values()
        wrong = any(entry["status"] == "failed" or entry["within_tolerance"] is False for entry in entries)
        missing = any(entry["status"] == "unavailable" and entry["requested"] for entry in entries)
        return not (wrong or missing or self.results["singular_samples"])


def compare(
    mechanism: Mechanism,
    motion: Motion,
    engines: Sequence[str],
    *,
    traps: Sequence[str] = (),
    requested: Sequence[str] = (),
    legs: Legs = Legs.sps,
    tolerance: float | None = None,
    time_limit: float | None = None,
    spread: int = SPREAD,
    watch: Watcher = lambda *_: None,
    aboard: Aboard | None = None,
) -> Comparison:
    """Runs engines along a motion and measures them against the reference.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        engines: names to compare.
        traps: names of calls that are known to be wrong, shown apart; they agree or fail for nobody.
        requested: those that the user asked for by name, so that their absence is a failure.
        legs: joints of the engines' legs. The reference has legs that do not spin, SPS.
        tolerance: relative error allowed to every engine; by default each has its own.
        time_limit: for one engine's computation [s]; by default it grows with the samples.
        spread: number of evenly spread samples to certify.
        watch: told how the engines get on.
        aboard: what mechanism and motion carry, `Cargo.aboard` of the same two.

    Returns:
        The comparison; an engine that fails is an entry of it, never an exception.

    Raises:
        MechanismError: a mechanism of geometry alone.
    """
    mechanism.check_inertia()
    bare = Aboard(mechanism, motion)
    carrying = aboard or bare
    mechanism, motion = carrying.mechanism, carrying.motion
    kinematics = inverse_kinematics(mechanism, motion)
    regular = kinematics.condition <= SINGULAR_CONDITION
    names = [*engines, *traps]
    outcomes = run(
        names, mechanism, motion, regular,
        legs=legs, time_limit=time_limit, watch=watch, ride=carrying.ride,
    )  # fmt: skip
    growth = np.where(regular, kinematics.error_growth, 1.0)
    compared, caught = outcomes[: len(engines)], outcomes[len(engines) :]
    reference = find_reference(mechanism, motion, compared, growth, regular, spread)
    spin = _spin(mechanism, motion) if legs is Legs.ups else None

    def entry(outcome: Outcome) -> dict[str, Any]:
        allowed = tolerance_of(outcome.engine).relative(growth)
        allowed = allowed if tolerance is None else np.full(len(motion), tolerance)
        if spin is None:
            row = judged(outcome, reference, motion, allowed)
        else:
            usual = tolerance_of(outcome.engine).relative(growth)
            row = judged_with_spin(outcome, reference, motion, usual, spin, tolerance)
        return row | {"requested": outcome.engine in requested}

    def trap(outcome: Outcome) -> dict[str, Any]:
        allowed = tolerance_of(outcome.engine).relative(growth)
        row = trapped(outcome, reference, motion, allowed)
        return row | {"requested": False, "why": TRAPS[outcome.engine].why}

    results = {
        "schema": SCHEMA,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": facts.versions(),
        "machine": facts.machine(),
        "mechanism": facts.mechanism_facts(bare.mechanism),
        "motion": facts.motion_facts(bare.motion),
        "payload": carrying.facts,
        "leg_type": legs.value,
        "reference": reference.facts(),
        "engines": {outcome.engine: entry(outcome) for outcome in compared},
        "traps": {outcome.engine: trap(outcome) for outcome in caught},
        "universal_joints": None if spin is None else _universal_joints(spin, compared, reference),
        **facts.measures(mechanism, motion, kinematics, reference.forces),
        "singular_samples": metrics.singular_samples(motion, kinematics),
    }
    return Comparison(results, compared, caught, motion, reference, float(growth.max()))


def _spin(mechanism: Mechanism, motion: Motion) -> Array:
    from urdf.layout import first_axes  # with the whole of urdf, which takes its time to import

    return spin_forces(mechanism, motion, first_axes(mechanism))


def _universal_joints(spin: Array, outcomes: list[Outcome], reference: Reference) -> dict[str, float | None]:
    """Returns what the spin of the legs costs, and what it leaves unexplained of the engines' errors."""
    left = [reference.errors(outcome.forces - spin) for outcome in outcomes if outcome.forces is not None]
    known = np.abs(spin)[np.isfinite(spin)]
    largest = float(known.max()) if len(known) else None
    return {
        "spin_abs_N": largest,
        "spin_rel": None if largest is None else largest / reference.largest,
        "unexplained_rel": float(np.nanmax(left)) / reference.largest if np.isfinite(left).any() else None,
    }
