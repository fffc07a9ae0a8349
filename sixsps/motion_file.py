"""Motion files: what their columns mean."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array
from sixsps.differentiation import complete
from sixsps.errors import MotionError
from sixsps.motion import Motion, check_quaternion, check_time
from sixsps.tables import Table, read_table, write_table

# Columns that only come together.
_GROUPS = {
    "position": ("x", "y", "z"),
    "quaternion": ("qw", "qx", "qy", "qz"),
    "euler": ("alpha", "beta", "gamma"),
    "twist": ("vx", "vy", "vz", "wx", "wy", "wz"),
    "accelerations": ("ax", "ay", "az", "ex", "ey", "ez"),
    "wrench": ("fx", "fy", "fz", "mx", "my", "mz"),
}
# What `Motion` calls columns of a file.
_FIELDS = {
    "position": ("x", "y", "z"),
    "quaternion": ("qw", "qx", "qy", "qz"),
    "velocity": ("vx", "vy", "vz"),
    "angular_velocity": ("wx", "wy", "wz"),
    "acceleration": ("ax", "ay", "az"),
    "angular_acceleration": ("ex", "ey", "ez"),
    "force": ("fx", "fy", "fz"),
    "moment": ("mx", "my", "mz"),
}
COLUMNS = ("t", *(column for group in _GROUPS.values() for column in group))
"""All columns that a motion file may have."""


def load(path: Path, cutoff: float | None = None) -> Motion:
    """Reads a motion; see `Motion.load`.

    Raises:
        MotionError: naming file, row and column, value and what is allowed.
    """
    with source_in_errors(path):
        table = read_table(path, COLUMNS)
        check_columns(table.columns)
        return motion_of(table, cutoff)


@contextmanager
def source_in_errors(path: Path) -> Iterator[None]:
    """Names the file in a MotionError that does not."""
    try:
        yield
    except MotionError as error:
        raise MotionError(error.place, error.value, error.allowed, error.source or str(path)) from None


def save(motion: Motion, path: Path) -> None:
    """Writes all columns of `motion`; floats read back exactly.

    Raises:
        OutputError: `path` cannot be written or ends in neither .csv nor .parquet.
    """
    table = {"t": motion.time}
    for field, columns in _FIELDS.items():
        table |= dict(zip(columns, getattr(motion, field).T, strict=True))
    write_table(table, path)


def check_columns(names: Collection[str]) -> None:
    """Raises MotionError unless columns of these names are a motion, derivatives or not."""
    if "t" not in names:
        raise MotionError("column t", "missing", "times in seconds")
    for group, columns in _GROUPS.items():
        missing = [name for name in columns if name not in names]
        if 0 < len(missing) < len(columns):
            allowed = f"all of {', '.join(columns)} or none"
            raise MotionError(f"columns of the {group}", f"{', '.join(missing)} missing", allowed)
    if "x" not in names:
        raise MotionError("columns x, y, z", "missing", "the platform origin in metres")
    if "qw" in names and "alpha" in names:
        raise MotionError("orientation", "quaternion and Euler angles", "only one of them")


def has_derivatives(names: Collection[str]) -> bool:
    """Returns whether columns of these names, of a motion, leave no derivative to be estimated."""
    return "vx" in names and "ax" in names


def motion_of(table: Table, cutoff: float | None = None) -> Motion:
    """Returns the motion in a table, or in a block of one, whose columns have been checked.

    Args:
        table: columns of a motion.
        cutoff: corner frequency of the smoothing [Hz]; see `Motion.load`.

    Raises:
        MotionError: as `Motion`, naming the row, and as `differentiate`.
    """
    columns = table.columns
    arrays = {"time": columns["t"]}
    for field, names in _FIELDS.items():
        if names[0] in columns:
            arrays[field] = np.column_stack([columns[name] for name in names])
    if "alpha" in columns:
        arrays["quaternion"] = _quaternion(np.column_stack([columns[name] for name in _GROUPS["euler"]]))
    try:
        return complete(arrays, cutoff, table.path.stem)
    except MotionError:  # the same again, for the row of the file instead of an index
        check_time(arrays["time"], table.row)
        if "quaternion" in arrays:
            check_quaternion(arrays["quaternion"], table.row)
        raise


def _quaternion(euler: Array) -> Array:
    converted: Array = Rotation.from_euler("XYZ", euler).as_quat(scalar_first=True)
    return converted
