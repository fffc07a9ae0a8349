"""Forward kinematics of rates: twist and acceleration of the platform from those of its legs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arguments import mechanism_of
from sixsps.arrays import Array, frozen
from sixsps.errors import InputError
from sixsps.mechanism import Mechanism
from sixsps.rotation import cross
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# Arrays of so many samples stay in the cache.
_BLOCK = 1024


@dataclass(frozen=True, eq=False)
class PlatformRates:
    """Twist and acceleration of the platform in one pose, or in n, world axes.

    NaN where the pose is singular, or was not found.

    Attributes:
        velocity: (3,) or (n, 3) of O1 [m/s].
        angular_velocity: (3,) or (n, 3) [rad/s].
        acceleration: (3,) or (n, 3) of O1 [m/s^2]; None where length accelerations are not given.
        angular_acceleration: (3,) or (n, 3) [rad/s^2]; None likewise.
    """

    velocity: Array
    angular_velocity: Array
    acceleration: Array | None = None
    angular_acceleration: Array | None = None

    @property
    def arrays(self) -> dict[str, Array | None]:
        """The attributes by name."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


def forward_rates(
    mechanism: Mechanism,
    poses: Any,
    length_rates: ArrayLike,
    length_accelerations: ArrayLike | None = None,
) -> PlatformRates:
    """Returns the motion of the platform that length rates and accelerations make.

    With S' = v + omega x c and the Jacobian's rows [s, c x s] (paper section 4):
    J [v; omega] = l', and J [a; epsilon] = l'' - s.(omega x (omega x c)) - (|S'|^2 - l'^2) / l.

    Args:
        mechanism: its geometry is all that is needed.
        poses: `position` (3,) or (n, 3) [m] and `rotation` (3, 3) or (n, 3, 3), as what `forward_kinematics`
            returns, a pose, a motion or a state has them.
        length_rates: (6,) of a single pose, or (n, 6) [m/s].
        length_accelerations: (6,) or (n, 6) [m/s^2]; none leave the platform's acceleration out.

    Raises:
        InputError: arrays of other shapes, or with entries that are not finite; not a mechanism or poses.
    """
    mechanism, shape = mechanism_of(mechanism), _shape(poses)
    rates = frozen(length_rates, shape, "length_rates", InputError)
    accelerations = None
    if length_accelerations is not None:
        accelerations = frozen(length_accelerations, shape, "length_accelerations", InputError)
    position, rotation = np.asarray(poses.position), np.asarray(poses.rotation)
    if len(shape) > 1:
        return _rates(mechanism, position, rotation, rates, accelerations)
    more = None if accelerations is None else accelerations[None]
    found = _rates(mechanism, position[None], rotation[None], rates[None], more)
    return PlatformRates(**{name: array[0] for name, array in found.arrays.items() if array is not None})


def _shape(poses: Any) -> tuple[int, ...]:
    """Returns the shape of rates in these poses."""
    shape, turn = (np.shape(getattr(poses, name, ())) for name in ("position", "rotation"))
    if shape[-1:] != (3,) or len(shape) > 2 or turn != (*shape, 3):
        allowed = "position and rotation of one pose or of n, as what forward_kinematics returns, or a motion"
        raise InputError("poses", poses, allowed)
    return (*shape[:-1], 6)


def _rates(
    mechanism: Mechanism, position: Array, rotation: Array, rates: Array, accelerations: Array | None
) -> PlatformRates:
    """Returns the motion of the platform in n poses."""
    n = len(position)
    twist, acceleration = np.empty((n, 6)), np.empty((n, 6))
    for start in range(0, n, _BLOCK):
        part = slice(start, start + _BLOCK)
        legs = _Legs(mechanism, position[part], rotation[part])
        twist[part] = legs.solved(rates[part])
        if accelerations is not None:
            acceleration[part] = legs.solved(accelerations[part] - legs.drift(twist[part], rates[part]))
    columns = [twist] if accelerations is None else [twist, acceleration]
    return PlatformRates(*(array[:, half] for array in columns for half in (slice(0, 3), slice(3, 6))))


class _Legs:
    """Jacobians at some poses."""

    def __init__(self, mechanism: Mechanism, position: Array, rotation: Array) -> None:
        self._arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
        vectors = (position[:, None] - mechanism.base_anchors) + self._arms
        self._lengths = np.linalg.norm(vectors, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            self._directions = vectors / self._lengths[..., None]
        jacobian = np.concatenate([self._directions, cross(self._arms, self._directions)], axis=-1)
        size = mechanism.characteristic_length
        self._scale = np.array([1.0] * 3 + [size] * 3)
        self._jacobian = jacobian / self._scale
        directed = (self._lengths > size / SINGULAR_CONDITION).all(axis=1)
        # That of Frobenius is never less than the condition number, and it costs far less.
        self._regular = directed & (np.linalg.cond(self._jacobian, "fro") <= SINGULAR_CONDITION)
        doubtful = directed & ~self._regular
        found = condition_numbers(jacobian[doubtful], self._lengths[doubtful], size)
        self._regular[doubtful] = found <= SINGULAR_CONDITION

    def solved(self, rates: Array) -> Array:
        """Returns the (n, 6) motion of the platform to (n, 6) motions along the legs."""
        found = np.full(rates.shape, np.nan)
        regular = self._regular
        found[regular] = np.linalg.solve(self._jacobian[regular], rates[regular][..., None])[..., 0]
        return found / self._scale

    def drift(self, twist: Array, rates: Array) -> Array:
        """Returns the (n, 6) length accelerations of a platform that moves without acceleration."""
        velocity, omega = twist[:, None, :3], twist[:, None, 3:]
        turning = cross(omega, self._arms)
        moving = velocity + turning
        centripetal = np.sum(self._directions * cross(omega, turning), axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return centripetal + (np.sum(moving * moving, axis=-1) - rates**2) / self._lengths
