"""Schemas of YAML files: what mechanism and payload files share, and their errors in one line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sixsps.arrays import Array
from sixsps.errors import MechanismError
from sixsps.yaml_reader import Document

Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]

_ALLOWED = {
    "missing": "this key is required",
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text (in quotes where it looks like a number)",
    "list_type": "a list",
    "model_type": "a mapping of keys",
    "dict_type": "a mapping of keys",
}


class Section(BaseModel):
    """A mapping of known keys, each of exactly its type."""

    model_config = ConfigDict(extra="forbid", strict=True)


class Inertia(Section):
    """Entries of a symmetric matrix [kg m^2]."""

    xx: Number
    yy: Number
    zz: Number
    xy: Number = 0.0
    xz: Number = 0.0
    yz: Number = 0.0

    @property
    def matrix(self) -> Array:
        """(3, 3)."""
        return np.array(
            [[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]]
        )


def explained(
    error: ValidationError,
    document: Document,
    section: Callable[[Sequence[str]], type[BaseModel]],
    keys: Callable[[Sequence[int | str]], Sequence[int | str]] = tuple,
) -> MechanismError:
    """Returns what a schema found first, with file and line, key, value and what is allowed.

    Args:
        error: of the validation.
        document: that was validated.
        section: key path -> schema of the section there.
        keys: pydantic's path -> the keys of the file in it.
    """
    detail = error.errors(include_url=False)[0]
    path = tuple(str(part) for part in keys(detail["loc"]))
    kind, value = detail["type"], detail["input"]
    allowed = _ALLOWED.get(kind, detail["msg"])
    if kind == "missing":
        value = "missing"
    elif isinstance(value, str):
        value = repr(value)  # with the quotes that tell text from a number
    if kind == "extra_forbidden":
        allowed = "the keys " + ", ".join(section(path[:-1]).model_fields)
    elif kind in ("too_short", "too_long"):
        context: dict[str, Any] = detail["ctx"]
        value = f"{context['actual_length']} entries"
        allowed = f"{context.get('min_length', context.get('max_length'))} entries"
    return MechanismError(".".join(path) or "the file", value, allowed, document.locate(path))


def located(error: MechanismError, document: Document) -> MechanismError:
    """Returns an error of a value with the file and line of its key."""
    path = tuple(error.place.replace("[", ".").replace("]", "").replace(", ", ".").split("."))
    return MechanismError(error.place, error.value, error.allowed, document.locate(path))
