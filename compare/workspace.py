"""What `sixsps workspace` writes and prints: all figures as JSON, the cells as Parquet, a table."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compare.facts import mechanism_facts, versions
from compare.modes import numbers
from sixsps.arrays import Array
from sixsps.errors import printable
from sixsps.files import write_atomically

if TYPE_CHECKING:
    from sixsps.workspace import Workspace

RESULTS, CELLS = "workspace.json", "workspace.parquet"
# Of the table on the terminal; the file has all.
_SHOWN_TILTS = 12
_SHOWN_PARTS = 3


def orientation(text: str | None) -> Array | None:
    """Returns the (3, 3) rotation of `--orientation`; None where it is not given.

    Raises:
        InputError: not three numbers.
    """
    if text is None:
        return None
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("XYZ", numbers("--orientation", text, 3)).as_matrix())


def facts(found: list[Workspace], command: str, cells: int, singularity: bool) -> dict[str, Any]:
    """Returns all figures for JSON.

    Args:
        found: workspaces of one mechanism, at least one.
        command: that was given.
        cells: number of cells that each search was allowed.
        singularity: whether poses beyond a singularity were out of reach.
    """
    first = found[0]
    return {
        "command": command,
        "versions": versions(),
        "mechanism": mechanism_facts(first.mechanism),
        "reference_pose": {
            "position_m": first.position.tolist(),
            "euler_rad": _euler(first.rotation).tolist(),
            "euler_is": "R = Rx(alpha) Ry(beta) Rz(gamma)",
        },
        "settings": {"tolerance_rel": first.tolerance, "cells": cells, "singularity": singularity},
        "workspaces": {workspace.kind: _entry(workspace) for workspace in found},
    }


def _entry(workspace: Workspace) -> dict[str, Any]:
    unit = workspace.unit
    entry: dict[str, Any] = {
        f"volume_{unit}3": list(workspace.volume),
        "volume_is": _MEASURES[workspace.kind],
        "gap_rel": workspace.gap,
        "converged": workspace.converged,
        "cells_judged": workspace.judged,
        f"apart_{unit}3": [list(bounds) for bounds in workspace.apart],
        f"inscribed_radius_{unit}": list(workspace.inscribed),
        f"extent_{unit}": workspace.extent.tolist(),
        "ranges": [
            {
                "axis": one.axis,
                f"low_{unit}": one.low,
                f"high_{unit}": one.high,
                "low_limit": one.low_limit,
                "high_limit": one.high_limit,
            }
            for one in workspace.ranges
        ],
        "limits": list(workspace.limits),
    }
    if workspace.tilts:
        entry["tilts"] = [
            {"azimuth_rad": one.azimuth, "tilt_rad": one.tilt, "limit": one.limit} for one in workspace.tilts
        ]
    return entry


_MEASURES = {
    "translation": "bounds of the positions that the reference position reaches at its orientation",
    "orientation": "bounds by Haar's measure, 8 pi^2 in all, of the orientations that the reference reaches",
}


def write_cells(found: list[Workspace], folder: Path) -> Path:
    """Writes `workspace.parquet`, one row a cell, and returns its path.

    Columns: kind; c1, c2, c3 the centre, a position of O1 [m] or a rotation vector from the reference
    orientation [rad]; half [m or rad]; state; limit that decides, empty inside; part, 0 with the reference
    pose; proven; lower and upper bound of the allowed volume.

    Raises:
        OutputError: it cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet

    path = folder / CELLS
    with write_atomically(path) as temporary:
        pa.parquet.write_table(pa.concat_tables([_cell_table(one) for one in found]), temporary)
    return path


def _cell_table(workspace: Workspace) -> Any:
    import pyarrow as pa

    from sixsps.workspace.result import STATES

    cells = workspace.cells
    centre = cells.centre + (workspace.position if workspace.kind == "translation" else 0.0)
    # Number -1 is the last name.
    limits = np.array([*workspace.limits, ""])
    columns = {"kind": np.full(len(cells), workspace.kind)}
    columns |= {f"c{k + 1}": np.ascontiguousarray(centre[:, k]) for k in range(3)}
    columns |= {"half": cells.half, "state": np.array(STATES)[cells.state], "limit": limits[cells.limit]}
    columns |= {name: getattr(cells, name) for name in ("part", "proven", "lower", "upper")}
    return pa.table({name: pa.array(values) for name, values in columns.items()})


def table(workspace: Workspace) -> str:
    """Returns a workspace for a reader, in 80 columns."""
    unit, euler = workspace.unit, _numbers(_euler(workspace.rotation))
    reference = f"at {_numbers(workspace.position)} m, {euler} rad"
    what = "positions" if workspace.kind == "translation" else "orientations"
    lower, upper = workspace.volume
    lines = [
        f"{printable(workspace.mechanism.name)[:24]}: {what}, reference {reference}",
        f"volume  {lower:.6g} to {upper:.6g} {unit}^3, a gap of {workspace.gap:.2%}"
        + ("" if workspace.kind == "translation" else f" (all rotations: {8 * math.pi**2:.4g})"),
        _ending(workspace),
        f"ball    radius {workspace.inscribed[0]:.6g} to {workspace.inscribed[1]:.6g} {unit} "
        "around the reference pose",
        *_parts(workspace),
        "",
        f"{'axis':<6}{'from':>13}{'to':>13} {unit:<5}ended by",
    ]
    for one in workspace.ranges:
        ends = one.low_limit if one.low_limit == one.high_limit else f"{one.low_limit}, {one.high_limit}"
        lines.append(f"{one.axis:<6}{one.low:>13.6g}{one.high:>13.6g}      {ends}")
    return "\n".join([*lines, *_tilts(workspace)]) + "\n"


def _ending(workspace: Workspace) -> str:
    asked, judged = f"{workspace.tolerance:.2%}", workspace.judged
    if workspace.converged:
        return f"        within the {asked} asked for, with {judged} cells"
    return f"        NOT within the {asked} asked for, after {judged} cells, see --cells"


def _parts(workspace: Workspace) -> list[str]:
    found = [f"{low:.4g} to {high:.4g}" for low, high in workspace.apart[:_SHOWN_PARTS]]
    if not found:
        return []
    more = len(workspace.apart) - len(found)
    return [f"apart   {'; '.join(found)} {workspace.unit}^3{f'; {more} more' if more else ''}: out of reach"]


def _tilts(workspace: Workspace) -> list[str]:
    if not workspace.tilts:
        return []
    shown = workspace.tilts[:: len(workspace.tilts) // _SHOWN_TILTS]
    least = min(workspace.tilts, key=lambda one: one.tilt)
    degrees = [(round(math.degrees(one.azimuth)), math.degrees(one.tilt)) for one in shown]
    return [
        "",
        "largest tilt without torsion [deg], by the azimuth towards which it leans [deg]",
        "".join(f"{azimuth:>6}" for azimuth, _ in degrees),
        "".join(f"{tilt:>6.1f}" for _, tilt in degrees),
        f"least: {math.degrees(least.tilt):.4g} deg towards {math.degrees(least.azimuth):.4g} deg, "
        f"ended by {least.limit}",
    ]


def _euler(rotation: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_euler("XYZ"))


def _numbers(values: Array) -> str:
    cleaned = np.where(np.abs(values) < 1e-12, 0.0, values)
    return "[" + ", ".join(f"{value:.4g}" for value in cleaned) + "]"
