"""Engines by name, each imported only when asked for."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec

from compare.engine import Engine
from sixsps.errors import EngineUnavailable, UnknownNameError


@dataclass(frozen=True)
class Entry:
    """Where an engine is.

    Attributes:
        module: file that holds it.
        attribute: its class there.
        library: import name of what it needs.
        package: distribution that provides the library.
        extra: extra of sixsps that installs it; empty when it is part of the core.
    """

    module: str
    attribute: str
    library: str
    package: str
    extra: str = ""


ENGINES: dict[str, Entry] = {
    "kane": Entry("compare.engines.kane", "Kane", "numpy", "numpy"),
    "casadi": Entry("compare.engines.casadi", "Casadi", "casadi", "casadi"),
    "pinocchio": Entry("compare.engines.pinocchio", "Pinocchio", "pinocchio", "pin"),
    "pinocchio-ball": Entry("compare.engines.pinocchio", "PinocchioBall", "pinocchio", "pin"),
}


def check_names(names: list[str]) -> None:
    """Raises UnknownNameError, which lists the engines that exist, for a name that is none."""
    for name in names:
        if name not in ENGINES:
            raise UnknownNameError("engine", name, ", ".join(ENGINES))


def load(name: str) -> type[Engine]:
    """Returns the class of an engine.

    Args:
        name: one of `ENGINES`.

    Raises:
        UnknownNameError: there is no such engine.
        EngineUnavailable: its library is missing or broken; the reason is what importing it said.
    """
    check_names([name])
    return load_entry(name, ENGINES[name])


def load_entry(name: str, entry: Entry) -> type[Engine]:
    """Returns the class of an engine that need not be registered; see `load`."""
    if find_spec(entry.library) is None:
        raise EngineUnavailable(name, f"package {entry.package} is not installed", entry.extra)
    try:
        import_module(entry.library)
    except Exception as error:  # a broken installation may raise anything
        reason = f"package {entry.package} does not import: {type(error).__name__}: {error}"
        raise EngineUnavailable(name, reason, entry.extra) from error
    engine: type[Engine] = getattr(import_module(entry.module), entry.attribute)
    return engine
