"""True errors: every engine against certified forces, at a stated subset of the samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compare.runner import Outcome
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

_SPREAD = 16
CHOICE = "first, last, largest difference of every engine, and evenly spread"


def certify(
    mechanism: Mechanism, motion: Motion, outcomes: Sequence[Outcome], reference: Array
) -> dict[str, Any]:
    """Returns what is proven of each engine's error.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        outcomes: of the engines.
        reference: (n, 6) forces from which the worst samples are taken; NaN where singular.

    Returns:
        `samples` and `choice`, and by engine the largest error relative to the largest force
        of the motion; or `reason` where python-flint is missing or fails, or no sample is regular.
    """
    try:
        from sixsps.certified import CertificationError, certified_inverse_dynamics
    except ImportError as error:
        return {"reason": f"python-flint is not there: {error}", "samples": 0, "engines": {}}
    regular = np.flatnonzero(np.isfinite(reference).all(axis=1))
    if len(regular) == 0:
        return {"reason": "no regular sample", "samples": 0, "engines": {}}
    chosen = _chosen(regular, outcomes, reference)
    try:
        truth = certified_inverse_dynamics(mechanism, motion[chosen])
    except CertificationError as error:
        return {"reason": str(error), "samples": 0, "engines": {}}
    largest = float(np.nanmax(np.abs(reference))) or 1.0
    errors = {
        outcome.engine: float(np.nanmax(truth.errors(outcome.forces[chosen]))) / largest
        for outcome in outcomes
        if outcome.forces is not None
    }
    return {"reason": "", "samples": len(chosen), "choice": CHOICE, "engines": errors}


def _chosen(regular: NDArray[np.intp], outcomes: Sequence[Outcome], reference: Array) -> NDArray[np.intp]:
    spread = regular[np.linspace(0, len(regular) - 1, min(_SPREAD, len(regular))).astype(np.intp)]
    worst = [
        regular[int(np.abs(outcome.forces - reference)[regular].max(axis=1).argmax())]
        for outcome in outcomes
        if outcome.forces is not None
    ]
    return np.unique(np.concatenate([spread, np.array(worst, dtype=np.intp)]))
