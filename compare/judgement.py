"""One engine's row of the results: what it gave, and whether that is within its tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np

from compare import metrics
from compare.reference import Reference
from compare.runner import Outcome
from compare.tolerances import UPS
from sixsps.arrays import Array
from sixsps.motion import Motion


def judged(outcome: Outcome, reference: Reference, motion: Motion, allowed: Array) -> dict[str, Any]:
    """Returns the entry of an engine.

    Args:
        outcome: how its run ended.
        reference: what errors are taken from.
        motion: n samples.
        allowed: (n,) relative error that it may have at a sample.
    """
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
        "tolerance_rel": float(np.nanmax(allowed)),
        "within_tolerance": None,
        "worst_of_allowed": None,
    }
    if outcome.forces is None or len(reference.samples) == 0:
        return entry
    if outcome.seconds is not None:
        samples = int(np.isfinite(outcome.forces).all(axis=1).sum())
        entry["microseconds_per_sample"] = outcome.seconds / samples * 1e6
    # Of an engine that is the reference itself no more can be said than the reference's own bound.
    bound = reference.bound if outcome.engine == reference.engine else None
    return entry | _errors(outcome.forces, reference, motion, allowed, bound)


def judged_with_spin(
    outcome: Outcome,
    reference: Reference,
    motion: Motion,
    allowed: Array,
    spin: Array,
    tolerance: float | None,
) -> dict[str, Any]:
    """Returns the entry of an engine whose legs stand on universal joints.

    Its errors are against legs that do not spin. They may reach `UPS`, or twice what the spin costs
    where that is more; what is left of them without the spin's forces may be no more than usual.

    Args:
        outcome: how its run ended.
        reference: what errors are taken from.
        motion: n samples.
        allowed: (n,) relative error that an engine may have at a sample.
        spin: (n, 6) what the spin of the legs adds to the forces [N].
        tolerance: relative error against legs that do not spin, in place of `UPS` and the spin's cost.
    """
    cost = np.abs(spin).max(axis=1)
    usual = np.maximum(UPS, np.nan_to_num(2 * cost / reference.scale, posinf=0.0))
    row = judged(outcome, reference, motion, usual if tolerance is None else np.full(len(motion), tolerance))
    if outcome.forces is not None and row["within_tolerance"]:
        # Rounding of the spin's own forces counts, which may be the larger ones.
        wider = allowed * (1 + np.nan_to_num(cost / reference.scale, posinf=0.0))
        left = metrics.excess(outcome.forces - spin, reference, wider)
        row["within_tolerance"] = left.ratio <= 1
    return row


def trapped(outcome: Outcome, reference: Reference, motion: Motion, allowed: Array) -> dict[str, Any]:
    """Returns the entry of a call that is known to be wrong, at all samples; see `judged`."""
    row = judged(outcome, reference, motion, allowed)
    if row["worst"] is None or outcome.forces is None:
        return row
    worst = metrics.worst_difference(outcome.forces, reference.forces)
    relative = worst.value / reference.largest
    return row | {
        "max_abs_error_N": worst.value,
        "max_rel_error": relative,
        "worst": {"t": float(motion.time[worst.sample]), "leg": worst.leg + 1},
        "digits": metrics.digits(relative),
    }


def _errors(
    forces: Array, reference: Reference, motion: Motion, allowed: Array, bound: float | None
) -> dict[str, Any]:
    errors = reference.errors(forces)
    row, leg = np.unravel_index(int(np.nanargmax(errors)), errors.shape)
    absolute = float(errors[row, leg])
    relative = absolute / reference.largest
    excess = metrics.excess(forces, reference, allowed)
    return {
        "max_abs_error_N": absolute,
        "max_rel_error": relative,
        "worst": {"t": float(motion.time[reference.samples[row]]), "leg": int(leg) + 1},
        "digits": metrics.digits(relative if bound is None else bound),
        "within_tolerance": excess.ratio <= 1,
        "worst_of_allowed": {
            "ratio": metrics.finite_or_none(excess.ratio),
            "t": float(motion.time[excess.sample]),
            "leg": excess.leg + 1,
        },
    }


def _largest(values: Array | None) -> float | None:
    return None if values is None or not np.isfinite(values).any() else float(np.nanmax(values))
