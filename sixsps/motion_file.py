"""Motion files: what their columns mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array
from sixsps.differentiation import complete
from sixsps.errors import MotionError
from sixsps.motion import Motion, check_quaternion, check_time
from sixsps.tables import Table, read_table, write_table

# What the file calls a group of columns, and what `Motion` calls it.
_GROUPS = {
    "position": ("x", "y", "z"),
    "quaternion": ("qw", "qx", "qy", "qz"),
    "euler": ("alpha", "beta", "gamma"),
    "twist": ("vx", "vy", "vz", "wx", "wy", "wz"),
    "accelerations": ("ax", "ay", "az", "ex", "ey", "ez"),
    "wrench": ("fx", "fy", "fz", "mx", "my", "mz"),
}
_COLUMNS = ("t", *(column for group in _GROUPS.values() for column in group))


def load(path: Path, cutoff: float | None = None) -> Motion:
    """Reads a motion; see `Motion.load`.

    Raises:
        MotionError: naming file, row and column, value and what is allowed.
    """
    try:
        return _motion(read_table(path, _COLUMNS), cutoff)
    except MotionError as error:
        raise MotionError(error.place, error.value, error.allowed, error.source or str(path)) from None


def save(motion: Motion, path: Path) -> None:
    """Writes all columns of `motion`; floats read back exactly.

    Raises:
        OutputError: `path` cannot be written or ends in neither .csv nor .parquet.
    """
    groups = {
        "position": motion.position,
        "quaternion": motion.quaternion,
        "twist": np.hstack([motion.velocity, motion.angular_velocity]),
        "accelerations": np.hstack([motion.acceleration, motion.angular_acceleration]),
        "wrench": np.hstack([motion.force, motion.moment]),
    }
    table = {"t": motion.time}
    for group, values in groups.items():
        table |= dict(zip(_GROUPS[group], values.T, strict=True))
    write_table(table, path)


def _motion(table: Table, cutoff: float | None) -> Motion:
    if "t" not in table.columns:
        raise MotionError("column t", "missing", "times in seconds")
    check_time(table.columns["t"], table.row)
    groups = {group: _group(table.columns, group) for group in _GROUPS}
    if groups["position"] is None:
        raise MotionError("columns x, y, z", "missing", "the platform origin in metres")
    arrays = {"time": table.columns["t"], "position": groups["position"]}
    if groups["quaternion"] is not None:
        check_quaternion(groups["quaternion"], table.row)
    for target, values in (
        (("quaternion",), _orientation(groups["quaternion"], groups["euler"])),
        (("velocity", "angular_velocity"), groups["twist"]),
        (("acceleration", "angular_acceleration"), groups["accelerations"]),
        (("force", "moment"), groups["wrench"]),
    ):
        if values is not None:
            arrays |= dict(zip(target, np.split(values, len(target), axis=1), strict=True))
    return complete(arrays, cutoff, table.path.stem)


def _group(columns: dict[str, Array], group: str) -> Array | None:
    names = _GROUPS[group]
    missing = [name for name in names if name not in columns]
    if len(missing) == len(names):
        return None
    if missing:
        allowed = f"all of {', '.join(names)} or none"
        raise MotionError(f"columns of the {group}", f"{', '.join(missing)} missing", allowed)
    return np.column_stack([columns[name] for name in names])


def _orientation(quaternion: Array | None, euler: Array | None) -> Array | None:
    if euler is None:
        return quaternion
    if quaternion is not None:
        raise MotionError("orientation", "quaternion and Euler angles", "only one of them")
    converted: Array = Rotation.from_euler("XYZ", euler).as_quat(scalar_first=True)
    return converted
