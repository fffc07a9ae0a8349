"""What a machine's actuators and joints allow, beside the strokes of its legs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from sixsps.arrays import Array, frozen
from sixsps.errors import MechanismError


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of a machine, each None where there is none. They never change a number, they are checked.

    Where a value a leg is asked for, one value may be given for all six.

    Attributes:
        force: (6, 2) least and largest leg force [N]; pull is negative.
        rate: (6,) largest magnitude of the length rate [m/s].
        base_cone: (6,) largest angle between the leg direction s_i, from A_i to B_i, and `base_axes` [rad].
        base_axes: (6, 3) axes of the base joints, world frame, of any length; by default the leg
            directions at the home pose.
        platform_cone: (6,) largest angle between s_i and `platform_axes` as the platform carries them [rad].
        platform_axes: (6, 3) axes of the platform joints, platform frame, of any length, with s_i and not
            against it; by default the leg directions at the home pose.
        clearance: least distance between the axes, from A_i to B_i, of two legs that share no joint [m].

    Raises:
        MechanismError: a value is out of range.
    """

    force: Array | None = None
    rate: Array | None = None
    base_cone: Array | None = None
    base_axes: Array | None = None
    platform_cone: Array | None = None
    platform_axes: Array | None = None
    clearance: float | None = None

    def __post_init__(self) -> None:
        self._set("force", _six(self.force, (2,), "limits.force"))
        self._set("rate", _six(self.rate, (), "limits.rate"))
        if self.force is not None and (self.force[:, 0] >= self.force[:, 1]).any():
            raise MechanismError("limits.force", self.force.tolist(), "least < largest [N]")
        if self.rate is not None and (self.rate <= 0).any():
            raise MechanismError("limits.rate", self.rate.tolist(), "> 0 [m/s]")
        for joint in ("base", "platform"):
            self._set_joint(joint)
        if self.clearance is not None:
            clearance = float(frozen(self.clearance, (), "limits.clearance", MechanismError))
            if clearance <= 0:
                raise MechanismError("limits.clearance", clearance, "> 0 [m]")
            self._set("clearance", clearance)

    def _set_joint(self, joint: str) -> None:
        place, axes_place = f"limits.{joint}_cone", f"limits.{joint}_axes"
        cone, axes = _six(getattr(self, f"{joint}_cone"), (), place), getattr(self, f"{joint}_axes")
        if cone is not None and ((cone <= 0) | (cone > math.pi)).any():
            raise MechanismError(place, cone.tolist(), "above 0 and at most pi [rad], from the axis")
        if axes is not None:
            axes = frozen(axes, (6, 3), axes_place, MechanismError)
            if cone is None:
                raise MechanismError(axes_place, "given alone", f"with {joint}_cone")
            if not np.linalg.norm(axes, axis=1).all():
                raise MechanismError(axes_place, axes.tolist(), "axes of a length above 0")
        self._set(f"{joint}_cone", cone)
        self._set(f"{joint}_axes", axes)

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def __bool__(self) -> bool:
        return any(getattr(self, field.name) is not None for field in fields(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Limits) and self.to_mapping() == other.to_mapping()

    def __hash__(self) -> int:
        return hash(repr(self.to_mapping()))

    def __reduce__(self) -> tuple[type[Limits], tuple[Any, ...]]:
        """Pickles such that what comes back is frozen again."""
        return Limits, tuple(getattr(self, field.name) for field in fields(self))

    def to_mapping(self) -> dict[str, Any]:
        """Returns the content of the mechanism file's key `limits`."""
        return {
            field.name: _shared(getattr(self, field.name))
            for field in fields(self)
            if getattr(self, field.name) is not None
        }

    @classmethod
    def of(cls, mapping: Mapping[str, Any]) -> Limits:
        """Returns the limits that `to_mapping` gave."""
        return cls(**mapping)


def _six(value: Any, shape: tuple[int, ...], place: str) -> Array | None:
    """Returns six values of a shape, out of six or of one for all."""
    if value is None:
        return None
    if np.ndim(value) == len(shape):
        one = frozen(value, shape, place, MechanismError)
        return frozen(np.broadcast_to(one, (6, *shape)), (6, *shape), place, MechanismError)
    return frozen(value, (6, *shape), place, MechanismError)


def _shared(value: Any) -> Any:
    """Returns six equal values as one."""
    if isinstance(value, float):
        return value
    same = len(value) == 6 and all(np.array_equal(one, value[0]) for one in value) and value.shape != (6, 3)
    return (value[0] if same else value).tolist()
