"""The forces of one engine along one motion, and those in the joints, for `sixsps forces`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compare.metrics import singular_samples
from compare.runner import Watcher, run
from compare.summary import singular_lines
from sixsps.arrays import Array
from sixsps.errors import EngineError, EngineUnavailable, InputError
from sixsps.formulations.newton_euler import joint_reactions
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION

_FORCES = [f"f{leg}" for leg in range(1, 7)]
_REACTIONS = [f"{joint}{leg}{axis}" for joint in "ab" for leg in range(1, 7) for axis in "xyz"]


@dataclass(frozen=True, eq=False)
class SingleRun:
    """Columns (n,) of a force file [N], NaN at singular samples, and what the user has to be told."""

    columns: dict[str, Array]
    warnings: list[str]


def chosen_engine(engine: str | None, reactions: bool) -> str:
    """Returns the engine that was asked for, or the default: only newton-euler gives reactions.

    Raises:
        InputError: reactions of another engine.
    """
    if reactions and engine not in (None, "newton-euler"):
        raise InputError("--engine", engine, "newton-euler with --reactions, no other gives them")
    default = "newton-euler" if reactions else "kane"
    return default if engine is None else engine


def engine_forces(engine: str, mechanism: Mechanism, motion: Motion, watch: Watcher) -> SingleRun:
    """Runs one engine in a process of its own.

    Args:
        engine: a name of the registry.
        mechanism: geometry and inertia.
        motion: n samples.
        watch: told how it gets on.

    Returns:
        Columns f1..f6, leg forces.

    Raises:
        EngineUnavailable: its library is missing.
        EngineError: it failed.
    """
    regular, warnings = _regular_samples(mechanism, motion)
    (outcome,) = run([engine], mechanism, motion, regular, watch=watch)
    if outcome.status == "unavailable":
        raise EngineUnavailable(engine, outcome.reason)
    if outcome.forces is None:
        raise EngineError(f"engine {engine}: {outcome.reason}")
    columns = dict(zip(_FORCES, outcome.forces.T, strict=True))
    return SingleRun(columns, warnings)


def forces_and_reactions(mechanism: Mechanism, motion: Motion, watch: Watcher) -> SingleRun:
    """Runs newton-euler in this process.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        watch: told how it gets on.

    Returns:
        Columns f1..f6, leg forces; a1x,a1y,a1z,..,a6z and b1x,..,b6z, forces on the legs at the base
        and platform joints, world axes.

    Raises:
        EngineError: a force at a regular sample is not a number.
    """
    regular, warnings = _regular_samples(mechanism, motion)
    given = motion[regular]
    found = joint_reactions(mechanism, given, lambda done: watch("newton-euler", "running", done))
    joints = np.concatenate([found.base, found.platform], axis=1).reshape(len(given), 36)
    table = np.full((len(motion), 42), np.nan)
    table[regular] = np.hstack([found.forces, joints])
    missing = regular & ~np.isfinite(table).all(axis=1)
    if missing.any():
        time = motion.time[np.argmax(missing)]
        raise EngineError(f"engine newton-euler: a force at t = {time:g} s is not a number")
    columns = dict(zip([*_FORCES, *_REACTIONS], table.T, strict=True))
    return SingleRun(columns, warnings)


def _regular_samples(mechanism: Mechanism, motion: Motion) -> tuple[NDArray[np.bool_], list[str]]:
    """Returns (n,) which samples an engine is given, and a line for each of the others."""
    legs = inverse_kinematics(mechanism, motion)
    return legs.condition <= SINGULAR_CONDITION, singular_lines(singular_samples(motion, legs))
