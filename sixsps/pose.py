"""A pose of the platform, and what may stand for one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sixsps.arrays import Array, frozen
from sixsps.errors import MotionError

# A matrix further from orthogonal than this was not meant as a rotation.
_ORTHOGONAL = 1e-6


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the platform stands.

    Attributes:
        position: (3,) platform origin O1, world frame [m].
        quaternion: (4,) orientation w, x, y, z, of unit length.
    """

    position: Array
    quaternion: Array

    @cached_property
    def rotation(self) -> Array:
        """(3, 3) platform axes to world axes."""
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix())

    @classmethod
    def of(cls, given: Any) -> Pose:
        """Returns the pose that a caller means.

        Args:
            given: something with `position` (3,) or (1, 3) and `quaternion` or `rotation`, as a pose, a
                state or one sample of a motion; or a pair of position and orientation, the latter a
                quaternion (4,) w, x, y, z or a matrix (3, 3).

        Raises:
            MotionError: not a pose, entries that are not finite, or an orientation that is none.
        """
        if hasattr(given, "position"):
            position = given.position
            turn = given.quaternion if hasattr(given, "quaternion") else getattr(given, "rotation", None)
        elif isinstance(given, tuple | list) and len(given) == 2:
            position, turn = given
        else:
            allowed = "a pose, one sample of a motion, or (position, quaternion or rotation matrix)"
            raise MotionError("pose", given, allowed)
        place, orientation = _first(position), _first(turn)
        return cls(frozen(place, (3,), "position", MotionError), _quaternion(orientation))


def _first(array: Any) -> Any:
    """Returns the one sample of arrays that have one, others as they are."""
    shape = np.shape(array)
    return array[0] if shape in ((1, 3), (1, 4), (1, 3, 3)) else array


def _quaternion(orientation: Any) -> Array:
    if np.shape(orientation) == (3, 3):
        from scipy.spatial.transform import Rotation

        matrix = frozen(orientation, (3, 3), "rotation", MotionError)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > _ORTHOGONAL or np.linalg.det(matrix) < 0:
            raise MotionError("rotation", matrix.tolist(), "an orthogonal matrix of determinant +1")
        turn: Array = Rotation.from_matrix(matrix).as_quat(scalar_first=True)
    else:
        turn = np.array(frozen(orientation, (4,), "quaternion", MotionError))
        if not np.linalg.norm(turn) > 0:
            raise MotionError("quaternion", turn.tolist(), "a length above 0")
    turn = turn / np.linalg.norm(turn)
    turn.setflags(write=False)
    return turn
