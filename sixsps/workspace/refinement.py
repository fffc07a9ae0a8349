"""Halving of cells until the volume is known well enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sixsps.arrays import Array
from sixsps.workspace.charts import Chart
from sixsps.workspace.classes import BOUNDARY, EDGE, INSIDE, OUTSIDE, Verdicts, judge
from sixsps.workspace.constraints import Constraints
from sixsps.workspace.octree import CORNERS, DEEPEST, Booleans, Integers, Leaves

Watch = Callable[[int, float, float], None]
"""Called with the number of cells judged and the bounds of the volume."""

# Cells that every search begins with: 8^3.
_FIRST_LEVEL = 3
# What the cells that are not halved may have together of the gap that is allowed.
_LEFT = 0.3
# Part of its gap that a cell loses when it is halved, at least where the halves are cut once.
_GAIN = 0.4
# Part of the cells left that a round may take for the volume, and part of all that is not for it.
_SHARE, _RESERVE = 0.8, 0.02


@dataclass(frozen=True, eq=False)
class Leaf:
    """n cells, their verdicts, and bounds of the allowed volume in each.

    Attributes:
        index: (n, 3) coordinates on the cells' own levels.
        level: (n,) how often the root was halved.
        verdicts: on the cells.
        low: (n,) least allowed volume.
        high: (n,) largest allowed volume.
    """

    index: Integers
    level: Integers
    verdicts: Verdicts
    low: Array
    high: Array

    @classmethod
    def judged(cls, constraints: Constraints, index: Integers, level: Integers, regular: Booleans) -> Leaf:
        """Returns cells with their verdicts."""
        chart = constraints.chart
        centre, half = placed(chart, index, level)
        verdicts = judge(constraints, centre, half, regular)
        least, most = chart.density(centre, half)
        low, high = ((2 * half) ** 3 * part for part in (verdicts.lower * least, verdicts.upper * most))
        inside = verdicts.state == INSIDE
        low[inside] = high[inside] = chart.measure(centre[inside], half[inside])
        return cls(index, level, verdicts, low, high)

    def replaced(self, kept: Booleans, fresh: Leaf) -> Leaf:
        """Returns the cells that are kept, and fresh ones."""

        def joined(name: str) -> Any:
            return np.concatenate([getattr(self, name)[kept], getattr(fresh, name)])

        verdicts = Verdicts.joined([self.verdicts[kept], fresh.verdicts])
        return Leaf(joined("index"), joined("level"), verdicts, joined("low"), joined("high"))


@dataclass(frozen=True, eq=False)
class Tree:
    """The leaves, and which of them hang together with the reference pose.

    Attributes:
        leaf: n cells.
        proven: (n,) whether the allowed part of a cell is proven to hang together with the reference pose.
        part: (n,) 0 where it may, -1 outside, other numbers of parts that do not touch.
        volume: lower and upper bound of all that hangs together with the reference pose.
        judged: number of cells that were judged on the way.
    """

    leaf: Leaf
    proven: Booleans
    part: Integers
    volume: tuple[float, float]
    judged: int


def refine(constraints: Constraints, tolerance: float, cells: int, watch: Watch) -> Tree:
    """Halves cells until the bounds of the volume are within `tolerance` of each other.

    Args:
        constraints: to be kept.
        tolerance: gap between the bounds, relative to the upper one.
        cells: number of cells that may be judged.
        watch: called after every round.
    """
    grid = np.arange(1 << _FIRST_LEVEL)
    index = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    first = np.full(len(index), _FIRST_LEVEL)
    leaf = Leaf.judged(constraints, index, first, np.zeros(len(index), dtype=bool))
    judged = len(index)
    while True:
        tree = _tree(constraints.chart, leaf, judged)
        watch(judged, *tree.volume)
        left = cells - judged
        # The rest is for the ball, which is small where the reference pose is near a limit.
        most = left * _SHARE // 8 if left > _RESERVE * cells else 0
        chosen = _to_halve(tree, tolerance, int(most))[: left // 8]
        if not len(chosen):
            return tree
        kept = np.ones(len(leaf.level), dtype=bool)
        kept[chosen] = False
        index = (2 * leaf.index[chosen][:, None] + CORNERS).reshape(-1, 3)
        regular = np.repeat(leaf.verdicts.regular[chosen], 8)
        fresh = Leaf.judged(constraints, index, np.repeat(leaf.level[chosen] + 1, 8), regular)
        leaf, judged = leaf.replaced(kept, fresh), judged + len(index)


def placed(chart: Chart, index: Integers, level: Integers) -> tuple[Array, Array]:
    """Returns centres (n, 3) and half edges (n,) of cells."""
    centre, size = chart.root
    half = size / np.left_shift(1, level)
    return centre - size + (2 * index + 1) * half[:, None], half


def _tree(chart: Chart, leaf: Leaf, judged: int) -> Tree:
    n = len(leaf.level)
    proven, part = np.zeros(n, dtype=bool), np.full(n, -1)
    here = np.flatnonzero(leaf.verdicts.state != OUTSIDE)
    if len(here):
        found = leaf.verdicts[here]
        leaves = Leaves(leaf.index[here], leaf.level[here])
        labels = leaves.parts(found.corners, found.state == INSIDE)
        proven[here] = np.isin(labels, labels[found.holds_reference])
        centre, half = placed(chart, leaf.index[here], leaf.level[here])
        every = np.ones_like(found.corners)
        labels = leaves.parts(every, every[:, 0])
        glued = chart.glued(centre, half)
        labels[np.isin(labels, labels[glued])] = labels.max() + 1
        start = labels[(np.abs(centre) <= half[:, None] * (1 + EDGE)).all(axis=1)]
        part[here] = np.where(np.isin(labels, start), 0, labels + 1)
    volume = float(leaf.low[proven].sum()), float(leaf.high[part == 0].sum())
    return Tree(leaf, proven, part, volume, judged)


def _to_halve(tree: Tree, tolerance: float, most: int) -> Integers:
    """Returns the leaves to be halved: those at the inscribed ball, then as few as carry the volume's gap.

    Args:
        tree: the leaves.
        tolerance: of the volume, and of the ball's radius.
        most: number of leaves that may be halved for the volume.
    """
    leaf, (lower, upper) = tree.leaf, tree.volume
    verdicts = leaf.verdicts
    open_ = (verdicts.state == BOUNDARY) & (tree.part == 0) & (leaf.level < DEEPEST)
    critical = open_ & (verdicts.near < (1 - tolerance) * verdicts.far.min())
    chosen = np.flatnonzero(critical)
    excess = upper - lower - tolerance * upper
    if excess > 0:
        others = np.flatnonzero(open_ & ~critical)
        gap = leaf.high[others] - np.where(tree.proven[others], leaf.low[others], 0.0)
        order = np.argsort(gap)[::-1]
        carried = np.cumsum(gap[order])
        left = gap.sum() - carried
        enough = (left <= _LEFT * tolerance * upper) | (carried >= excess / _GAIN)
        count = int(np.argmax(enough)) + 1 if enough.any() else len(order)
        chosen = np.concatenate([chosen, others[order[: min(count, most)]]])
    return chosen
