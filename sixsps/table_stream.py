"""Tables that are longer than the memory: rows of CSV and Parquet files, in and out, block by block."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from sixsps.arrays import Array
from sixsps.files import write_atomically
from sixsps.tables import (
    Table,
    check_row_number,
    check_table_file,
    check_table_suffix,
    column_names,
    csv_appender,
    csv_errors,
    names_in_errors,
    parquet_errors,
    table_of,
)

# Pages are read through a buffer a column, because a row group, which would be read at once without,
# may be as large as the file. A larger buffer was no faster, from memory or from disk.
_BUFFER_BYTES = 65536
_CSV_BLOCK_BYTES = 1 << 20
# Rows that are asked for at once: columns that still lie in the cache when they are used.
_MOST_READ = 32768
# Two megabytes a column: long enough to be read fast, short beside the memory.
_ROW_GROUP = 262144


@dataclass(frozen=True, eq=False)
class Rows:
    """Successive rows of a file, of which only the types of columns are known.

    Attributes:
        content: what was read.
        names: of its columns.
        path: the file.
        first: number of rows of the file before these.
    """

    content: pa.Table
    names: list[str]
    path: Path
    first: int

    def __len__(self) -> int:
        return len(self.content)

    def table(self) -> Table:
        """Returns the numbers.

        Raises:
            MotionError: as `read_table`, for a column or a cell.
        """
        return table_of(self.content, self.names, self.path, self.first)

    def last(self, name: str) -> Rows:
        """Returns one column of the last row; it does not keep the others in memory."""
        index = len(self) - 1
        cell = self.content.select([self.names.index(name)]).slice(index)
        return Rows(cell, [name], self.path, self.first + index)


@dataclass(frozen=True, eq=False)
class TableStream:
    """A CSV or Parquet file to be read block by block.

    Attributes:
        path: the file.
        names: of its columns, in their order.
        rows: number of its rows; None where the file does not say, as CSV.
    """

    path: Path
    names: list[str]
    rows: int | None

    def blocks(self, size: int) -> Iterator[Rows]:
        """Reads the file.

        Args:
            size: rows of a block; the last has fewer, others may have somewhat more.

        Raises:
            MotionError: the file cannot be read.
        """
        first = 0
        with closing(_batches(self.path, min(size, _MOST_READ))) as batches:
            for content in _gathered(batches, size):
                yield Rows(content, self.names, self.path, first)
                first += len(content)
        check_row_number(first, self.path)


def open_table(path: Path, known: tuple[str, ...]) -> TableStream:
    """Opens a CSV or Parquet file to read it block by block; of its rows nothing is read yet.

    Args:
        path: file to read.
        known: column names that may occur.

    Raises:
        MotionError: naming file and column, value and what is allowed.
    """
    check_table_file(path)
    with names_in_errors(path, known):
        if path.suffix == ".parquet":
            with parquet_errors(path), pa.parquet.ParquetFile(path) as file:
                given, rows = file.schema_arrow.names, file.metadata.num_rows
        else:
            with csv_errors(path) as options, _open_csv(path, options) as reader:
                given, rows = reader.schema.names, None
        names = column_names(given, known, path)
    if rows is not None:
        check_row_number(rows, path)
    return TableStream(path, names, rows)


def row_count(path: Path) -> tuple[int, bool]:
    """Returns how many rows a file has, of CSV about, and whether that is exact.

    Raises:
        MotionError: the file cannot be read.
    """
    check_table_file(path)
    if path.suffix == ".parquet":
        with parquet_errors(path):
            return pa.parquet.read_metadata(path).num_rows, True
    with path.open("rb") as file:
        head = file.read(_CSV_BLOCK_BYTES)
    return round(path.stat().st_size * head.count(b"\n") / len(head)), False


def _batches(path: Path, size: int) -> Generator[pa.RecordBatch, None, None]:
    if path.suffix == ".parquet":
        # Reading ahead by pyarrow itself would keep all that was read until the end.
        options = {"buffer_size": _BUFFER_BYTES, "pre_buffer": False}
        with parquet_errors(path), pa.parquet.ParquetFile(path, **options) as file:
            yield from file.iter_batches(size)
    else:
        with csv_errors(path) as options, _open_csv(path, options) as reader:
            yield from reader


def _open_csv(path: Path, options: pa.csv.ConvertOptions) -> pa.csv.CSVStreamingReader:
    read = pa.csv.ReadOptions(block_size=_CSV_BLOCK_BYTES)
    return pa.csv.open_csv(path, read_options=read, convert_options=options)


def _gathered(batches: Iterator[pa.RecordBatch], size: int) -> Iterator[pa.Table]:
    """Yields the rows of `batches`, `size` at least, but for the last."""
    held: list[pa.RecordBatch] = []
    for batch in batches:
        held.append(batch)
        if sum(map(len, held)) >= size:
            yield pa.Table.from_batches(held)
            held = []
    if any(map(len, held)):
        yield pa.Table.from_batches(held)


@contextmanager
def writing(path: Path, names: Sequence[str]) -> Iterator[Callable[[Mapping[str, Array]], None]]:
    """Yields what appends rows to a CSV or Parquet file, which takes its name when the block ends well.

    Floats are written so that they read back exactly.

    Args:
        path: file to write, ending in .csv or .parquet.
        names: of its columns; every call gives (n,) values of each.

    Raises:
        OutputError: `path` cannot be written or has another suffix.
    """
    check_table_suffix(path)
    schema = pa.schema([(name, pa.float64()) for name in names])
    appender = csv_appender if path.suffix == ".csv" else _parquet_appender
    held: list[pa.RecordBatch] = []
    with write_atomically(path) as temporary, appender(schema, temporary) as write:

        def append(columns: Mapping[str, Array]) -> None:
            held.append(pa.record_batch([pa.array(columns[name]) for name in names], schema=schema))
            if sum(map(len, held)) >= _ROW_GROUP:
                flush()

        def flush() -> None:
            write(pa.Table.from_batches(held, schema))
            held.clear()

        yield append
        if held:
            flush()


@contextmanager
def _parquet_appender(schema: pa.Schema, path: Path) -> Iterator[Callable[[pa.Table], None]]:
    with path.open("wb") as file:  # Python's own errors say in short that a disk is full
        # Computed floats do not repeat: Snappy would save a fifteenth and take twice the time, and a
        # dictionary would make the file larger.
        writer = pa.parquet.ParquetWriter(file, schema, compression="none", use_dictionary=False)
        try:
            yield writer.write_table
            writer.close()
        finally:
            writer.is_open = False  # or it would try to end a broken file when it is collected
