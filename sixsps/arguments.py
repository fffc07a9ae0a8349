"""Arguments that many functions take, checked in one place."""

from __future__ import annotations

from numbers import Integral
from typing import Any

from sixsps.errors import InputError
from sixsps.mechanism import Mechanism


def mechanism_of(given: Any) -> Mechanism:
    """Returns a mechanism as it is given.

    Raises:
        InputError: something else, as the name of one.
    """
    if not isinstance(given, Mechanism):
        raise InputError("mechanism", given, "a Mechanism, as Mechanism.load(name or file) gives")
    return given


def whole_number(value: Any, place: str, least: int, most: int | None = None) -> int:
    """Returns a whole number from `least` to `most`, which numpy may have made.

    Raises:
        InputError: names the `place`; not a whole number, or out of range.
    """
    fits = isinstance(value, Integral) and not isinstance(value, bool)
    if not fits or value < least or (most is not None and value > most):
        end = "" if most is None else f" and at most {most}"
        raise InputError(place, value, f"a whole number of at least {least}{end}")
    return int(value)
