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
from compare.runner import Outcome, Watcher, run
from compare.tolerances import TOLERANCES, rounding_bound
from sixsps import symbolic
from sixsps.arrays import Array
from sixsps.formulations import inverse_dynamics
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION

REFERENCE = "kane"
SCHEMA = 1
_PACKAGES = ("sixsps", "numpy", "scipy", "casadi", "pin", "xacro", "pyarrow")


@dataclass(frozen=True, eq=False)
class Comparison:
    """What a comparison found.

    Attributes:
        results: content of `results.json`, plain data.
        outcomes: forces and closure checks of every engine.
        motion: the motion they belong to.
    """

    results: dict[str, Any]
    outcomes: list[Outcome]
    motion: Motion

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
    condition = float(legs.condition[regular].max(initial=1.0))
    entries = {
        outcome.engine: _entry(outcome, reference, motion, condition, tolerance)
        | {"requested": outcome.engine in requested}
        for outcome in outcomes
    }
    results = {
        "schema": SCHEMA,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": _versions(),
        "machine": _machine(),
        "mechanism": _mechanism(mechanism),
        "motion": _motion(motion),
        "reference": {
            "engine": REFERENCE,
            "bound": rounding_bound(REFERENCE, condition),
            "reason": f"{TOLERANCES[REFERENCE].rounding_factor:g} x cond(J) x unit roundoff: "
            + TOLERANCES[REFERENCE].reason,
        },
        "engines": entries,
        **_measures(mechanism, motion, legs, reference),
        "singular_samples": singular_samples(motion, legs),
    }
    return Comparison(results, outcomes, motion)


def _reference(outcomes: list[Outcome], mechanism: Mechanism, motion: Motion) -> Array:
    for outcome in outcomes:
        if outcome.engine == REFERENCE and outcome.forces is not None:
            return outcome.forces
    return inverse_dynamics(mechanism, motion, REFERENCE)


def _entry(
    outcome: Outcome, reference: Array, motion: Motion, condition: float, tolerance: float | None
) -> dict[str, Any]:
    allowed = TOLERANCES[outcome.engine].relative(condition) if tolerance is None else tolerance
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
        "tolerance_rel": allowed,
        "within_tolerance": None,
    }
    if outcome.forces is None:
        return entry
    samples = int(np.isfinite(reference).all(axis=1).sum())
    if outcome.seconds is not None and samples:
        entry["microseconds_per_sample"] = outcome.seconds / samples * 1e6
    worst = metrics.worst_difference(outcome.forces, reference)
    relative = metrics.relative_error(outcome.forces, reference)
    entry |= {
        "max_abs_error_N": worst.value,
        "max_rel_error": relative,
        "worst": {"t": float(motion.time[worst.sample]), "leg": worst.leg + 1},
        "digits": None if outcome.engine == REFERENCE else metrics.digits(relative),
        "within_tolerance": relative <= allowed,
    }
    return entry


def _largest(values: Array | None) -> float | None:
    return None if values is None or not np.isfinite(values).any() else float(np.nanmax(values))


def _measures(mechanism: Mechanism, motion: Motion, legs: LegKinematics, reference: Array) -> dict[str, Any]:
    rate = symbolic.evaluate(symbolic.energy_rate(), mechanism, motion)["rate"][:, 0]
    balance = metrics.power_balance(mechanism, motion, legs, reference, rate)
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
            "value": _finite(float(legs.condition[worst])),
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
        "power_balance_residual": _finite(balance.relative),
        "power_balance_residual_W": _finite(balance.watts),
    }


def _range(name: str, unit: str, values: Array) -> dict[str, float | None]:
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
    return {f"{name}_min_{unit}": low, f"{name}_max_{unit}": high}


def _finite(value: float) -> float | None:
    """JSON has no infinity and no NaN."""
    return value if np.isfinite(value) else None


def singular_samples(motion: Motion, legs: LegKinematics) -> list[dict[str, Any]]:
    """Returns number (from 1), time and condition number of every singular sample.

    Args:
        motion: n samples.
        legs: `inverse_kinematics(mechanism, motion)`.
    """
    return [
        {
            "sample": int(k) + 1,
            "t": float(motion.time[k]),
            "condition": _finite(float(legs.condition[k])),
        }
        for k in np.flatnonzero(legs.condition > SINGULAR_CONDITION)
    ]


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
