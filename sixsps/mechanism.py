"""The mechanism: geometry and inertia of a hexapod, frozen and validated."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixsps.architecture import check_architecture
from sixsps.arrays import Array, frozen
from sixsps.bodies import Leg, Links, Platform
from sixsps.errors import MechanismError
from sixsps.limits import Limits
from sixsps.missing import GRAVITY, NEEDED, PLATFORM, Missing

_LONGEST_NAME = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class Mechanism:
    """A 6-SPS hexapod (Stewart-Gough platform), frozen.

    Without gravity, platform and the links of the legs it is geometry alone: it has kinematics, and what
    asks for its dynamics raises MechanismError.

    Attributes:
        name: any printable text; never used as a path or in a template.
        gravity: (3,) world axes [m/s^2].
        base_anchors: (6, 3) base joint centres A_i, world frame [m].
        platform_anchors: (6, 3) platform joint centres b_i, platform frame [m].
        platform: mass properties of the platform.
        legs: the six legs.
        source: where the values come from.
        assumed: key path -> why, for every value that the source does not give.
        limits: what actuators and joints allow.

    Raises:
        MechanismError: a value is out of range, every pose is singular, or some of the inertia is missing.
    """

    name: str
    gravity: Array = GRAVITY
    base_anchors: Array
    platform_anchors: Array
    platform: Platform = PLATFORM
    legs: tuple[Leg, ...] = (Leg(),) * 6
    source: str = ""
    assumed: Mapping[str, str] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        _check_name(self.name)
        for attribute, shape, place in (
            ("gravity", (3,), "gravity"),
            ("base_anchors", (6, 3), "base.anchors"),
            ("platform_anchors", (6, 3), "platform.anchors"),
        ):
            if not isinstance(getattr(self, attribute), Missing):
                value = frozen(getattr(self, attribute), shape, place, MechanismError)
                object.__setattr__(self, attribute, value)
        if not isinstance(self.limits, Limits):
            raise MechanismError("limits", self.limits, "sixsps.Limits")
        object.__setattr__(self, "legs", tuple(self.legs))
        object.__setattr__(self, "assumed", MappingProxyType(dict(self.assumed)))
        if len(self.legs) != 6:
            raise MechanismError("legs", f"{len(self.legs)} legs", "six legs")
        self._check_inertia_is_whole()
        check_architecture(self.base_anchors, self.platform_anchors, self.characteristic_length)

    def _check_inertia_is_whole(self) -> None:
        """Raises MechanismError where some of the inertia is given: the rest was forgotten."""
        missing = [name for name in ("gravity", "platform") if isinstance(getattr(self, name), Missing)]
        missing += [f"legs.{k}.lower" for k, leg in enumerate(self.legs) if not leg.has_links]
        bare = isinstance(self.platform, Missing) and not any(leg.has_links for leg in self.legs)
        if missing and not bare:
            raise MechanismError(missing[0], "missing", f"{NEEDED}, or nothing of them but gravity")

    @classmethod
    def geometry(
        cls,
        name: str,
        base_anchors: ArrayLike,
        platform_anchors: ArrayLike,
        length_limits: ArrayLike | None = None,
        limits: Limits | None = None,
        source: str = "",
    ) -> Mechanism:
        """Returns a mechanism of geometry alone: it has kinematics and no dynamics.

        Args:
            name: any printable text.
            base_anchors: (6, 3) base joint centres A_i, world frame [m].
            platform_anchors: (6, 3) platform joint centres b_i, platform frame [m].
            length_limits: (2,) or (6, 2) shortest and longest leg lengths [m]; none by default.
            limits: what actuators and joints allow; nothing is forbidden by default.
            source: where the values come from.

        Raises:
            MechanismError: a value is out of range, or every pose is singular.
        """
        legs: Iterable[Leg] = (Leg(),) * 6
        if length_limits is not None:
            pairs = np.asarray(length_limits)
            if pairs.dtype.kind not in "iuf" or pairs.shape not in ((2,), (6, 2)):
                raise MechanismError("length_limits", length_limits, "numbers of shape (2) or (6, 2)")
            legs = (Leg(length_limits=tuple(pair)) for pair in np.broadcast_to(pairs, (6, 2)).tolist())
        return cls(
            name=name,
            base_anchors=np.asarray(base_anchors),
            platform_anchors=np.asarray(platform_anchors),
            legs=tuple(legs),
            limits=limits or Limits(),
            source=source,
        )

    @property
    def has_inertia(self) -> bool:
        """Whether there is more than geometry: gravity and the inertia of all bodies."""
        return not isinstance(self.platform, Missing)

    def check_inertia(self) -> None:
        """Raises MechanismError, saying what is missing, for a mechanism of geometry alone."""
        if isinstance(self.platform, Missing):
            self.platform.refuse("mass")

    @classmethod
    def load(cls, name_or_path: str | Path) -> Mechanism:
        """Reads a bundled mechanism by name, or a YAML file by path.

        Args:
            name_or_path: one of `bundled_mechanisms()` or the path of a file.

        Raises:
            MechanismError: there is no such file, or it does not describe a hexapod.
        """
        from sixsps.mechanism_file import load

        return load(name_or_path)

    def save(self, path: str | Path) -> None:
        """Writes the YAML file that `load` reads back to an equal mechanism.

        Raises:
            OutputError: `path` cannot be written.
        """
        from sixsps.mechanism_file import save

        save(self, Path(path))

    @cached_property
    def lower(self) -> Links:
        """The six lower links as arrays."""
        return Links.stack([leg.lower for leg in self.legs])

    @cached_property
    def upper(self) -> Links:
        """The six upper links as arrays."""
        return Links.stack([leg.upper for leg in self.legs])

    @cached_property
    def length_limits(self) -> Array:
        """(6, 2) shortest and longest leg lengths [m]; 0 and infinite where none are given."""
        limits = np.array([leg.length_limits for leg in self.legs])
        limits.setflags(write=False)
        return limits

    @cached_property
    def characteristic_length(self) -> float:
        """Root mean square distance of the platform anchors from O1 [m].

        Divides the moment rows of J before its condition number is taken, so that the number does
        not depend on the unit of length.
        """
        return math.sqrt(float(np.mean(np.sum(self.platform_anchors**2, axis=1))))

    def to_mapping(self) -> dict[str, Any]:
        """Returns the content of the mechanism's YAML file."""
        mapping: dict[str, Any] = {"name": self.name}
        if self.source:
            mapping["source"] = self.source
        if self.assumed:
            mapping["assumed"] = dict(self.assumed)
        if not isinstance(self.gravity, Missing):
            mapping["gravity"] = self.gravity.tolist()
        mapping["base"] = {"anchors": self.base_anchors.tolist()}
        mapping["platform"] = {"anchors": self.platform_anchors.tolist()}
        if self.has_inertia:
            mapping["platform"] |= self.platform.to_mapping()
        legs = [leg.to_mapping() for leg in self.legs]
        if any(legs):
            mapping["legs"] = legs[0] if all(leg == legs[0] for leg in legs) else legs
        if self.limits:
            mapping["limits"] = self.limits.to_mapping()
        return mapping

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the mechanism's numbers, whatever its name and the layout of its file."""
        mapping = self.to_mapping()
        keys = ("gravity", "base", "platform", "legs", "limits")
        numbers = {key: mapping[key] for key in keys if key in mapping}
        text = json.dumps(numbers, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def __reduce__(self) -> tuple[Callable[..., Mechanism], tuple[dict[str, Any]]]:
        """Pickles such that what comes back is frozen again."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return _rebuilt, (values | {"assumed": dict(self.assumed)},)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mechanism) and self.to_mapping() == other.to_mapping()

    def __hash__(self) -> int:
        return hash(self.sha256)


def _rebuilt(values: dict[str, Any]) -> Mechanism:
    return Mechanism(**values)


def _check_name(name: str) -> None:
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise MechanismError("name", name, "printable text")
    if len(name) > _LONGEST_NAME:
        raise MechanismError("name", name, f"at most {_LONGEST_NAME} characters")
