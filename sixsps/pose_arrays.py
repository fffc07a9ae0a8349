"""Positions and rotation matrices of whatever stands for poses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arrays import Array, frozen
from sixsps.errors import MotionError
from sixsps.motion import Motion
from sixsps.pose import Pose

# A matrix further from orthogonal than this was not meant as a rotation.
_ORTHOGONAL = 1e-6


def pose_arrays(poses: Any) -> tuple[Array, Array]:
    """Returns positions (n, 3) [m] and rotation matrices (n, 3, 3) of what stands for n poses.

    Args:
        poses: something with `position` and `quaternion` or `rotation` of n poses, or of one, as a motion,
            a state, or what `forward_kinematics` and `assembly_modes` return; one pose, or a list of them;
            or a pair of positions (n, 3) [m] and orientations, as `checked_poses` takes it.

    Raises:
        MotionError: not poses.
    """
    if isinstance(poses, Motion):
        return poses.position, poses.rotation
    if isinstance(poses, Pose):
        return poses.position[None], poses.rotation[None]
    if _rank(getattr(poses, "position", None)) == 2:
        turn = poses.quaternion if hasattr(poses, "quaternion") else getattr(poses, "rotation", ())
        return checked_poses(poses.position, turn)
    if isinstance(poses, tuple | list) and poses:
        if len(poses) == 2 and _rank(poses[0]) == 2:
            return checked_poses(*poses)
        # One pair of position and orientation, or poses one by one.
        each = [Pose.of(pose) for pose in ([poses] if _rank(poses[0]) == 1 else poses)]
        return np.array([pose.position for pose in each]), np.array([pose.rotation for pose in each])
    return pose_arrays(Pose.of(poses))


def checked_poses(positions: ArrayLike, orientations: ArrayLike) -> tuple[Array, Array]:
    """Returns positions (n, 3) [m] and rotation matrices (n, 3, 3).

    Args:
        positions: (n, 3) [m].
        orientations: (n, 3, 3) rotation matrices, or quaternions (n, 4) w, x, y, z of any length above 0.

    Raises:
        MotionError: other shapes, entries that are not finite, or orientations that are none.
    """
    position = frozen(positions, (None, 3), "position", MotionError)
    if _rank(orientations) == 2:
        return position, _turned(orientations, len(position))
    rotation = frozen(orientations, (len(position), 3, 3), "rotation", MotionError)
    off = np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max(axis=(1, 2))
    wrong = (off > _ORTHOGONAL) | (np.linalg.det(rotation) < 0)
    if wrong.any():
        index = int(np.argmax(wrong))
        allowed = "orthogonal matrices of determinant +1"
        raise MotionError(f"rotation, index {index}", rotation[index].tolist(), allowed)
    return position, rotation


def _turned(quaternions: ArrayLike, n: int) -> Array:
    from scipy.spatial.transform import Rotation

    quaternion = frozen(quaternions, (n, 4), "quaternion", MotionError)
    # No product of two of them overflows or vanishes.
    largest = np.abs(quaternion).max(axis=1, initial=0.0)
    if not (largest > 0).all():
        index = int(np.argmin(largest > 0))
        raise MotionError(f"quaternion, index {index}", quaternion[index].tolist(), "a length above 0")
    scaled = quaternion / largest[:, None]
    return np.asarray(Rotation.from_quat(scaled, scalar_first=True).as_matrix()).reshape(n, 3, 3)


def _rank(value: Any) -> int:
    """Returns the number of dimensions of numbers, -1 of what is no array of such."""
    try:
        array = np.asarray(value)
    except ValueError:  # a position and an orientation, which differ in shape
        return -1
    return array.ndim if array.dtype.kind in "iuf" else -1
