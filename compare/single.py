"""What `sixsps forces` and `sixsps ik` calculate of a block of samples."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from compare.registry import load
from compare.runner import Watcher, run
from sixsps.arrays import Array
from sixsps.errors import EngineError, EngineUnavailable, InputError
from sixsps.formulations.newton_euler import joint_reactions
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

if TYPE_CHECKING:
    from sixsps.kernels.model import CompiledMechanism

_LEGS = range(1, 7)
_FORCES = tuple(f"f{leg}" for leg in _LEGS)
_REACTIONS = tuple(f"{joint}{leg}{axis}" for joint in "ab" for leg in _LEGS for axis in "xyz")
_LENGTHS = tuple(f"l{leg}" for leg in _LEGS)
_RATES = tuple(f"dl{leg}" for leg in _LEGS)
# A block's arrays stay in the cache, and a few dozen calls of numpy are short beside its numbers.
_BLOCK = 32768
# To start the process of an engine takes as long as the forces of some ten thousand samples.
_PROCESS_BLOCK = 131072
# Leg kinematics are some kilobytes a sample.
_KINEMATICS_BLOCK = 1024
# More would wait for the one thread that reads.
_MOST_THREADS = 4


@dataclass(frozen=True, eq=False)
class Calculated:
    """What was calculated of n samples.

    Attributes:
        columns: name -> (n,) values, first the times t [s]; NaN where the pose is singular.
        singular: (k,) indices of the samples that are.
        condition: (k,) condition numbers of the Jacobian there.
    """

    columns: dict[str, Array]
    singular: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))
    condition: Array = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, eq=False)
class Calculation:
    """A calculation in which no sample depends on another.

    Attributes:
        name: what to call it.
        quantities: names of the columns of its results, apart from the times.
        calculate: (samples, watcher) -> results.
        threads: that may call it at once; 0 where it may only be called by the main thread.
        block: samples that are best given at once.
    """

    name: str
    quantities: tuple[str, ...]
    calculate: Callable[[Motion, Watcher], Calculated]
    threads: int = 0
    block: int = _BLOCK

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns of its results."""
        return ("t", *self.quantities)


def forces_calculation(engine: str | None, mechanism: Mechanism, reactions: bool) -> Calculation:
    """Returns the calculation of leg forces f1..f6 [N].

    Args:
        engine: a name of the registry; kane by default, of reactions newton-euler.
        mechanism: geometry and inertia.
        reactions: also the forces on the legs at the base and platform joints, world axes:
            a1x,a1y,a1z..a6z and b1x..b6z [N].

    Raises:
        InputError: reactions of another engine, or a mechanism of geometry alone.
        EngineUnavailable: the library of `fast` is missing or broken; of others that is found out
            when they calculate.
    """
    mechanism.check_inertia()
    name = chosen_engine(engine, reactions)
    if reactions:
        names, calculate = (*_FORCES, *_REACTIONS), partial(_reactions, mechanism)
        return Calculation(name, names, calculate, _threads())
    if name == "fast":
        load(name)
        from sixsps.kernels.model import compile as compiled

        calculate = partial(_fast_forces, compiled(mechanism, threads=1))
        return Calculation(name, _FORCES, calculate, _threads())
    return Calculation(name, _FORCES, partial(_engine_forces, name, mechanism), block=_PROCESS_BLOCK)


def lengths_calculation(mechanism: Mechanism, rates: bool) -> Calculation:
    """Returns the calculation of leg lengths l1..l6 [m], with `rates` also of their rates dl1..dl6 [m/s]."""
    names = (*_LENGTHS, *_RATES) if rates else _LENGTHS
    return Calculation("ik", names, partial(_lengths, mechanism, rates), _threads())


def chosen_engine(engine: str | None, reactions: bool) -> str:
    """Returns the engine that was asked for, or the default: only newton-euler gives reactions.

    Raises:
        InputError: reactions of another engine.
    """
    if reactions and engine not in (None, "newton-euler"):
        raise InputError("--engine", engine, "newton-euler with --reactions, no other gives them")
    default = "newton-euler" if reactions else "kane"
    return default if engine is None else engine


