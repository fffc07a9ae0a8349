"""What errors are taken from: certified forces, at a stated subset of the samples.

Certifying a sample takes a hundred times as long as computing it. At the samples that are not
certified an engine stands in, one that the certified samples have found to be within its tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from compare import metrics
from compare.runner import Outcome
from compare.tolerances import rounding_reason, tolerance_of
from sixsps.arrays import Array
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

if TYPE_CHECKING:
    from sixsps.certified import CertifiedForces

CERTIFIED = "certified"
STAND_IN = "kane"
CHOICE = "first, last, evenly spread, and the worst of every engine"
_SPREAD = 16


@dataclass(frozen=True, eq=False)
class Reference:
    """Forces that errors are taken from.

    Attributes:
        engine: "certified", or the engine that stands in everywhere when nothing is certified.
        stand_in: the engine whose forces count where none are certified.
        forces: (n, 6) certified forces or the stand-in's [N]; NaN at singular samples.
        samples: (k,) indices of the samples at which errors are taken.
        truth: enclosures of the forces at `samples`; None when nothing is certified.
        bound: how far the reference may be from the true forces, relative.
        reason: what the bound rests on.
        missing: why nothing is certified; empty when it is.
    """

    engine: str
    stand_in: str
    forces: Array
    samples: NDArray[np.intp]
    truth: CertifiedForces | None
    bound: float
    reason: str
    missing: str

    @property
    def largest(self) -> float:
        """Largest force of the motion, the scale of relative errors [N]; 1 where all forces are zero."""
        finite = self.forces[np.isfinite(self.forces)]
        return (float(np.abs(finite).max()) if len(finite) else 0.0) or 1.0

    def errors(self, forces: Array) -> Array:
        """Returns (k, 6) how far forces are from the reference at `samples` [N].

        Args:
            forces: (n, 6) of the whole motion [N].
        """
        if self.truth is None:
            return np.abs(forces[self.samples] - self.forces[self.samples])
        return self.truth.errors(forces[self.samples])

    def facts(self) -> dict[str, Any]:
        """Returns the entry `reference` of the results."""
        return {
            "engine": self.engine,
            "bound": self.bound,
            "reason": self.reason,
            "samples": len(self.samples),
            "choice": CHOICE if self.truth is not None else "all",
            "stand_in": self.stand_in,
            "missing": self.missing,
        }


def find_reference(
    mechanism: Mechanism, motion: Motion, outcomes: Sequence[Outcome], growth: Array
) -> Reference:
    """Returns certified forces at some samples and an engine that they confirm for the others.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        outcomes: of all engines; the worst sample of each is among those certified.
        growth: (n,) `LegKinematics.error_growth`; NaN at singular samples.
    """
    forces = {outcome.engine: outcome.forces for outcome in outcomes if outcome.forces is not None}
    first = forces[STAND_IN] if STAND_IN in forces else inverse_dynamics(mechanism, motion, STAND_IN)
    regular = np.flatnonzero(np.isfinite(first).all(axis=1))
    try:
        from sixsps.certified import CertificationError
    except ImportError as error:
        return _uncertified(first, regular, growth, f"python-flint is not there: {error}")
    if len(regular) == 0:
        return _uncertified(first, regular, growth, "no regular sample")
    try:
        best = _certified(mechanism, motion, STAND_IN, first, forces, regular)
        if _confirmed(best, first, growth):
            return best
        for name, candidate in forces.items():
            found = _certified(mechanism, motion, name, candidate, forces, regular)
            if _confirmed(found, candidate, growth):
                return found
    except CertificationError as error:
        return _uncertified(first, regular, growth, str(error))
    return best


def _uncertified(forces: Array, regular: NDArray[np.intp], growth: Array, why: str) -> Reference:
    largest = float(growth[regular].max()) if len(regular) else 1.0
    bound = tolerance_of(STAND_IN).rounding(largest)
    return Reference(STAND_IN, STAND_IN, forces, regular, None, bound, rounding_reason(STAND_IN), why)


def _certified(
    mechanism: Mechanism,
    motion: Motion,
    name: str,
    stand_in: Array,
    forces: dict[str, Array],
    regular: NDArray[np.intp],
) -> Reference:
    """Returns the reference that has `name` stand in, right or wrong."""
    from sixsps.certified import RADIUS, certified_inverse_dynamics

    spread = regular[np.linspace(0, len(regular) - 1, min(_SPREAD, len(regular))).astype(np.intp)]
    worst = [_worst(other, stand_in, regular) for other in forces.values()]
    samples = np.unique(np.concatenate([spread, *worst]))
    truth = certified_inverse_dynamics(mechanism, motion[samples])
    known = np.array(stand_in)
    known[samples] = truth.forces
    reason = "ball arithmetic, of the largest force of each sample"
    return Reference(CERTIFIED, name, known, samples, truth, RADIUS, reason, "")


def _worst(forces: Array, stand_in: Array, regular: NDArray[np.intp]) -> NDArray[np.intp]:
    """Returns the samples with the largest difference, absolute and relative to their own forces."""
    difference = np.abs(forces - stand_in)[regular].max(axis=1)
    scale = np.abs(stand_in[regular]).max(axis=1)
    relative = np.divide(difference, scale, out=np.zeros_like(scale), where=scale > 0)
    return regular[[int(difference.argmax()), int(relative.argmax())]]


def _confirmed(reference: Reference, stand_in: Array, growth: Array) -> bool:
    allowed = tolerance_of(reference.stand_in).relative(growth)
    return metrics.within(stand_in, reference.forces, allowed)
