"""Engines that cannot share the process: computed in another one, which is sent the motion.

OpenSim and CasADi each bring a library of the same name and different content.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context

from compare import registry
from compare.engine import Engine
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

APART = frozenset({"opensim"})


@cache
def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"))


def load(name: str, mechanism: Mechanism) -> tuple[str, Callable[[Motion], Array]]:
    """Returns the version of an engine, and its forces along a motion, computed in the other process.

    Raises:
        EngineUnavailable: its library is missing or broken.
        EngineError: it does not accept the mechanism.
    """
    shown = _pool().submit(_version, name).result()

    def forces(motion: Motion) -> Array:
        return _pool().submit(_forces, name, mechanism, motion).result()

    return shown, forces


def _version(name: str) -> str:
    return registry.load(name).version()


@cache
def _engine(name: str, mechanism: Mechanism) -> Engine:
    return registry.load(name)(mechanism)


def _forces(name: str, mechanism: Mechanism, motion: Motion) -> Array:
    return _engine(name, mechanism).inverse_dynamics(motion, lambda _done: None).forces
