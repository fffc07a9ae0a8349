"""Motion and result tables: CSV and Parquet in and out."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array
from sixsps.differentiation import complete
from sixsps.errors import MotionError, OutputError
from sixsps.files import check_readable, write_atomically
from sixsps.motion import Motion, check_quaternion, check_time

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
        return _motion(read_table(path, _COLUMNS), cutoff, path.stem)
    except MotionError as error:
        raise MotionError(error.place, error.value, error.allowed, error.source or str(path)) from None


def save(motion: Motion, path: Path) -> None:
    """Writes all columns of `motion`; floats read back exactly.

    Raises:
        OutputError: `path` cannot be written or ends in neither .csv nor .parquet.
    """
    twist = np.hstack([motion.velocity, motion.angular_velocity])
    accelerations = np.hstack([motion.acceleration, motion.angular_acceleration])
    wrench = np.hstack([motion.force, motion.moment])
    groups = {
        "position": motion.position,
        "quaternion": motion.quaternion,
        "twist": twist,
        "accelerations": accelerations,
        "wrench": wrench,
    }
    table = {"t": motion.time}
    for group, values in groups.items():
        table |= dict(zip(_GROUPS[group], values.T, strict=True))
    write_table(table, path)


def write_table(columns: Mapping[str, Array], path: Path) -> None:
    """Writes named columns as CSV or Parquet by the suffix of `path`, in one step.

    Args:
        columns: name -> (n,) values; floats are written so that they read back exactly.
        path: file to write, ending in .csv or .parquet.

    Raises:
        OutputError: `path` cannot be written or has another suffix.
    """
    check_table_suffix(path)
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    with write_atomically(path) as temporary:
        if path.suffix == ".parquet":
            pa.parquet.write_table(table, temporary)
        else:
            _write_csv(table, temporary)


def _write_csv(table: pa.Table, path: Path) -> None:
    options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
    with path.open("wb") as file:
        file.write((",".join(table.column_names) + "\n").encode())  # pyarrow would quote the names
        pa.csv.write_csv(table, file, options)


def check_table_suffix(path: Path) -> None:
    """Raises OutputError unless `path` ends in .csv or .parquet."""
    if path.suffix not in (".csv", ".parquet"):
        raise OutputError("output", path.suffix or "no suffix", ".csv or .parquet", str(path))


def read_table(path: Path, known: tuple[str, ...]) -> dict[str, Array]:
    """Reads the numeric columns of a CSV or Parquet file.

    Args:
        path: file to read.
        known: column names that may occur.

    Returns:
        name -> (n,) finite values, n >= 2.

    Raises:
        MotionError: naming file, row and column, value and what is allowed.
    """
    source = str(path)
    check_readable(path, "motion", MotionError)
    table = _read_parquet(path) if path.suffix == ".parquet" else _read_csv(path)
    names = [name.strip() for name in table.column_names]
    for name in names:
        if name not in known:
            raise MotionError("column", name or "without a name", ", ".join(known), source)
        if names.count(name) > 1:
            raise MotionError("column", f"{name} twice", "each column once", source)
    if table.num_rows < 2:
        raise MotionError("rows", table.num_rows, "at least 2 samples", source)
    return {name: _column(table[i], name, source) for i, name in enumerate(names)}


def _read_parquet(path: Path) -> pa.Table:
    try:
        return pa.parquet.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise MotionError("file", str(error), "a Parquet file", str(path)) from None


def _read_csv(path: Path) -> pa.Table:
    with path.open("rb") as file:
        head = file.read(65536)
    if b"\0" in head:
        raise MotionError("file", "binary data", "CSV text or a .parquet file", str(path))
    try:
        header = head.decode("utf-8-sig", errors="ignore").splitlines()[0]
        names = next(csv.reader([header]))
        convert = pa.csv.ConvertOptions(column_types={name: pa.float64() for name in names}, null_values=[""])
        return pa.csv.read_csv(path, convert_options=convert)
    except (pa.ArrowException, StopIteration, IndexError, csv.Error) as error:
        raise _bad_cell(path) or MotionError("file", str(error), "CSV text", str(path)) from None


def _bad_cell(path: Path) -> MotionError | None:
    """Returns the error of the first cell that is no number, found by reading the file slowly."""
    source = str(path)
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = csv.reader(file)
        header = next(rows, [])
        for index, row in enumerate(rows):
            if row and len(row) != len(header):
                found = f"{len(row)} cells"
                return MotionError(_row(index), found, f"{len(header)} as in the header", source)
            for name, cell in zip(header, row, strict=False):
                try:
                    float(cell or 0)
                except ValueError:
                    return MotionError(f"{name}, {_row(index)}", cell, "a number", source)
    return None


def _column(column: pa.ChunkedArray, name: str, source: str) -> Array:
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise MotionError(f"column {name}", str(column.type), "numbers", source)
    if column.null_count:
        row = _row(int(np.argmax(column.is_null().to_numpy())))
        raise MotionError(f"{name}, {row}", "an empty cell", "a finite number", source)
    values: Array = column.cast(pa.float64()).to_numpy()
    if not np.isfinite(values).all():
        index = int(np.argmin(np.isfinite(values)))
        raise MotionError(f"{name}, {_row(index)}", float(values[index]), "a finite number", source)
    return values


def _row(index: int) -> str:
    """Returns how a message names a sample: data rows count from 1, the header is line 1."""
    return f"row {index + 1} (line {index + 2})"


def _motion(table: dict[str, Array], cutoff: float | None, name: str) -> Motion:
    if "t" not in table:
        raise MotionError("column t", "missing", "times in seconds")
    check_time(table["t"], _row)
    groups = {group: _group(table, group) for group in _GROUPS}
    if groups["position"] is None:
        raise MotionError("columns x, y, z", "missing", "the platform origin in metres")
    arrays = {"time": table["t"], "position": groups["position"]}
    orientation = _orientation(groups["quaternion"], groups["euler"])
    for target, values in (
        (("quaternion",), orientation),
        (("velocity", "angular_velocity"), groups["twist"]),
        (("acceleration", "angular_acceleration"), groups["accelerations"]),
        (("force", "moment"), groups["wrench"]),
    ):
        if values is not None:
            arrays |= dict(zip(target, np.split(values, len(target), axis=1), strict=True))
    return complete(arrays, cutoff, name)


def _group(table: dict[str, Array], group: str) -> Array | None:
    names = _GROUPS[group]
    missing = [name for name in names if name not in table]
    if len(missing) == len(names):
        return None
    if missing:
        allowed = f"all of {', '.join(names)} or none"
        raise MotionError(f"columns of the {group}", f"{', '.join(missing)} missing", allowed)
    return np.column_stack([table[name] for name in names])


def _orientation(quaternion: Array | None, euler: Array | None) -> Array | None:
    if quaternion is not None and euler is not None:
        raise MotionError("orientation", "quaternion and Euler angles", "only one of them")
    if quaternion is not None:
        check_quaternion(quaternion, _row)
    if euler is None:
        return quaternion
    converted: Array = Rotation.from_euler("XYZ", euler).as_quat(scalar_first=True)
    return converted
