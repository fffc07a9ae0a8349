"""The limits of a mechanism as numbers that have to be at least 0, enclosed over cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from sixsps.arrays import Array
from sixsps.home import home_position
from sixsps.margins import leg_vectors, separate_pairs
from sixsps.mechanism import Mechanism
from sixsps.workspace.charts import Chart
from sixsps.workspace.clearance import Pairs, clearances
from sixsps.workspace.octree import Booleans
from sixsps.workspace.regularity import home_side, scaled_jacobian, side
from sixsps.workspace.taylor import Scalars, Vectors, dot, norm, stacked

# Rounding of everything below is a few dozen units of the largest coordinate's roundoff.
_ROUNDING = 64 * float(np.finfo(float).eps)
SINGULARITY, HALF_TURN = "singularity", "half turn"


@dataclass(frozen=True, eq=False)
class Cells:
    """Boxes of parameters and what they hold.

    Attributes:
        chart: of the parameters.
        centre: (n, 3).
        half: (n, 3) half widths.
    """

    chart: Chart
    centre: Array
    half: Array

    @cached_property
    def legs(self) -> Vectors:
        """Leg vectors [m]."""
        return self.chart.legs(self.centre, self.half)

    @cached_property
    def lengths(self) -> Scalars:
        """Leg lengths [m]."""
        return norm(self.legs)

    @cached_property
    def rounding(self) -> Array:
        """(n, 1) what rounding may change in a length [m]."""
        mechanism = self.chart.mechanism
        fixed = np.abs(mechanism.base_anchors).max() + np.abs(mechanism.platform_anchors).max()
        positions = np.abs(self.chart.poses(self.centre)[0]).max(axis=1, keepdims=True)
        return _ROUNDING * (positions + fixed)


@dataclass(frozen=True, eq=False)
class Limit:
    """One kind of limit, of one or several legs.

    Attributes:
        names: m, for a reader.
        over: cells -> m numbers that are >= 0 where the limit is kept.
    """

    names: tuple[str, ...]
    over: Callable[[Cells], Scalars]


class Constraints:
    """All that a pose of a chart has to keep.

    Args:
        chart: the poses.
        singularity: whether J has to be regular, with a determinant of the sign that it has at home.

    Attributes:
        names: m names of limits.
    """

    def __init__(self, chart: Chart, singularity: bool = True) -> None:
        self.chart = chart
        self._limits = list(_limits(chart))
        self._home_side = home_side(chart.mechanism) if singularity else None
        names = [name for limit in self._limits for name in limit.names]
        self.names = (*names, *([SINGULARITY] if singularity else []))

    def over(self, centre: Array, half: Array, regular: Booleans | None = None) -> Scalars:
        """Returns the m numbers that are >= 0 where all limits are kept, over cells.

        Args:
            centre: (n, 3) parameters.
            half: (n, 3) half widths.
            regular: (n,) cells that are known to be on the right side of the singularity.
        """
        cells = Cells(self.chart, centre, half)
        found = stacked([limit.over(cells) for limit in self._limits])
        if self._home_side is None:
            return found
        n = len(centre)
        # Nothing is known of cells that break another limit.
        value, slope, reach = np.zeros((n, 1)), np.zeros((n, 1, 3)), np.full((n, 1), np.inf)
        if regular is not None:
            value[regular], reach[regular] = 1.0, 0.0
        asked = np.flatnonzero((reach[:, 0] > 0) & (found.most(half) >= 0).all(axis=1))
        below, above = -reach, reach
        if len(asked):
            legs = Vectors(
                *(getattr(cells.legs, name)[asked] for name in ("value", "slope", "error", "move"))
            )
            there = side(self.chart, legs, centre[asked], half[asked], self._home_side)
            value[asked], slope[asked] = there.value, there.slope
            below[asked], above[asked] = there.below, there.above
        return stacked([found, Scalars(value, slope, below, above)])

    def at(self, parameters: Array) -> Array:
        """Returns (n, m) what has to be >= 0, at (n, 3) parameters; the determinant for the singularity."""
        cells = Cells(self.chart, parameters, np.zeros_like(parameters))
        found = [limit.over(cells).value for limit in self._limits]
        if self._home_side is not None:
            rotation = self.chart.poses(parameters)[1]
            J = scaled_jacobian(self.chart.mechanism, cells.legs.value, rotation)
            found.append(self._home_side * np.linalg.det(J)[:, None])
        return np.concatenate(found, axis=1)


def _limits(chart: Chart) -> Iterator[Limit]:
    mechanism, limits = chart.mechanism, chart.mechanism.limits
    for end, name in enumerate(("shortest", "longest")):
        legs = np.flatnonzero(
            (mechanism.length_limits[:, end] > 0) & np.isfinite(mechanism.length_limits[:, end])
        )
        if len(legs):
            yield Limit(_names(legs, name), partial(_stroke, legs, mechanism.length_limits[legs, end], end))
    for joint in ("base", "platform"):
        cone = getattr(limits, f"{joint}_cone")
        # A cone of pi holds every direction.
        legs = np.flatnonzero(np.zeros(6) if cone is None else cone < math.pi)
        if len(legs):
            axes = _axes(mechanism, joint)
            yield Limit(_names(legs, f"{joint} cone"), partial(_cone, joint, legs, axes, np.cos(cone[legs])))
    if limits.clearance is not None and separate_pairs(mechanism):
        pairs = np.array(separate_pairs(mechanism))
        names = tuple(f"legs {i + 1}-{j + 1} clearance" for i, j in pairs)
        yield Limit(names, partial(_clearance, pairs, limits.clearance))
    if chart.kind == "orientation":
        yield Limit((HALF_TURN,), lambda cells: stacked(cells.chart.ends(cells.centre, cells.half)))


def _names(legs: Pairs, what: str) -> tuple[str, ...]:
    return tuple(f"leg {leg + 1} {what}" for leg in legs)


def _stroke(legs: Pairs, bound: Array, end: int, cells: Cells) -> Scalars:
    """Returns l - shortest or longest - l [m]."""
    lengths = _of_legs(cells.lengths, legs)
    margin = lengths.times(-1.0).plus(bound) if end else lengths.plus(-bound)
    return margin.widened(cells.rounding)


def _cone(joint: str, legs: Pairs, axes: Array, cosines: Array, cells: Cells) -> Scalars:
    """Returns S . axis - |S| cos(cone) [m]."""
    if joint == "platform":
        turned = cells.chart.carried(axes, cells.centre, cells.half)
    else:
        zero = np.zeros((len(cells.centre), 6))
        turned = Vectors(np.broadcast_to(axes, (*zero.shape, 3)), np.zeros((*zero.shape, 3, 3)), zero, zero)
    along = _of_legs(dot(cells.legs, turned), legs)
    return (along + _of_legs(cells.lengths, legs).times(-cosines)).widened(cells.rounding)


def _of_legs(scalars: Scalars, legs: Pairs) -> Scalars:
    return Scalars(*(getattr(scalars, name)[:, legs] for name in ("value", "slope", "below", "above")))


def _clearance(pairs: Pairs, clearance: float, cells: Cells) -> Scalars:
    """Returns the distance of two legs' axes less the clearance [m]."""
    found = clearances(cells.chart.mechanism, pairs, clearance, cells.legs, cells.half)
    return found.widened(cells.rounding)


def _axes(mechanism: Mechanism, joint: str) -> Array:
    """Returns (6, 3) unit axes of the joints' cones, as given or the legs at home."""
    axes = getattr(mechanism.limits, f"{joint}_axes")
    if axes is None:
        axes = leg_vectors(mechanism, home_position(mechanism)[None], np.eye(3)[None])[0]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)
