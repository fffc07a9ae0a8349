"""What stands for inertia that a mechanism of geometry alone does not have."""

from __future__ import annotations

from typing import Any, NoReturn

from sixsps.errors import MechanismError

NEEDED = "gravity, platform.mass, platform.inertia, legs.lower and legs.upper"


class Missing:
    """Stands where a value is not given; whatever reads it is told so.

    Args:
        place: key path of what is missing.
    """

    def __init__(self, place: str) -> None:
        self.place = place

    def refuse(self, entry: str = "") -> NoReturn:
        """Raises MechanismError naming what is missing, or its entry."""
        place = f"{self.place}.{entry}" if entry else self.place
        allowed = f"a mechanism with {NEEDED}; this one is geometry alone, it has kinematics and no dynamics"
        raise MechanismError(place, "missing", allowed)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # what Python itself, numpy or pickle asks for
            raise AttributeError(name)
        self.refuse(name)

    def _refused(self, *_arguments: Any, **_options: Any) -> Any:
        self.refuse()

    # What is done with numbers, by Python and by numpy.
    __array__ = __float__ = __len__ = __iter__ = __getitem__ = __format__ = _refused
    __neg__ = __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _refused
    __truediv__ = __rtruediv__ = __matmul__ = __rmatmul__ = _refused

    def __bool__(self) -> bool:
        return False

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Missing) and other.place == self.place

    def __hash__(self) -> int:
        return hash(self.place)

    def __reduce__(self) -> tuple[type[Missing], tuple[str]]:
        return Missing, (self.place,)

    def __repr__(self) -> str:
        return "missing"


# Typed as what they stand for, so that no reader of a mechanism has to ask.
GRAVITY: Any = Missing("gravity")
PLATFORM: Any = Missing("platform")
LOWER: Any = Missing("legs.lower")
UPPER: Any = Missing("legs.upper")
