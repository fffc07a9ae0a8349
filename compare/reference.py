"""What errors are taken from: certified forces, at a stated subset of the samples.

Certifying a sample takes a hundred times as long as computing it. At the samples that are not
certified an engine stands in, and only one that the certified samples confirm. They include, for
every engine and for two formulations that are always computed, the sample where it is furthest from the
stand-in in units of what is allowed: a slip of the stand-in anywhere is a difference from an engine
without it, and the largest such difference is certified. Where a sample is not certified, an engine that is
not the stand-in's twin has to agree with it: two that evaluate the same equations bear no witness for
each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from compare import metrics
from compare.registry import ENGINES
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
_ALWAYS = (STAND_IN, "newton-euler")
CHOICE = "first, last, evenly spread, and where an engine is furthest from the others"
SPREAD = 16


@dataclass(frozen=True, eq=False)
class Reference:
    """Forces that errors are taken from.

    Attributes:
        engine: "certified", or the engine that stands in everywhere when nothing is certified.
        stand_in: the engine whose forces count where none are certified; empty when the certified
            samples confirm none, so that nothing counts there.
        forces: (n, 6) certified forces or the stand-in's [N]; NaN at samples that do not count.
        samples: (k,) indices of the samples at which errors are taken.
        truth: enclosures of the forces at `samples`; None when nothing is certified.
        scale: (n,) what errors are allowed relative to [N]; see `metrics.scales`.
        bound: how far the reference may be from the true forces, relative.
        reason: what the bound rests on.
        missing: why nothing is certified; empty when it is.
    """

    engine: str
    stand_in: str
    forces: Array
    samples: NDArray[np.intp]
    truth: CertifiedForces | None
    scale: Array
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
    mechanism: Mechanism,
    motion: Motion,
    outcomes: Sequence[Outcome],
    growth: Array,
    regular: NDArray[np.bool_],
    spread: int = SPREAD,
) -> Reference:
    """Returns certified forces at some samples and an engine that they confirm for the others.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        outcomes: of the engines.
        growth: (n,) `LegKinematics.error_growth`.
        regular: (n,) bool; the other samples have no forces.
        spread: number of evenly spread samples to certify.
    """
    candidates = _candidates(mechanism, motion, outcomes)
    load = metrics.loads(mechanism, motion)
    first = candidates[STAND_IN]
    usable = np.flatnonzero(regular & np.isfinite(first).all(axis=1))
    try:
        certifier = _Certifier(mechanism, motion)
    except Exception as error:  # a broken library must not take the engines' results along
        return _uncertified(first, usable, growth, load, f"python-flint is not there: {error}")
    if not regular.any():
        return _uncertified(first, usable, growth, load, "no regular sample")
    chosen = np.flatnonzero(regular)
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(spread, len(chosen))).astype(np.intp)]
    certifier.add(chosen)
    for name, stand_in in candidates.items():
        if not np.isfinite(stand_in[regular]).all():
            continue
        for other, forces in candidates.items():
            certifier.add(_furthest(other, forces, stand_in, growth, metrics.scales(stand_in, load), regular))
        found = certifier.reference(name, stand_in, load)
        if found is None or metrics.excess(stand_in, found, tolerance_of(name).relative(growth)).ratio > 1:
            continue
        witnessed = _witnessed(name, candidates, growth, found.scale)
        witnessed[found.samples] = True
        if witnessed[regular].all():
            return found
    alone = certifier.reference("", np.full((len(motion), 6), np.nan), load)
    return alone or _uncertified(first, usable, growth, load, "no sample could be certified")


def _candidates(mechanism: Mechanism, motion: Motion, outcomes: Iterable[Outcome]) -> dict[str, Array]:
    """Returns forces by name: two formulations always, then every engine that gave any."""
    given = {outcome.engine: outcome.forces for outcome in outcomes if outcome.forces is not None}
    computed = {name: inverse_dynamics(mechanism, motion, name) for name in _ALWAYS if name not in given}
    return {name: given.get(name, computed.get(name)) for name in _ALWAYS} | given  # type: ignore[return-value]


def _furthest(
    name: str, forces: Array, stand_in: Array, growth: Array, scale: Array, regular: NDArray[np.bool_]
) -> NDArray[np.intp]:
    """Returns the samples with the largest difference, absolute and in units of what is allowed."""
    difference = np.where(regular, np.abs(forces - stand_in).max(axis=1), -1.0)
    difference = np.where(np.isnan(difference), np.inf, difference)
    of_allowed = difference / (tolerance_of(name).relative(growth) * scale)
    return np.array([difference.argmax(), np.where(regular, of_allowed, -1.0).argmax()])


def _witnessed(name: str, candidates: dict[str, Array], growth: Array, scale: Array) -> NDArray[np.bool_]:
    """Returns (n,) where an engine of other equations gives the forces of `name`, within both tolerances."""
    stand_in = candidates[name]
    agreed = np.zeros(len(stand_in), dtype=bool)
    for other, forces in candidates.items():
        if other in ENGINES and _equations(other) != _equations(name):  # a trap bears no witness
            allowed = (tolerance_of(name).relative(growth) + tolerance_of(other).relative(growth)) * scale
            agreed |= np.abs(forces - stand_in).max(axis=1) <= allowed
    return agreed


def _equations(engine: str) -> str:
    """Returns the engine whose equations an engine evaluates: itself, or its twin."""
    return ENGINES[engine].twin or engine if engine in ENGINES else engine


def _uncertified(forces: Array, usable: NDArray[np.intp], growth: Array, load: Array, why: str) -> Reference:
    bound = tolerance_of(STAND_IN).rounding(float(growth[usable].max()) if len(usable) else 1.0)
    scale, reason = metrics.scales(forces, load), rounding_reason(STAND_IN)
    return Reference(STAND_IN, STAND_IN, forces, usable, None, scale, bound, reason, why)


class _Certifier:
    """Certified forces of a motion, sample by sample, each computed once."""

    def __init__(self, mechanism: Mechanism, motion: Motion) -> None:
        self._library: Any = import_module("sixsps.certified")  # at its price, and only where it is there
        self._mechanism, self._motion = mechanism, motion
        self._found: dict[int, CertifiedForces] = {}
        self._given_up: set[int] = set()

    def add(self, samples: NDArray[np.intp]) -> None:
        """Certifies samples; those whose forces cannot be enclosed are left out."""
        for sample in samples.tolist():
            if sample in self._found or sample in self._given_up:
                continue
            single = self._motion[np.array([sample])]
            try:
                self._found[sample] = self._library.certified_inverse_dynamics(self._mechanism, single)
            except self._library.CertificationError:
                self._given_up.add(sample)

    def reference(self, name: str, stand_in: Array, load: Array) -> Reference | None:
        """Returns the reference that has `stand_in` stand in, right or wrong; None without a sample."""
        samples = np.array(
            [k for k in sorted(self._found) if not self._found[k].singular.any()], dtype=np.intp
        )
        if len(samples) == 0:
            return None
        singles = [self._found[k] for k in samples.tolist()]
        rows = [row for single in singles for row in single.enclosures]
        truth = self._library.CertifiedForces(rows, max(single.bits for single in singles))
        forces = np.array(stand_in)
        forces[samples] = truth.forces
        reason = "ball arithmetic, of the largest force of each sample"
        scale = metrics.scales(forces, load)
        return Reference(CERTIFIED, name, forces, samples, truth, scale, self._library.RADIUS, reason, "")
