"""Loading of third-party libraries, so that one that is missing, broken or another is told in one line."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from sixsps.errors import EngineUnavailable


def check_installed(engine: str, library: str, package: str, extra: str = "") -> None:
    """Raises EngineUnavailable where a library is not there; imports nothing.

    Args:
        engine: who needs it.
        library: import name.
        package: distribution that provides it.
        extra: extra of sixsps that installs it; empty when it is part of the core.
    """
    if find_spec(library) is None:
        raise EngineUnavailable(engine, f"package {package} is not installed", extra)


def import_user(module: str, engine: str, library: str, package: str) -> Any:
    """Returns a module of this project that uses a library, after the library itself has been imported.

    Args:
        module: to import.
        engine: who needs it.
        library: import name of the library.
        package: distribution that provides it.

    Raises:
        EngineUnavailable: the library does not import, or lacks what the module asks of it at import. Other
            errors of the module are its own, and pass.
    """
    try:
        found = import_module(library)
    except Exception as error:  # a broken installation may raise anything
        reason = f"package {package} does not import: {type(error).__name__}: {error}"
        raise EngineUnavailable(engine, reason, broken=True) from error
    try:
        return import_module(module)
    except (AttributeError, ImportError) as error:
        if not _is_of(error, library):
            raise
        place = getattr(found, "__file__", None) or "a place unknown"
        reason = f"module {library} at {place} is not that of package {package}, or is broken: {error}"
        raise EngineUnavailable(engine, reason, broken=True) from error


def _is_of(error: AttributeError | ImportError, library: str) -> bool:
    """Returns whether something is missing in the library, and not in the module that uses it."""
    missing_in = error.name if isinstance(error, ImportError) else getattr(error.obj, "__name__", None)
    return isinstance(missing_in, str) and missing_in.split(".")[0] == library
