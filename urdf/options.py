"""What the descriptions can be asked for; imports nothing heavy, for command lines need it."""

from __future__ import annotations

from enum import StrEnum
from typing import TypeVar

from sixsps.errors import InputError

_Option = TypeVar("_Option", bound=StrEnum)


class Loops(StrEnum):
    """What closes the loops in SDF: its own ball joints, or the ball constraints that Drake adds to SDF."""

    joints = "joints"
    drake = "drake"


def option(kind: type[_Option], place: str, value: str) -> _Option:
    """Returns the member of `kind` that `value` is or names.

    Args:
        kind: all that is allowed.
        place: name of the argument, for the error.
        value: a member, or its text.

    Raises:
        InputError: `value` is none of them.
    """
    try:
        return kind(value)
    except ValueError:
        raise InputError(place, value, " or ".join(kind)) from None
