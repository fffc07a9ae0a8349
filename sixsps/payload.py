"""A rigid payload on the platform: one body with the platform, and where external wrenches then act."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arrays import Array, frozen
from sixsps.bodies import Platform, rigid_inertia
from sixsps.errors import MechanismError, MotionError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


@dataclass(frozen=True, eq=False)
class Payload:
    """A rigid body that is fixed to the platform, in the platform frame O1-X1Y1Z1.

    Attributes:
        mass: [kg], > 0.
        com: (3,) centre of mass from O1 [m].
        inertia: (3, 3) about the payload's own centre of mass, platform axes [kg m^2]; zeros for a
            point mass.
        name: what to call it in reports.

    Raises:
        MechanismError: a value is out of range, or no rigid body has that inertia.
    """

    mass: float
    com: Array
    inertia: Array
    name: str = "payload"

    def __post_init__(self) -> None:
        mass = float(frozen(self.mass, (), "mass", MechanismError))
        if not mass > 0:
            raise MechanismError("mass", mass, "finite and > 0 [kg]")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "com", frozen(self.com, (3,), "com", MechanismError))
        object.__setattr__(self, "inertia", rigid_inertia(self.inertia, "inertia", point=True))

    def __reduce__(self) -> tuple[Callable[..., Payload], tuple[Any, ...]]:
        """Pickles such that what comes back is frozen again."""
        return Payload, self._values()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Payload) and self._plain() == other._plain()

    def __hash__(self) -> int:
        return hash(self._plain())

    def _values(self) -> tuple[float, Array, Array, str]:
        return self.mass, self.com, self.inertia, self.name

    def _plain(self) -> tuple[Any, ...]:
        return self.mass, tuple(self.com.tolist()), tuple(self.inertia.ravel().tolist()), self.name

    @classmethod
    def load(cls, path: str | Path) -> Payload:
        """Reads a YAML file with the keys mass, com and inertia of a mechanism file's platform.

        Args:
            path: of the file; the payload is called after it.

        Raises:
            MechanismError: naming file and line, key, value and what is allowed.
        """
        from sixsps.payload_file import load

        return load(Path(path))


def attached(mechanism: Mechanism, payload: Payload) -> Mechanism:
    """Returns the mechanism whose platform carries the payload, both one rigid body.

    External forces of a motion act at the platform's centre of mass, which the payload moves:
    `shifted_wrench` restates them.

    Args:
        mechanism: with inertia.
        payload: in the platform frame.

    Raises:
        MechanismError: the mechanism is geometry alone, `payload` is no payload, or both together are
            beyond any number of a hexapod.
    """
    if not isinstance(payload, Payload):
        raise MechanismError("payload", payload, "a sixsps.Payload")
    mechanism.check_inertia()
    platform = mechanism.platform
    mass = platform.mass + payload.mass
    arm = payload.com - platform.com
    # Steiner for both about the common centre of mass: m1 |d1|^2 + m2 |d2|^2 = m1 m2 / m |d2 - d1|^2.
    reduced = platform.mass * (payload.mass / mass)
    steiner = reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    com = platform.com + payload.mass / mass * arm
    whole = Platform(mass, com, platform.inertia + payload.inertia + steiner)
    return replace(mechanism, platform=whole)


def shifted_wrench(motion: Motion, before: ArrayLike, after: ArrayLike) -> Motion:
    """Returns the motion with the same external wrench, its force stated at another point.

    Args:
        motion: n samples, its moment about the point `before`.
        before: (3,) point of the platform at which the force acts, platform frame [m].
        after: (3,) point at which the force of the result acts, platform frame [m].

    Raises:
        MotionError: a point is not three finite numbers.
    """
    arm = frozen(before, (3,), "before", MotionError) - frozen(after, (3,), "after", MotionError)
    moment = motion.moment + np.cross(motion.rotation @ arm, motion.force)
    return replace(motion, moment=moment)
