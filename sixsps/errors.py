"""One root for every error that this project raises on purpose."""

from __future__ import annotations

_SHOWN_CHARACTERS = 60


def printable(text: str) -> str:
    """Returns `text` as one line, with escapes for what a terminal would not just show."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shown(value: object) -> str:
    """Returns `value` as one short printable line, fit for an error message."""
    text = printable(value if isinstance(value, str) else " ".join(repr(value).split()))
    return text if len(text) <= _SHOWN_CHARACTERS else text[: _SHOWN_CHARACTERS - 3] + "..."


class SixspsError(Exception):
    """Root of all errors of sixsps, urdf and compare."""


class InputError(SixspsError):
    """Input that cannot be used: says where it stands, what it is and what is allowed.

    Args:
        place: key path, column, row or argument at fault.
        value: what was found there.
        allowed: what would have been accepted, with its unit.
        source: file (and line) that holds it; empty when the value came from Python.
    """

    def __init__(self, place: str, value: object, allowed: str, source: str = "") -> None:
        super().__init__(place, value, allowed, source)
        self.place = place
        self.value = value
        self.allowed = allowed
        self.source = source

    def __str__(self) -> str:
        where = f"{self.source}: " if self.source else ""
        return printable(f"{where}{self.place}: {shown(self.value)}; allowed: {self.allowed}")


class MechanismError(InputError):
    """A mechanism that no hexapod can have, or a mechanism file that cannot be read."""


class MotionError(InputError):
    """A motion that cannot be followed, or a motion file that cannot be read."""


class OutputError(InputError):
    """An output path that cannot be written."""


class UnknownNameError(InputError):
    """A name (engine, formulation, motion) that does not exist; `allowed` lists those that do."""


class EngineUnavailable(SixspsError):  # noqa: N818  the name is the condition
    """An engine whose library is missing, of a wrong version or broken on this machine.

    Args:
        name: engine.
        reason: what importing it said.
        extra: extra of this package that installs it; empty when that would not help.
        broken: whether the library is there and does not import.
    """

    def __init__(self, name: str, reason: str, extra: str = "", *, broken: bool = False) -> None:
        super().__init__(name, reason, extra)
        self.name = name
        self.reason = reason
        self.extra = extra
        self.broken = broken

    @property
    def detail(self) -> str:
        """The reason and what to do about it."""
        remedy = f'; install it with: pip install "sixsps[{self.extra}]"' if self.extra else ""
        return f"{self.reason}{remedy}"

    def __str__(self) -> str:
        return f"engine {self.name} is not available: {self.detail}"


class EngineError(SixspsError):
    """An engine that is there but did not give forces."""


class ConvergenceError(SixspsError):
    """An iteration that ended without a solution.

    Args:
        status: why: `unreachable`, `singular` or `limit`.
        message: what was sought, how far the iteration came, and what to do.
    """

    def __init__(self, status: str, message: str) -> None:
        super().__init__(status, message)
        self.status = status
        self.message = message

    def __str__(self) -> str:
        return printable(self.message)
