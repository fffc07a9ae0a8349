"""Files of leg lengths, as `sixsps ik` writes them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import InputError
from sixsps.files import check_readable
from sixsps.motion import check_time
from sixsps.tables import Table, read_table

_LEGS = range(1, 7)
LENGTHS = tuple(f"l{leg}" for leg in _LEGS)
RATES = tuple(f"dl{leg}" for leg in _LEGS)
ACCELERATIONS = tuple(f"ddl{leg}" for leg in _LEGS)
COLUMNS = ("t", *LENGTHS, *RATES, *ACCELERATIONS)
"""All columns that a file of lengths may have."""


@dataclass(frozen=True, eq=False)
class LegLengthTable:
    """Leg lengths at n times.

    Attributes:
        time: (n,) strictly increasing [s].
        lengths: (n, 6) [m].
        rates: (n, 6) [m/s]; None where the file has none.
        accelerations: (n, 6) [m/s^2]; None where the file has none.
    """

    time: Array
    lengths: Array
    rates: Array | None
    accelerations: Array | None


def load(path: Path) -> LegLengthTable:
    """Reads leg lengths from CSV or Parquet: columns t, l1..l6, with or without dl1..dl6 and ddl1..ddl6.

    Raises:
        InputError: naming file, row and column, value and what is allowed.
    """
    check_readable(path, "lengths", InputError)
    table = read_table(path, COLUMNS, fewest=1)
    _check_columns(table)
    try:
        check_time(table.columns["t"], table.row)
    except InputError as error:
        raise InputError(error.place, error.value, error.allowed, str(path)) from None
    lengths, rates, accelerations = (_group(table, names) for names in (LENGTHS, RATES, ACCELERATIONS))
    assert lengths is not None  # noqa: S101  checked above
    if (lengths < 0).any():
        row, leg = (int(index) for index in np.argwhere(lengths < 0)[0])
        place = f"{LENGTHS[leg]}, {table.row(row)}"
        raise InputError(place, float(lengths[row, leg]), "a length of at least 0 [m]", str(path))
    return LegLengthTable(table.columns["t"], lengths, rates, accelerations)


def _check_columns(table: Table) -> None:
    source = str(table.path)
    for group in (("t",), LENGTHS, RATES, ACCELERATIONS):
        missing = [name for name in group if name not in table.columns]
        needed = group in (("t",), LENGTHS)
        if missing and (needed or len(missing) < len(group)):
            span = group[0] if len(group) == 1 else f"{group[0]} to {group[-1]}"
            allowed = f"{span}" if needed else f"all of {span} or none"
            raise InputError("columns", f"{', '.join(missing)} missing", allowed, source)
    if ACCELERATIONS[0] in table.columns and RATES[0] not in table.columns:
        raise InputError("columns", "ddl1 to ddl6 without rates", "dl1 to dl6 with them", source)


def _group(table: Table, names: tuple[str, ...]) -> Array | None:
    if names[0] not in table.columns:
        return None
    return np.column_stack([table.columns[name] for name in names])
