"""The motion: sampled platform pose, twist, acceleration and external wrench, frozen."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixsps.arrays import Array, frozen
from sixsps.errors import MotionError

QUATERNION_TOLERANCE = 1e-3
_VECTORS = (
    "position",
    "velocity",
    "angular_velocity",
    "acceleration",
    "angular_acceleration",
    "force",
    "moment",
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """A sampled motion of the platform, frozen. World axes throughout; one row a sample.

    Attributes:
        time: (n,) strictly increasing [s].
        position: (n, 3) platform origin O1 [m].
        quaternion: (n, 4) orientation as stored, order w, x, y, z; identity by default.
        velocity: (n, 3) of O1 [m/s].
        angular_velocity: (n, 3) [rad/s].
        acceleration: (n, 3) of O1 [m/s^2].
        angular_acceleration: (n, 3) [rad/s^2].
        force: (n, 3) external force on the platform's centre of mass [N]; 0 by default.
        moment: (n, 3) external moment on the platform [N m]; 0 by default.
        name: what to call it in reports.
        estimated: quantity -> how it was estimated, for everything that was not given.
        changes: what was done to the motion since it was given.

    Raises:
        MotionError: shapes differ, an entry is not finite, times do not increase, or a quaternion
            is off unit length by more than 1e-3.
    """

    time: Array
    position: Array
    quaternion: Array = None  # type: ignore[assignment]  # an array once constructed
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array
    force: Array = None  # type: ignore[assignment]
    moment: Array = None  # type: ignore[assignment]
    name: str = "motion"
    estimated: Mapping[str, str] = field(default_factory=dict)
    changes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time = frozen(self.time, (None,), "time", MotionError)
        object.__setattr__(self, "time", time)
        n = len(time)
        check_time(time, "index {}".format)
        for name in _VECTORS:
            given = getattr(self, name)
            value = np.zeros((n, 3)) if given is None and name in ("force", "moment") else given
            object.__setattr__(self, name, frozen(value, (n, 3), name, MotionError))
        given = self.quaternion
        quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)) if given is None else given
        quaternion = frozen(quaternion, (n, 4), "quaternion", MotionError)
        check_quaternion(quaternion, "index {}".format)
        object.__setattr__(self, "quaternion", quaternion)
        object.__setattr__(self, "estimated", MappingProxyType(dict(self.estimated)))

    @classmethod
    def load(cls, path: str | Path, *, cutoff: float | None = None) -> Motion:
        """Reads a CSV or Parquet file; derivatives that it lacks are estimated from its poses.

        Args:
            path: file with the columns of the motion format, in any order.
            cutoff: corner frequency of the smoothing [Hz]; chosen from the data by default.

        Raises:
            MotionError: naming file, row and column, value and what is allowed.
        """
        from sixsps.motion_file import load

        return load(Path(path), cutoff)

    @classmethod
    def from_poses(
        cls,
        time: ArrayLike,
        position: ArrayLike,
        quaternion: ArrayLike | None = None,
        *,
        force: ArrayLike | None = None,
        moment: ArrayLike | None = None,
        cutoff: float | None = None,
        name: str = "motion",
    ) -> Motion:
        """Returns the motion through recorded poses, its derivatives from a smoothing spline.

        Args:
            time: (n,) strictly increasing [s], n >= 6.
            position: (n, 3) [m].
            quaternion: (n, 4) w, x, y, z; identity by default.
            force: (n, 3) external force [N]; 0 by default.
            moment: (n, 3) external moment [N m]; 0 by default.
            cutoff: corner frequency of the smoothing [Hz]; chosen from the data by default.
            name: what to call it in reports.

        Raises:
            MotionError: as the constructor, or too few samples to differentiate.
        """
        from sixsps.differentiation import complete

        given = {"quaternion": (quaternion, 4), "force": (force, 3), "moment": (moment, 3)}
        arrays = {"time": frozen(time, (None,), "time", MotionError)}
        n = len(arrays["time"])
        arrays["position"] = frozen(position, (n, 3), "position", MotionError)
        for key, (value, width) in given.items():
            if value is not None:
                arrays[key] = frozen(value, (n, width), key, MotionError)
        return complete(arrays, cutoff, name)

    def save(self, path: str | Path) -> None:
        """Writes the motion with all its columns, exactly, as CSV or Parquet by the file's suffix.

        Raises:
            OutputError: `path` cannot be written, or has another suffix.
        """
        from sixsps.motion_file import save

        save(self, Path(path))

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, samples: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Motion:
        columns = {name: getattr(self, name)[samples] for name in (*_VECTORS, "time", "quaternion")}
        words = {"name": self.name, "estimated": self.estimated, "changes": self.changes}
        return _rebuilt(columns | words, self.rotation[samples] if "rotation" in self.__dict__ else None)

    def __reduce__(self) -> tuple[Callable[..., Motion], tuple[Any, ...]]:
        """Pickles such that what comes back is frozen again."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return _rebuilt, (values | {"estimated": dict(self.estimated)}, self.__dict__.get("rotation"))

    @cached_property
    def rotation(self) -> Array:
        """(n, 3, 3) orientation as used: platform axes to world axes."""
        # Imported here: it takes longer than most motions, and engines get the matrices ready made.
        from scipy.spatial.transform import Rotation

        if len(self) == 0:
            return np.empty((0, 3, 3))
        matrices: Array = Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix()
        matrices.setflags(write=False)
        return matrices

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of all samples as little-endian float64, whatever file they came from."""
        digest = hashlib.sha256()
        for name in ("time", "quaternion", *_VECTORS):
            digest.update(np.ascontiguousarray(getattr(self, name), dtype="<f8").tobytes())
        return digest.hexdigest()


def _rebuilt(values: dict[str, Any], rotation: Array | None) -> Motion:
    """Returns a motion, with the matrices that another one has already worked out."""
    motion = Motion(**values)
    if rotation is not None:
        rotation.setflags(write=False)
        motion.__dict__["rotation"] = rotation
    return motion


def check_time(time: Array, row: Callable[[int], str]) -> None:
    """Raises MotionError, with the place that `row` gives an index, unless times strictly increase."""
    backwards = np.diff(time) <= 0
    if backwards.any():
        index = int(np.argmax(backwards)) + 1
        found = f"{float(time[index])!r} after {float(time[index - 1])!r}"
        raise MotionError(f"t, {row(index)}", found, "times that strictly increase [s]")


def check_quaternion(quaternion: Array, row: Callable[[int], str]) -> None:
    """Raises MotionError, with the place that `row` gives an index, unless all have unit length."""
    norms = np.linalg.norm(quaternion, axis=1)
    wrong = np.abs(norms - 1) > QUATERNION_TOLERANCE
    if wrong.any():
        index = int(np.argmax(wrong))
        allowed = f"length 1 within {QUATERNION_TOLERANCE}"
        raise MotionError(f"quaternion, {row(index)}", f"length {norms[index]:.6g}", allowed)
