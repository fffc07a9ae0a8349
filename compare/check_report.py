"""What `sixsps check` writes: everything as JSON, the violations as a table of numbers."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from compare.check import Check, Violation, runs
from compare.metrics import finite_or_none
from sixsps.architecture import best_condition
from sixsps.arrays import Array
from sixsps.errors import OutputError
from sixsps.files import write_atomically
from sixsps.margins import LIMITS, Margin
from sixsps.tables import write_table

_SUFFIXES = (".csv", ".parquet", ".json")
BETWEEN = (
    "Samples are held against the limits; between them leg lengths, as cubics through lengths and rates, and "
    "singular poses, on the path cubic through poses and velocities. Other limits are not checked there."
)


def check_output(path: Path) -> None:
    """Raises OutputError unless `path` ends in one of the suffixes that can be written."""
    if path.suffix not in _SUFFIXES:
        raise OutputError("output", path.suffix or "no suffix", ".csv, .parquet or .json", str(path))


def write(found: Check, path: Path) -> None:
    """Writes the violations as CSV or Parquet, or everything as JSON, by the suffix of `path`.

    Raises:
        OutputError: it cannot be written, or has another suffix.
    """
    check_output(path)
    if path.suffix != ".json":
        write_table(_columns(found.violations), path)
        return
    with write_atomically(path) as temporary:
        temporary.write_text(json_text(found), encoding="utf-8")


def json_text(found: Check) -> str:
    """Returns everything as the text of a JSON file."""
    return json.dumps(mapping(found), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def mapping(found: Check) -> dict[str, Any]:
    """Returns everything for JSON; None where there is no number."""
    time = found.motion.time
    return {
        "mechanism": found.mechanism.name,
        "motion": {
            "name": found.motion.name,
            "samples": len(time),
            "start_s": float(time[0]),
            "end_s": float(time[-1]),
        },
        "passed": found.passed,
        "forces_by": found.engine,
        "limits": {key: _limit(found, key) for key in LIMITS},
        "violations": [asdict(violation) for violation in found.violations],
        "singularity": _singularity(found),
        "checked": BETWEEN,
    }


def _limit(found: Check, key: str) -> dict[str, Any]:
    if key not in found.margins.limits:
        return {"name": LIMITS[key], "checked": False, "reason": found.margins.unchecked[key]}
    margin, time = found.margins.limits[key], found.motion.time
    entry = {
        "name": LIMITS[key],
        "checked": True,
        "unit": margin.unit,
        "legs": list(margin.legs),
        "allowed": [finite_or_none(float(limit)) for limit in margin.limit],
        "violated_samples": int(margin.violated.any(axis=1).sum()),
    }
    least = _least(margin)
    if least is None:
        return entry | dict.fromkeys(("least_margin", "t", "leg", "value"))
    sample, column = least
    return entry | {
        "least_margin": finite_or_none(float(margin.margins[sample, column])),
        "t": float(time[sample]),
        "leg": margin.legs[column],
        "value": float(margin.values[sample, column]),
    }


def _least(margin: Margin) -> tuple[int, int] | None:
    """Returns sample and column of the least margin; None where there is no value at all."""
    values = np.where(np.isnan(margin.margins), np.inf, margin.margins)
    if not values.size or not np.isfinite(values).any():
        return None
    sample, column = np.unravel_index(int(values.argmin()), values.shape)
    return int(sample), int(column)


def _singularity(found: Check) -> dict[str, Any]:
    time, crossings, distance = found.motion.time, found.crossings, found.distance
    worst, nearest = int(np.argmax(found.quality.condition)), int(np.argmin(distance.distance))
    there = np.zeros(len(time), dtype=np.intp)
    there[crossings.singular_samples] = 1
    return {
        "characteristic_length_m": found.quality.characteristic_length,
        "best_random_condition": best_condition(
            found.mechanism.base_anchors, found.mechanism.platform_anchors
        ),
        "largest_condition": finite_or_none(float(found.quality.condition[worst])),
        "largest_condition_t": float(time[worst]),
        "singular_samples": [
            {"start": float(time[start]), "end": float(time[end - 1]), "samples": end - start}
            for start, end in runs(there)
        ],
        "crossings": [
            {"t": float(t), "after_sample": int(sample) + 1, "position_m": p.tolist(), "rotation": R.tolist()}
            for t, sample, p, R in zip(
                crossings.time, crossings.interval, crossings.position, crossings.rotation, strict=True
            )
        ],
        "not_ruled_out": [{"start": float(time[k]), "end": float(time[k + 1])} for k in crossings.undecided],
        "least_distance_m": finite_or_none(float(distance.distance[nearest])),
        "least_distance_t": float(time[found.distance_samples[nearest]]),
        "none_within_m": float(distance.none_within[nearest]),
        "distance_is": "sqrt(|dp|^2 + (L theta)^2) to the nearest singular pose that was found",
        "distance_samples": len(found.distance_samples),
        "nearest_singular_pose": {
            "position_m": distance.position[nearest].tolist(),
            "rotation": distance.rotation[nearest].tolist(),
        },
    }


def _columns(violations: list[Violation]) -> dict[str, Array]:
    rows = [asdict(violation) for violation in violations]
    columns: dict[str, Any] = {}
    for name, kind in (("limit", str), ("leg", str), ("start", float), ("end", float), ("samples", int),
                       ("worst", float), ("value", float), ("allowed", float), ("unit", str)):  # fmt: skip
        values = [np.nan if row[name] is None else row[name] for row in rows]
        columns[name] = np.array(values, dtype=kind)
    return columns
