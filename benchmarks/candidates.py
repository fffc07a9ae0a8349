"""What is compared along a motion: this project's ways, and the registered engines by their own classes.

All get the same states as arrays of a `Motion`, whose rotation matrices are ready made: those that take
quaternions, `fast` among them, have no use for them. Engines run in this process, each on one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import Any

import casadi as ca
import numpy as np

import sixsps
from benchmarks import apart
from benchmarks.naming import FAST, KANE, MAPPED, ONE_BY_ONE, PINOCCHIO, RNEA, VECTORISED, on_threads
from benchmarks.rounds import Contestant, interleaved
from benchmarks.vectorised import BLOCKS, VectorisedGraph
from benchmarks.workers import thread_counts
from compare import registry
from sixsps import symbolic
from sixsps.arrays import Array
from sixsps.errors import EngineError, EngineUnavailable
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.parameters import parameter_vector

Pass = Callable[[], Any]
PACES = ("compiled", "arrays", "formulation", "engine")
"""What decides how many states a candidate goes over: nanoseconds, a microsecond, tens, hundreds a sample."""

_TRIES = 5
# Registered, and compared in a form of their own.
_OWN = ("fast", "kane", "casadi")
_FORMULATIONS = ("lagrange", "newton-euler", "virtual-work", "sympy")


@dataclass(frozen=True)
class Candidate:
    """One way to compute leg forces.

    Attributes:
        name: of its row.
        what: it is, in a line.
        version: of what computes.
        pace: one of `PACES`.
        prepare: motion -> one pass over it, which returns forces (n, 6), or None where it has none.
        threads: that it uses.
    """

    name: str
    what: str
    version: str
    pace: str
    prepare: Callable[[Motion], Pass]
    threads: int = 1


@dataclass(frozen=True)
class Missing:
    """A candidate that is not there, with the reason."""

    name: str
    reason: str


def of_arrays() -> list[str]:
    """Returns the names of the candidates that work on arrays of many samples."""
    counts = thread_counts()
    fast = [on_threads(FAST, count) for count in dict.fromkeys([counts[0], counts[-1]])]
    return [*fast, VECTORISED, KANE, MAPPED]


def names(engines: tuple[str, ...]) -> list[str]:
    """Returns the names of all candidates, with those of some registered engines."""
    others = [name for name in engines if name not in _OWN]
    return [*of_arrays(), ONE_BY_ONE, *([RNEA] if PINOCCHIO in others else []), *others]


def build(name: str, mechanism: Mechanism, motion: Motion) -> Candidate | Missing:
    """Returns a candidate, or why it is missing.

    Args:
        name: one of `names`.
        mechanism: geometry and inertia.
        motion: some of the states, to try things on.
    """
    for count in thread_counts():
        if name == on_threads(FAST, count):
            return _fast(name, mechanism, count)
    if name == VECTORISED:
        return _vectorised(mechanism, motion)
    if name == KANE:
        forces = partial(sixsps.inverse_dynamics, mechanism)
        what = "`sixsps.inverse_dynamics`: Kane's method in NumPy"
        return Candidate(name, what, _version("numpy"), "formulation", partial(_along, forces))
    if name == MAPPED:
        forces = partial(_mapped, mechanism)
        what = "CasADi's VM, one call for all samples"
        return Candidate(name, what, _version("casadi"), "formulation", partial(_along, forces))
    if name == ONE_BY_ONE:
        prepare = partial(_one_by_one, mechanism)
        return Candidate(name, "CasADi's VM, one call a sample", _version("casadi"), "engine", prepare)
    try:
        return _engine(name, mechanism)
    except EngineUnavailable as error:
        return Missing(name, error.detail)
    except EngineError as error:  # it refuses the mechanism
        return Missing(name, str(error))


def _fast(name: str, mechanism: Mechanism, threads: int) -> Candidate:
    forces = sixsps.compile(mechanism, threads).inverse_dynamics
    what = "`sixsps.compile`: the symbolic graph as machine code"
    return Candidate(name, what, _version("sixsps"), "compiled", partial(_along, forces), threads)


def _vectorised(mechanism: Mechanism, motion: Motion) -> Candidate:
    chosen = fastest_block(mechanism, motion)
    what = f"the same graph in NumPy, blocks of {chosen.block} samples"
    return Candidate(VECTORISED, what, _version("numpy"), "arrays", partial(_along, chosen.inverse_dynamics))


def _engine(name: str, mechanism: Mechanism) -> Candidate:
    if name == RNEA:
        return _rnea(mechanism)
    if name in apart.APART:
        shown, forces = apart.load(name, mechanism)
        what = "its engine, in a process of its own"
        return Candidate(name, what, shown, "engine", partial(_along, forces))
    kind = registry.load(name)
    engine = kind(mechanism)

    def prepare(motion: Motion) -> Pass:
        return lambda: engine.inverse_dynamics(motion, lambda _done: None).forces

    what = f"its engine: {kind.formulation}"
    return Candidate(
        name, what, kind.version(), "formulation" if name in _FORMULATIONS else "engine", prepare
    )


def _rnea(mechanism: Mechanism) -> Candidate:
    kind = registry.load(PINOCCHIO)
    from benchmarks.pinocchio_steps import PinocchioSteps  # it takes Pinocchio, which is there

    def prepare(motion: Motion) -> Pass:
        return PinocchioSteps(mechanism, motion).rnea_of_all

    what = "`pin.rnea` of the generated tree alone, joint states ready made; the loops stay open"
    return Candidate(RNEA, what, kind.version(), "engine", prepare)


def fastest_block(mechanism: Mechanism, motion: Motion) -> VectorisedGraph:
    """Returns the NumPy evaluation with the length of block that is fastest on this machine."""
    found = [VectorisedGraph(mechanism, block=block) for block in BLOCKS]
    runs = [Contestant(str(one.block), len(motion), partial(one.inverse_dynamics, motion)) for one in found]
    times = interleaved(runs, _TRIES, 0.0, lambda _round: None)
    return min(found, key=lambda one: min(times[str(one.block)]))


def casadi_arguments(mechanism: Mechanism, motion: Motion) -> list[list[ca.DM]]:
    """Returns for each sample the arguments of `sixsps.symbolic.forces` in CasADi's own type."""
    columns, parameters = symbolic.motion_columns(motion), ca.DM(parameter_vector(mechanism))
    return [[*(ca.DM(rows[:, k]) for rows in columns.values()), parameters] for k in range(len(motion))]


def _along(forces: Callable[[Motion], Array], motion: Motion) -> Pass:
    return partial(forces, motion)


def _mapped(mechanism: Mechanism, motion: Motion) -> Array:
    return symbolic.evaluate(symbolic.forces(), mechanism, motion)["F"]


def _one_by_one(mechanism: Mechanism, motion: Motion) -> Pass:
    function, arguments = symbolic.forces(), casadi_arguments(mechanism, motion)
    return lambda: np.array([function.call(given)[0].full().ravel() for given in arguments])


def _version(package: str) -> str:
    return f"{package} {version(package)}"
