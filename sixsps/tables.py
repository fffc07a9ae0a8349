"""Tables of numbers: CSV and Parquet in and out, with the place of every bad cell."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
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
    """Columns of a file, or of a block of its rows.

    Attributes:
        path: the file.
        columns: name -> (n,) finite numbers.
        first: number of rows of the file before these.
    """

    path: Path
    columns: dict[str, Array]
    first: int = 0

    def row(self, index: int) -> str:
        """Returns how a message names a sample: data rows count from 1, lines as an editor does."""
        return _row(self.path, self.first + index)


def read_table(path: Path, known: tuple[str, ...], fewest: int = 2) -> Table:
    """Reads the numeric columns of a CSV or Parquet file.

    Args:
        path: file to read.
        known: column names that may occur.
        fewest: rows that it must have.

    Raises:
        MotionError: naming file, row and column, value and what is allowed.
    """
    check_table_file(path)
    with names_in_errors(path, known):
        table = _read_parquet(path) if path.suffix == ".parquet" else _read_csv(path, fewest)
        names = column_names(table.column_names, known, path)
    check_row_number(table.num_rows, path, fewest)
    return table_of(table, names, path)


def check_table_file(path: Path) -> None:
    """Raises MotionError unless `path` is a regular file with content that may be read."""
    if exists(path) and not (path.is_file() or path.is_dir()):
        raise MotionError("motion", "a pipe or device", "a regular file", str(path))
    check_readable(path, "motion", MotionError)


@contextmanager
def names_in_errors(path: Path, known: tuple[str, ...]) -> Iterator[None]:
    """Turns what is said of names that are not UTF-8, by whatever reads them, into a MotionError."""
    try:
        yield
    except UnicodeDecodeError:
        raise MotionError("column", "a name that is not UTF-8", ", ".join(known), str(path)) from None


def column_names(given: list[str], known: tuple[str, ...], path: Path) -> list[str]:
    """Returns the names of columns without blanks around them.

    Raises:
        MotionError: a name is not known, or stands twice.
    """
    names = [name.strip() for name in given]
    for name in names:
        if name not in known:
            raise MotionError("column", name or "without a name", ", ".join(known), str(path))
        if names.count(name) > 1:
            raise MotionError("column", f"{name} twice", "each column once", str(path))
    return names


def check_row_number(rows: int, path: Path, fewest: int = 2) -> None:
    """Raises MotionError where a file has too few rows, by default for a motion."""
    if rows < fewest:
        raise MotionError("rows", rows, _at_least(fewest), str(path))


def _at_least(rows: int) -> str:
    return f"at least {rows} sample{'s' if rows > 1 else ''}"


def table_of(content: pa.Table, names: list[str], path: Path, first: int = 0) -> Table:
    """Returns the numbers in rows of a file.

    Args:
        content: the rows.
        names: of its columns.
        path: the file.
        first: number of rows of the file before these.

    Raises:
        MotionError: a column or a cell is no usable number.
    """
    columns = zip(names, content.columns, strict=True)
    return Table(path, {name: _column(column, name, path, first) for name, column in columns}, first)


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
            with csv_appender(table.schema, temporary) as append:
                append(table)


def check_table_suffix(path: Path) -> None:
    """Raises OutputError unless `path` ends in .csv or .parquet."""
    if path.suffix not in (".csv", ".parquet"):
        raise OutputError("output", path.suffix or "no suffix", ".csv or .parquet", str(path))


@contextmanager
def csv_appender(schema: pa.Schema, path: Path) -> Iterator[Callable[[pa.Table], None]]:
    """Yields what appends tables to a CSV file, which has its header; floats read back exactly."""
    options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
    with path.open("wb") as file:
        file.write((",".join(schema.names) + "\n").encode())  # pyarrow would quote the names
        yield lambda table: pa.csv.write_csv(table, file, options)


@contextmanager
def parquet_errors(path: Path) -> Iterator[None]:
    """Turns what is wrong with a Parquet file into a MotionError."""
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        raise MotionError("file", str(error), "a Parquet file", str(path)) from None


def _read_parquet(path: Path) -> pa.Table:
    with parquet_errors(path), pa.parquet.ParquetFile(path) as file:
        return file.read()


def _read_csv(path: Path, fewest: int) -> pa.Table:
    with csv_errors(path, fewest) as convert:
        return pa.csv.read_csv(path, convert_options=convert)


@contextmanager
def csv_errors(path: Path, fewest: int = 2) -> Iterator[pa.csv.ConvertOptions]:
    """Yields how the cells of a CSV file are to be read: as numbers, all of them.

    Raises:
        MotionError: it is no such file; says what is wrong with it, and in which row.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if b"\0" in head:
        raise MotionError("file", "binary data", "CSV text or a .parquet file", str(path))
    lines = [line for line in head.decode("utf-8-sig", errors="ignore").splitlines() if line.strip()]
    if not lines:
        raise MotionError("file", "no text", "CSV text", str(path))
    try:
        names = next(csv.reader(lines))
        types = {name: pa.float64() for name in names}
        yield pa.csv.ConvertOptions(column_types=types, null_values=[""])
    except (pa.ArrowException, csv.Error) as error:
        if len(lines) == 1 and len(head) < _HEAD_BYTES:
            raise MotionError("rows", 0, _at_least(fewest), str(path)) from None
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


def _column(column: pa.ChunkedArray, name: str, path: Path, first: int) -> Array:
    source = str(path)
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise MotionError(f"column {name}", str(column.type), "numbers", source)
    if column.null_count:
        row = _row(path, first + int(np.argmax(column.is_null().to_numpy())))
        raise MotionError(f"{name}, {row}", "an empty cell", _ALLOWED, source)
    values: Array = column.cast(pa.float64(), safe=False).to_numpy()
    usable = np.abs(values) <= LARGEST
    if not usable.all():
        index = int(np.argmin(usable))
        raise MotionError(f"{name}, {_row(path, first + index)}", float(values[index]), _ALLOWED, source)
    return values
