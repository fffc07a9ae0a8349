"""Motions that are longer than the memory, read from a file block by block."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sixsps.motion import Motion, check_time
from sixsps.motion_file import COLUMNS, check_columns, has_derivatives, motion_of, source_in_errors
from sixsps.table_stream import Rows, TableStream, open_table


@dataclass(frozen=True, eq=False)
class MotionStream:
    """A motion file to be read block by block.

    Attributes:
        table: the file.
    """

    table: TableStream

    @property
    def samples(self) -> int | None:
        """Number of samples; None where the file does not say, as CSV."""
        return self.table.rows

    def blocks(self, size: int) -> Generator[Callable[[], Motion], None, None]:
        """Yields what returns the blocks of the motion, in their order, when it is called.

        Reading is done here. The call checks a block as `Motion.load` does the whole, may be left to
        another thread, and tells what is right only when all blocks before are.

        Args:
            size: samples of a block; the last has fewer, others may have somewhat more.

        Raises:
            MotionError: the file cannot be read; from the call, naming file, row and column, value
                and what is allowed.
        """
        before = None
        for rows in self.table.blocks(size):
            yield partial(_motion, rows, before)
            before = rows.last("t")


def open_motion(path: Path) -> MotionStream | None:
    """Opens a motion file to read it block by block; no sample is read yet.

    Args:
        path: file to read.

    Returns:
        The motion, or None where it lacks derivatives: estimating them takes the whole of it at once.

    Raises:
        MotionError: naming file and column, value and what is allowed.
    """
    table = open_table(path, COLUMNS)
    with source_in_errors(path):
        check_columns(table.names)
    return MotionStream(table) if has_derivatives(table.names) else None


def _motion(rows: Rows, before: Rows | None) -> Motion:
    with source_in_errors(rows.path):
        table = rows.table()
        if before is not None:
            border = np.append(before.table().columns["t"], table.columns["t"][0])
            check_time(border, lambda _: table.row(0))
        return motion_of(table)
