"""Engines by name, each imported only when asked for."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version

from packaging.requirements import Requirement

from compare.engine import Engine
from sixsps.errors import EngineUnavailable, UnknownNameError
from sixsps.legs import Legs
from urdf import libraries


@dataclass(frozen=True)
class Entry:
    """Where an engine is.

    Attributes:
        module: file that holds it.
        attribute: its class there.
        library: import name of what it needs.
        package: distribution that provides the library; which versions will do is said once, in
            the requirements of sixsps.
        extra: extra of sixsps that installs it; empty when it is part of the core.
        ups: its class for legs on universal joints; empty when it has none.
        twin: engine whose code it shares so far that the two can be wrong together; empty for none.
    """

    module: str
    attribute: str
    library: str
    package: str
    extra: str = ""
    ups: str = ""
    twin: str = ""


ENGINES: dict[str, Entry] = {
    "kane": Entry("compare.engines.kane", "Kane", "numpy", "numpy"),
    "casadi": Entry("compare.engines.casadi", "Casadi", "casadi", "casadi"),
    "fast": Entry("compare.engines.fast", "Fast", "numba", "numba", twin="casadi"),
    "lagrange": Entry("compare.engines.lagrange", "Lagrange", "casadi", "casadi"),
    "newton-euler": Entry("compare.engines.newton_euler", "NewtonEuler", "numpy", "numpy"),
    "virtual-work": Entry("compare.engines.virtual_work", "VirtualWork", "numpy", "numpy"),
    "pinocchio": Entry("compare.engines.pinocchio", "Pinocchio", "pinocchio", "pin", ups="PinocchioUps"),
    "pinocchio-ball": Entry(
        "compare.engines.pinocchio", "PinocchioBall", "pinocchio", "pin", twin="pinocchio"
    ),
    "mujoco": Entry("compare.engines.mujoco", "Mujoco", "mujoco", "mujoco", "mujoco", ups="MujocoUps"),
    "drake": Entry("compare.engines.drake", "Drake", "pydrake", "drake", "drake", ups="DrakeUps"),
    "dart": Entry("compare.engines.dart", "Dart", "dartpy", "dartpy", "dart", ups="DartUps"),
    "exudyn": Entry("compare.engines.exudyn", "Exudyn", "exudyn", "exudyn", "exudyn"),
    "opensim": Entry("compare.engines.opensim", "Opensim", "opensim", "opensim", "opensim"),
    "sympy": Entry("compare.engines.sympy", "Sympy", "sympy", "sympy", "sympy"),
}


# Engines of the whole tree of hexapod and robot, which are given both as a `Ride` in place of a motion.
PAYLOAD_ENGINES: dict[str, Entry] = {
    "pinocchio-payload": Entry("compare.payload.whole_tree", "PinocchioPayload", "pinocchio", "pin"),
}


@dataclass(frozen=True)
class Trap(Entry):
    """A call that people reach for and that is wrong; `why` says so in one sentence."""

    why: str = ""


TRAPS: dict[str, Trap] = {
    "wu2012-printed": Trap(
        "compare.traps.formulations", "Wu2012Printed", "numpy", "numpy",
        why="The equations exactly as printed, with a wrong sign, vectors in the wrong axes and terms left "
        "out: see the table of errata.",
    ),
    "euler-rates": Trap(
        "compare.traps.formulations", "EulerRates", "numpy", "numpy",
        why="The rates of Euler angles are no angular velocity: it is E(alpha, beta) times them.",
    ),
    "massless-legs": Trap(
        "compare.traps.formulations", "MasslessLegs", "numpy", "numpy",
        why="The legs' weight and inertia are loads of the actuators too.",
    ),
    "pinocchio-tree": Trap(
        "compare.traps.pinocchio", "PinocchioTree", "pinocchio", "pin",
        why="RNEA of the open tree knows no loop: each actuator carries no more than its own upper link, and "
        "the platform hangs on forces that no joint of the machine exerts.",
    ),
    "pinocchio-contact": Trap(
        "compare.traps.pinocchio", "PinocchioContact", "pinocchio", "pin",
        why="contactInverseDynamics is made for contacts with friction: on loop closures it finds no force, "
        "reports convergence and returns the open tree's torques.",
    ),
    "mujoco-equality": Trap(
        "compare.traps.mujoco", "MujocoEquality", "mujoco", "mujoco", "mujoco",
        why="MuJoCo's closures push only as far as a motion violates them: along one that keeps the loops "
        "closed they carry no load, and each actuator feels no more than its own upper link.",
    ),
    "drake-tree": Trap(
        "compare.traps.drake", "DrakeTree", "pydrake", "drake", "drake",
        why="CalcInverseDynamics ignores the plant's constraints: each actuator carries no more than its own "
        "upper link, and nothing of the platform.",
    ),
}  # fmt: skip


def with_legs(legs: Legs, *, robot: bool = False) -> list[str]:
    """Returns the names of the engines that have such legs, with `robot` of those too that take a robot."""
    engines = ENGINES | PAYLOAD_ENGINES if robot else ENGINES
    return [name for name, place in engines.items() if legs is Legs.sps or place.ups]


def check_names(names: list[str], *, traps: bool = False, robot: bool = False) -> None:
    """Raises UnknownNameError, which lists the engines that exist, for a name that is none.

    Args:
        names: to check.
        traps: whether the name of a trap will do.
        robot: whether the name of an engine for a robot on the platform will do.
    """
    known = [*ENGINES, *(PAYLOAD_ENGINES if robot else ()), *(TRAPS if traps else ())]
    for name in names:
        if name in PAYLOAD_ENGINES and not robot:
            raise UnknownNameError("engine", name, "only in a comparison with a robot as --payload")
        if name not in known:
            raise UnknownNameError("engine", name, ", ".join(known))


def entry(name: str, legs: Legs = Legs.sps) -> Entry:
    """Returns where an engine or a trap is.

    Args:
        name: one of `ENGINES`, `TRAPS` or `PAYLOAD_ENGINES`.
        legs: joints of its legs.

    Raises:
        UnknownNameError: there is no such engine.
        EngineUnavailable: its legs are SPS only.
    """
    check_names([name], traps=True, robot=True)
    found = {**ENGINES, **TRAPS, **PAYLOAD_ENGINES}[name]
    if legs is Legs.ups and not found.ups:
        raise EngineUnavailable(name, "its legs stand on ball joints only")
    attribute = found.ups if legs is Legs.ups else found.attribute
    return Entry(found.module, attribute, found.library, found.package, found.extra)


def load(name: str, legs: Legs = Legs.sps) -> type[Engine]:
    """Returns the class of an engine.

    Args:
        name: one of `ENGINES`, `TRAPS` or `PAYLOAD_ENGINES`.
        legs: joints of its legs.

    Raises:
        UnknownNameError: there is no such engine.
        EngineUnavailable: its legs are SPS only, or its library is missing or broken; the reason is
            what importing it said.
    """
    return load_entry(name, entry(name, legs))


def load_entry(name: str, entry: Entry) -> type[Engine]:
    """Returns the class of an engine that need not be registered; see `load`."""
    check_installed(name, entry)
    wrong = _wrong_version(entry.package)
    if wrong:
        raise EngineUnavailable(name, wrong, entry.extra)
    module = libraries.import_user(entry.module, name, entry.library, entry.package)
    engine: type[Engine] = getattr(module, entry.attribute)
    return engine


def check_installed(name: str, entry: Entry) -> None:
    """Raises EngineUnavailable where an engine's library is not there; imports nothing."""
    libraries.check_installed(name, entry.library, entry.package, entry.extra)


def _wrong_version(package: str) -> str:
    """Returns what is wrong with the installed version of a package, by the requirements of sixsps."""
    try:
        installed, lines = version(package), requires("sixsps") or []
    except PackageNotFoundError:  # part of another distribution, or sixsps runs from its source alone
        return ""
    for requirement in map(Requirement, lines):
        if requirement.name == package and not requirement.specifier.contains(installed, prereleases=True):
            return f"package {package} {installed} is installed, {requirement.specifier} is needed"
    return ""
