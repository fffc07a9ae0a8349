"""How far one may go from the reference pose in given directions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.workspace.charts import Chart
from sixsps.workspace.constraints import HALF_TURN, Constraints

# Where a limit is met is known to this part of the longest way: to rounding.
_RESOLUTION = 1e-15
# Limits this part of it apart end a way together.
_TOGETHER = 1e-9
# Halvings and doublings after which a search that creeps along a limit ends.
_ROUNDS = 1000
_AXES = {"translation": ("x", "y", "z"), "orientation": ("roll", "pitch", "yaw")}
AZIMUTHS = 36


@dataclass(frozen=True)
class AxisRange:
    """How far the platform may go along, or turn about, one world axis from the reference pose.

    Attributes:
        axis: x, y, z, or roll, pitch, yaw, the rotations about the world's x, y, z.
        low: <= 0 [m or rad].
        high: >= 0 [m or rad].
        low_limit: name of the limit that ends it below.
        high_limit: name of the limit that ends it above.
    """

    axis: str
    low: float
    high: float
    low_limit: str
    high_limit: str


@dataclass(frozen=True)
class Tilt:
    """How far the platform may tilt towards one side from the reference pose, without torsion.

    Attributes:
        azimuth: direction in the world's xy plane that the platform's upper side turns to, from x to y [rad].
        tilt: angle about the horizontal axis across it [rad].
        limit: name of the limit that ends it.
    """

    azimuth: float
    tilt: float
    limit: str


def axis_ranges(constraints: Constraints) -> tuple[AxisRange, ...]:
    """Returns the ranges along the three axes of a chart."""
    chart = constraints.chart
    way, limits = ways(constraints, np.concatenate([np.eye(3), -np.eye(3)]))
    return tuple(
        AxisRange(axis, -float(way[k + 3]), float(way[k]), limits[k + 3], limits[k])
        for k, axis in enumerate(_AXES[chart.kind])
    )


def tilts(constraints: Constraints) -> tuple[Tilt, ...]:
    """Returns the largest tilts towards `AZIMUTHS` sides, of a chart of rotations."""
    azimuth = 2 * math.pi * np.arange(AZIMUTHS) / AZIMUTHS
    axes = np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(AZIMUTHS)])
    way, limits = ways(constraints, axes)
    return tuple(Tilt(*entry) for entry in zip(azimuth.tolist(), way.tolist(), limits, strict=True))


def ways(constraints: Constraints, directions: Array) -> tuple[Array, list[str]]:
    """Returns how far every pose on straight ways from the parameters 0 is proven to keep all limits.

    Args:
        constraints: to be kept; the parameters 0 keep them.
        directions: (k, 3) unit vectors of parameters.

    Returns:
        (k,) lengths, located to rounding, and the k names of the limits that end the ways.
    """
    longest = _longest(constraints.chart)
    way, step = np.zeros(len(directions)), np.full(len(directions), longest / 16)
    stops = np.zeros(len(directions), dtype=np.intp)
    for _ in range(_ROUNDS):
        going = np.flatnonzero((step > _RESOLUTION * longest) & (way < longest))
        if not len(going):
            break
        least = _least(constraints, directions[going], way[going], step[going])
        free = (least >= 0).all(axis=1)
        # Of limits that end a way together, as those of mirrored legs, the first one is named.
        stops[going] = (
            least <= np.maximum(least.min(axis=1, keepdims=True), 0) + _TOGETHER * longest
        ).argmax(axis=1)
        way[going[free]] += step[going[free]]
        step[going] = np.where(free, 2 * step[going], step[going] / 2)
        step = np.minimum(step, longest - way)
    names = [constraints.names[stop] for stop in stops]
    ends = [HALF_TURN if end >= longest else name for end, name in zip(way, names, strict=True)]
    return way, ends


def _longest(chart: Chart) -> float:
    """Returns the length of a way that no direction exceeds."""
    if chart.kind == "orientation":
        return math.pi
    centre, half = chart.root
    return float(np.linalg.norm(np.abs(centre) + half))


def _least(constraints: Constraints, directions: Array, way: Array, step: Array) -> Array:
    """Returns the (k, m) least margins on pieces of the ways from `way` to `way + step`."""
    centre = (way + step / 2)[:, None] * directions
    f = constraints.over(centre, np.abs(directions) * step[:, None] / 2)
    along = np.abs(np.einsum("nmk,nk->nm", f.slope, directions))
    return f.value + f.below - along * step[:, None] / 2
