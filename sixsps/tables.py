"""Tables of numbers: CSV and Parquet in and out, with the place of every bad cell."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from sixsps.arrays import LARGEST, Array
from sixsps.errors import MotionError, OutputError
from sixsps.files import check_readable, exists, write_atomically

_ALLOWED = f"a finite number up to {LARGEST:g}"
_NUMBER = re.compile(
    r"(?:\s*[-+]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|inf|infinity|nan)\s*)?", re.IGNORECASE
)
_HEAD_BYTES = 65536


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a file.

    Attributes:
        path: the file.
        columns: name -> (n,) finite numbers.
    """

    path: Path
    columns: dict[str, Array]

    def row(self, index: int) -> str:
        """Returns how a message names a sample: data rows count from 1, lines as an editor does."""
        return _row(self.path, index)


def read_table(path: Path, known: tuple[str, ...]) -> Table:
    """Reads the numeric columns of a CSV or Parquet file.

    Args:
        path: file to read.
        known: column names that may occur.

    Returns:
        The table, of at least two rows.

    Raises:
        MotionError: naming file, row and column, value and what is allowed.
    """
    source = str(path)
    if exists(path) and not (path.is_file() or path.is_dir()):
        raise MotionError("motion", "a pipe or device", "a regular file", source)
    check_readable(path, "motion", MotionError)
    try:
        table = _read_parquet(path) if path.suffix == ".parquet" else _read_csv(path)
        names = [name.strip() for name in table.column_names]
    except UnicodeDecodeError:
        raise MotionError("column", "a name that is not UTF-8", ", ".join(known), source) from None
    for name in names:
        if name not in known:
            raise MotionError("column", name or "without a name", ", ".join(known), source)
        if names.count(name) > 1:
            raise MotionError("column", f"{name} twice", "each column once", source)
    if table.num_rows < 2:
        raise MotionError("rows", table.num_rows, "at least 2 samples", source)
    return Table(path, {name: _column(table[i], name, path) for i, name in enumerate(names)})


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


def check_table_suffix(path: Path) -> None:
    """Raises OutputError unless `path` ends in .csv or .parquet."""
    if path.suffix not in (".csv", ".parquet"):
        raise OutputError("output", path.suffix or "no suffix", ".csv or .parquet", str(path))


def _write_csv(table: pa.Table, path: Path) -> None:
    options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
    with path.open("wb") as file:
        file.write((",".join(table.column_names) + "\n").encode())  # pyarrow would quote the names
        pa.csv.write_csv(table, file, options)


def _read_parquet(path: Path) -> pa.Table:
    try:
        return pa.parquet.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise MotionError("file", str(error), "a Parquet file", str(path)) from None


def _read_csv(path: Path) -> pa.Table:
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if b"\0" in head:
        raise MotionError("file", "binary data", "CSV text or a .parquet file", str(path))
    lines = [line for line in head.decode("utf-8-sig", errors="ignore").splitlines() if line.strip()]
    if not lines:
        raise MotionError("file", "no text", "CSV text", str(path))
    try:
        names = next(csv.reader(lines))
        convert = pa.csv.ConvertOptions(column_types={name: pa.float64() for name in names}, null_values=[""])
        return pa.csv.read_csv(path, convert_options=convert)
    except (pa.ArrowException, csv.Error) as error:
        if len(lines) == 1 and len(head) < _HEAD_BYTES:
            raise MotionError("rows", 0, "at least 2 samples", str(path)) from None
        raise _bad_cell(path) or MotionError("file", str(error), "CSV text", str(path)) from None


def _bad_cell(path: Path) -> MotionError | None:
    """Returns the error of the first cell that is no number, found by reading the file slowly."""
    source = str(path)
    rows = _rows(path)
    _, header = next(rows)
    for index, (_, row) in enumerate(rows):
        if len(row) != len(header):
            found = f"{len(row)} cells"
            return MotionError(_row(path, index), found, f"{len(header)} as in the header", source)
        for name, cell in zip(header, row, strict=True):
            if not _NUMBER.fullmatch(cell):
                return MotionError(f"{name.strip()}, {_row(path, index)}", cell, "a number", source)
    return None


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yields line number and cells of every line of a CSV file that is not empty."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        reader = csv.reader(file)
        for row in reader:
            if row:
                yield reader.line_num, row


def _row(path: Path, index: int) -> str:
    if path.suffix == ".parquet":
        return f"row {index + 1}"
    lines = (line for line, _ in _rows(path))
    next(lines, None)  # the header
    line = next((line for number, line in enumerate(lines) if number == index), index + 2)
    return f"row {index + 1} (line {line})"


def _column(column: pa.ChunkedArray, name: str, path: Path) -> Array:
    source = str(path)
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise MotionError(f"column {name}", str(column.type), "numbers", source)
    if column.null_count:
        row = _row(path, int(np.argmax(column.is_null().to_numpy())))
        raise MotionError(f"{name}, {row}", "an empty cell", _ALLOWED, source)
    values: Array = column.cast(pa.float64(), safe=False).to_numpy()
    usable = np.abs(values) <= LARGEST
    if not usable.all():
        index = int(np.argmin(usable))
        raise MotionError(f"{name}, {_row(path, index)}", float(values[index]), _ALLOWED, source)
    return values
