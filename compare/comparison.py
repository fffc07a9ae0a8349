"""The main job: every engine along one motion, measured against the reference."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from compare import metrics
from compare.certification import certify
from compare.runner import Outcome, Watcher, run
from compare.tolerances import TOLERANCES, rounding_bound
from sixsps.arrays import Array
from sixsps.formulations import inverse_dynamics
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION

REFERENCE = "kane"
SCHEMA = 1
_PACKAGES = ("sixsps", "numpy", "scipy", "casadi", "pin", "xacro", "pyarrow", "python-flint")


@dataclass(frozen=True, eq=False)
class Comparison:
    """What a comparison found.

    Attributes:
        results: content of `results.json`, plain data.
        outcomes: forces and closure checks of every engine.
        motion: the motion they belong to.
        reference: (n, 6) forces that errors are taken from [N]; NaN at singular samples.
    """

    results: dict[str, Any]
    outcomes: list[Outcome]
    motion: Motion
    reference: Array

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
    requested: Sequence[str] = (),
    tolerance: float | None = None,
    time_limit: float | None = None,
    watch: Watcher = lambda *_: None,
) -> Comparison:
    """Runs engines along a motion and measures them against the reference.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        engines: names to compare.
        requested: those that the user asked for by name, so that their absence is a failure.
        tolerance: relative error allowed to every engine; by default each has its own.
        time_limit: for one engine's computation [s]; by default it grows with the samples.
        watch: told how the engines get on.

    Returns:
        The comparison; an engine that fails is an entry of it, never an exception.
    """
    legs = inverse_kinematics(mechanism, motion)
    regular = legs.condition <= SINGULAR_CONDITION
    outcomes = run(engines, mechanism, motion, regular, time_limit=time_limit, watch=watch)
    reference = _reference(outcomes, mechanism, motion)
    growth = np.where(regular, legs.error_growth, 1.0)
    bound = rounding_bound(REFERENCE, float(growth.max()))
    entries = {}
    for outcome in outcomes:
        allowed = TOLERANCES[outcome.engine].relative(growth)
        allowed = allowed if tolerance is None else np.full(len(motion), tolerance)
        entries[outcome.engine] = _entry(outcome, reference, motion, allowed, bound)
        entries[outcome.engine]["requested"] = outcome.engine in requested
    results = {
        "schema": SCHEMA,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": _versions(),
        "machine": _machine(),
        "mechanism": _mechanism(mechanism),
        "motion": _motion(motion),
        "reference": {
            "engine": REFERENCE,
            "bound": bound,
            "reason": f"{TOLERANCES[REFERENCE].rounding_factor:g} x cond(J) x (1 + coordinates / leg length) "
            "x unit roundoff: " + TOLERANCES[REFERENCE].reason,
        },
        "engines": entries,
        **_measures(mechanism, motion, legs, reference),
        "certified": certify(mechanism, motion, outcomes, reference),
        "singular_samples": metrics.singular_samples(motion, legs),
    }
    return Comparison(results, outcomes, motion, reference)


def _reference(outcomes: list[Outcome], mechanism: Mechanism, motion: Motion) -> Array:
    for outcome in outcomes:
        if outcome.engine == REFERENCE and outcome.forces is not None:
            return outcome.forces
    return inverse_dynamics(mechanism, motion, REFERENCE)


def _entry(
    outcome: Outcome, reference: Array, motion: Motion, allowed: Array, bound: float
) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "status": outcome.status,
        "reason": outcome.reason,
        "version": outcome.facts.get("version"),
        "formulation": outcome.facts.get("formulation"),
        "loops": outcome.facts.get("loops"),
        "shares": outcome.facts.get("shares"),
        "max_abs_error_N": None,
        "max_rel_error": None,
        "worst": None,
        "digits": None,
        "closure_residual": _largest(outcome.closure_residual),
        "closure_error_m": _largest(outcome.closure_error),
        "microseconds_per_sample": None,
        "tolerance_rel": float(allowed.max()),
        "within_tolerance": None,
    }
    samples = int(np.isfinite(reference).all(axis=1).sum())
    if outcome.forces is None or samples == 0:
        return entry
    if outcome.seconds is not None:
        entry["microseconds_per_sample"] = outcome.seconds / samples * 1e6
    worst = metrics.worst_difference(outcome.forces, reference)
    relative = metrics.relative_error(outcome.forces, reference)
    # Of the reference itself no more can be said than its own bound.
    known = bound if outcome.engine == REFERENCE else relative
    return entry | {
        "max_abs_error_N": worst.value,
        "max_rel_error": relative,
        "worst": {"t": float(motion.time[worst.sample]), "leg": worst.leg + 1},
        "digits": metrics.digits(known),
        "within_tolerance": metrics.within(outcome.forces, reference, allowed),
    }


def _largest(values: Array | None) -> float | None:
    return None if values is None or not np.isfinite(values).any() else float(np.nanmax(values))


def _measures(mechanism: Mechanism, motion: Motion, legs: LegKinematics, reference: Array) -> dict[str, Any]:
    violations = metrics.limit_violations(legs.lengths, mechanism.length_limits)
    worst = int(np.argmax(legs.condition))
    return {
        "legs": [
            {"leg": leg + 1}
            | _range("length", "m", legs.lengths[:, leg])
            | _range("length_rate", "m_s", legs.length_rates[:, leg])
            | _range("force", "N", reference[:, leg])
            for leg in range(6)
        ],
        "max_condition": {
            "value": metrics.finite_or_none(float(legs.condition[worst])),
            "t": float(motion.time[worst]),
            "characteristic_length_m": mechanism.characteristic_length,
        },
        "limit_violations": [
            {
                "leg": violation.leg + 1,
                "samples": violation.samples,
                "t": float(motion.time[violation.worst_sample]),
                "length_m": violation.length,
                "limit_m": violation.limit,
            }
            for violation in violations
        ],
        **_power_balance(mechanism, motion, legs, reference),
    }


def _power_balance(
    mechanism: Mechanism, motion: Motion, legs: LegKinematics, reference: Array
) -> dict[str, Any]:
    try:
        from sixsps import symbolic
    except Exception as error:  # a broken CasADi must not take the other engines' results along
        why = f"the rate of energy needs CasADi: {type(error).__name__}: {error}"
        return {"power_balance_residual": None, "power_balance_residual_W": None, "power_balance_reason": why}
    rate = symbolic.evaluate(symbolic.energy_rate(), mechanism, motion)["rate"][:, 0]
    balance = metrics.power_balance(mechanism, motion, legs, reference, rate)
    return {
        "power_balance_residual": metrics.finite_or_none(balance.relative),
        "power_balance_residual_W": metrics.finite_or_none(balance.watts),
        "power_balance_reason": "",
    }


def _range(name: str, unit: str, values: Array) -> dict[str, float | None]:
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
    return {f"{name}_min_{unit}": low, f"{name}_max_{unit}": high}


def _mechanism(mechanism: Mechanism) -> dict[str, Any]:
    return {
        "name": mechanism.name,
        "sha256": mechanism.sha256,
        "source": mechanism.source,
        "assumed": dict(mechanism.assumed),
    }


def _motion(motion: Motion) -> dict[str, Any]:
    return {
        "name": motion.name,
        "sha256": motion.sha256,
        "samples": len(motion),
        "start_s": float(motion.time[0]),
        "end_s": float(motion.time[-1]),
        "estimated": dict(motion.estimated),
        "changes": list(motion.changes),
    }


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _machine() -> dict[str, Any]:
    return {
        "system": f"{platform.system()} {platform.release()}",
        "architecture": platform.machine(),
        "cores": os.cpu_count(),
    }