def _threads() -> int:
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(processors, _MOST_THREADS)


def _engine_forces(engine: str, mechanism: Mechanism, motion: Motion, watch: Watcher) -> Calculated:
    """Runs an engine in a process of its own."""
    condition = _conditions(mechanism, motion)
    regular = condition <= SINGULAR_CONDITION
    (outcome,) = run([engine], mechanism, motion, regular, watch=watch)
    if outcome.status == "unavailable":
        raise EngineUnavailable(engine, outcome.reason)
    if outcome.forces is None:
        raise EngineError(f"engine {engine}: {outcome.reason}")
    return _calculated(_FORCES, motion, outcome.forces, condition)


def _fast_forces(model: CompiledMechanism, motion: Motion, _watch: Watcher) -> Calculated:
    forces = model.inverse_dynamics(motion)
    condition = np.ones(len(motion))
    if not np.isfinite(forces).all():
        missing = np.flatnonzero(~np.isfinite(forces).all(axis=1))
        there = motion[missing]
        J, _ = model.equations(there)  # so that the model's own doubts are told, to the last bit
        lengths = model.inverse_kinematics(there).lengths
        size = model.mechanism.characteristic_length
        condition[missing] = condition_numbers(J.swapaxes(1, 2), lengths, size)
    _check_finite("fast", motion, forces, condition)
    return _calculated(_FORCES, motion, forces, condition)


def _reactions(mechanism: Mechanism, motion: Motion, _watch: Watcher) -> Calculated:
    condition = _conditions(mechanism, motion)
    regular = condition <= SINGULAR_CONDITION
    found = joint_reactions(mechanism, motion[regular])
    joints = np.concatenate([found.base, found.platform], axis=1).reshape(-1, len(_REACTIONS))
    table = np.full((len(motion), len(_FORCES) + len(_REACTIONS)), np.nan)
    table[regular] = np.hstack([found.forces, joints])
    _check_finite("newton-euler", motion, table, condition)
    return _calculated((*_FORCES, *_REACTIONS), motion, table, condition)


def _lengths(mechanism: Mechanism, rates: bool, motion: Motion, _watch: Watcher) -> Calculated:
    parts = [np.hstack([legs.lengths, legs.length_rates]) for legs in _kinematics(mechanism, motion)]
    values = np.concatenate(parts)[:, : 12 if rates else 6]
    return Calculated(_columns((*_LENGTHS, *_RATES) if rates else _LENGTHS, motion, values))


def _conditions(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns (n,) condition numbers of the Jacobian."""
    return np.concatenate([legs.condition for legs in _kinematics(mechanism, motion)])


def _kinematics(mechanism: Mechanism, motion: Motion) -> Iterator[LegKinematics]:
    motion.rotation  # noqa: B018  worked out at once, for all blocks
    for start in range(0, len(motion), _KINEMATICS_BLOCK):
        yield inverse_kinematics(mechanism, motion[start : start + _KINEMATICS_BLOCK])


def _check_finite(engine: str, motion: Motion, values: Array, condition: Array) -> None:
    """Raises EngineError where a value (n, k) at a regular sample is not a number."""
    if np.isfinite(values).all():
        return
    missing = (condition <= SINGULAR_CONDITION) & ~np.isfinite(values).all(axis=1)
    if missing.any():
        time = motion.time[np.argmax(missing)]
        raise EngineError(f"engine {engine}: a force at t = {time:g} s is not a number")


def _calculated(names: tuple[str, ...], motion: Motion, values: Array, condition: Array) -> Calculated:
    singular = np.flatnonzero(~(condition <= SINGULAR_CONDITION))
    return Calculated(_columns(names, motion, values), singular, condition[singular])


def _columns(names: tuple[str, ...], motion: Motion, values: Array) -> dict[str, Array]:
    return {"t": motion.time} | dict(zip(names, np.ascontiguousarray(values.T), strict=True))
