"""Stored results: `results.json` and `forces.parquet`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from compare.comparison import Comparison
from sixsps.files import write_atomically, write_json

RESULTS, FORCES = "results.json", "forces.parquet"


def write_results(results: dict[str, Any], folder: Path) -> Path:
    """Writes `results.json` into `folder` and returns its path.

    Raises:
        OutputError: it cannot be written.
    """
    return write_json(results, folder / RESULTS)


def read_results(path: Path) -> dict[str, Any]:
    """Returns the content of a `results.json`."""
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def write_forces(comparison: Comparison, folder: Path) -> Path:
    """Writes `forces.parquet`, one row an engine and sample, and returns its path.

    Columns: engine, t [s], f1..f6 [N], closure_residual [N, N m] and closure_error [m]; NaN where
    there is none.

    Raises:
        OutputError: it cannot be written.
    """
    time = comparison.motion.time
    tables = []
    for outcome in comparison.outcomes:
        if outcome.forces is None:
            continue
        none = np.full(len(time), np.nan)
        columns = {"engine": pa.array([outcome.engine] * len(time), pa.string()), "t": pa.array(time)}
        columns |= {f"f{leg + 1}": pa.array(outcome.forces[:, leg]) for leg in range(6)}
        for name in ("closure_residual", "closure_error"):
            values = getattr(outcome, name)
            columns[name] = pa.array(none if values is None else values)
        tables.append(pa.table(columns))
    path = folder / FORCES
    if not tables:
        tables = [_empty()]
    with write_atomically(path) as temporary:
        pa.parquet.write_table(pa.concat_tables(tables), temporary)
    return path


def _empty() -> pa.Table:
    numbers = ["t", *(f"f{leg}" for leg in range(1, 7)), "closure_residual", "closure_error"]
    columns = {"engine": pa.array([], pa.string())}
    return pa.table(columns | {name: pa.array([], pa.float64()) for name in numbers})
