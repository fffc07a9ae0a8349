"""The forces of one engine along one motion, for `sixsps forces`."""

from __future__ import annotations

from dataclasses import dataclass

from compare.metrics import singular_samples
from compare.registry import ENGINES
from compare.report import singular_lines
from compare.runner import Watcher, run
from sixsps.arrays import Array
from sixsps.errors import EngineError, EngineUnavailable
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION


@dataclass(frozen=True, eq=False)
class SingleRun:
    """Forces (n, 6) [N], NaN at singular samples, and what the user has to be told."""

    forces: Array
    warnings: list[str]


def engine_forces(engine: str, mechanism: Mechanism, motion: Motion, watch: Watcher) -> SingleRun:
    """Runs one engine in a process of its own.

    Args:
        engine: a name of the registry.
        mechanism: geometry and inertia.
        motion: n samples.
        watch: told how it gets on.

    Raises:
        EngineUnavailable: its library is missing.
        EngineError: it failed.
    """
    legs = inverse_kinematics(mechanism, motion)
    regular = legs.condition <= SINGULAR_CONDITION
    (outcome,) = run([engine], mechanism, motion, regular, watch=watch)
    if outcome.status == "unavailable":
        raise EngineUnavailable(engine, outcome.reason, ENGINES[engine].extra)
    if outcome.forces is None:
        raise EngineError(f"engine {engine}: {outcome.reason}")
    return SingleRun(outcome.forces, singular_lines(singular_samples(motion, legs)))
