"""Numbers and tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import floor, log10

from benchmarks.figures import Spread

_UNITS = ((1e9, "s"), (1e6, "ms"), (1e3, "us"), (1.0, "ns"))
_PLAIN = (1e-3, 1e7)


def number(value: float) -> str:
    """Returns a value with three digits that count, or all those before the point."""
    if value == 0 or not _PLAIN[0] <= abs(value) < _PLAIN[1]:
        return f"{value:.2g}"
    return f"{value:.{max(0, 2 - floor(log10(abs(value))))}f}"


def spread(value: Spread, scale: float = 1.0) -> str:
    """Returns median and range, in units of 1 / scale."""
    low, high = number(scale * value.low), number(scale * value.high)
    return f"{number(scale * value.median)} ({low} to {high})"


def percent(share: Spread) -> str:
    """Returns median and range of a share."""
    return spread(share, 100)


def duration(ns: float) -> str:
    """Returns a time with the unit that suits it."""
    size, unit = next((pair for pair in _UNITS if abs(ns) >= pair[0]), _UNITS[-1])
    return f"{number(ns / size)} {unit}"


def table(header: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> str:
    """Returns a table.

    Args:
        header: of the columns.
        rows: their cells; one that is short is filled up.
        words: number of columns of words; those after them are of numbers.
    """
    rule = ["---"] * words + ["---:"] * (len(header) - words)
    filled = ([*cells, *[""] * (len(header) - len(cells))] for cells in rows)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [header, rule, *filled])


def missing(row: dict[str, str]) -> tuple[str, str]:
    """Returns the cells of a row that has no figures."""
    return f"`{row['name']}`", f"not here: {row['reason']}"
