"""From a mechanism to its workspaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arguments import mechanism_of, whole_number
from sixsps.arrays import Array, frozen
from sixsps.errors import InputError
from sixsps.home import home_position
from sixsps.margins import pose_margins
from sixsps.mechanism import Mechanism
from sixsps.pose import Pose
from sixsps.workspace.charts import Chart, Translation, Turning
from sixsps.workspace.classes import INSIDE, OUTSIDE
from sixsps.workspace.constraints import SINGULARITY, Constraints
from sixsps.workspace.octree import Leaves
from sixsps.workspace.ranges import axis_ranges, tilts
from sixsps.workspace.refinement import Tree, Watch, placed, refine
from sixsps.workspace.result import EmptyWorkspaceError, Workspace, WorkspaceCells

TOLERANCE, CELLS = 0.01, 300_000
_FEWEST = 1000


def constant_orientation_workspace(
    mechanism: Mechanism,
    rotation: ArrayLike | None = None,
    *,
    position: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
    cells: int = CELLS,
    singularity: bool = True,
    watch: Watch | None = None,
) -> Workspace:
    """Returns the positions that the platform can reach at one orientation, from a reference position.

    A pose is allowed where strokes, joint cones and clearance of the mechanism are kept and, unless told not
    to ask for that, J is regular with a determinant of the sign that it has at home. Cells are halved until
    the bounds of the volume meet the tolerance; what they say of cells is proven, with room for rounding.

    Args:
        mechanism: geometry, with length limits.
        rotation: (3, 3) or quaternion (4,) w, x, y, z; identity by default.
        position: (3,) reference position [m]; home by default.
        tolerance: gap between the bounds of the volume, relative to the upper one.
        cells: number of cells that may be judged.
        singularity: whether poses beyond a singularity are out of reach.
        watch: called with the number of cells judged and the bounds of the volume.

    Raises:
        MechanismError: no length limits.
        MotionError: not a pose.
        InputError: a tolerance or number of cells out of range, or not a mechanism.
        EmptyWorkspaceError: the reference pose breaks a limit.
    """
    pose = _reference(mechanism, position, rotation)
    chart = Translation(mechanism, pose.position, pose.rotation)
    return _workspace(chart, singularity, tolerance, cells, watch)


def orientation_workspace(
    mechanism: Mechanism,
    position: ArrayLike | None = None,
    *,
    rotation: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
    cells: int = CELLS,
    singularity: bool = True,
    watch: Watch | None = None,
) -> Workspace:
    """Returns the orientations that the platform can take at one position, from a reference orientation.

    Arguments, what is allowed and errors as in `constant_orientation_workspace`; parameters are rotation
    vectors r of orientations exp(r) times the reference orientation, volumes Haar's measure.
    """
    pose = _reference(mechanism, position, rotation)
    chart = Turning(mechanism, pose.position, pose.rotation)
    return _workspace(chart, singularity, tolerance, cells, watch)


def _reference(mechanism: Mechanism, position: ArrayLike | None, rotation: ArrayLike | None) -> Pose:
    home = home_position(mechanism_of(mechanism))
    return Pose.of((home if position is None else position, np.eye(3) if rotation is None else rotation))


def _workspace(
    chart: Chart, singularity: bool, tolerance: float, cells: int, watch: Watch | None
) -> Workspace:
    tolerance, cells = _tolerance(tolerance), whole_number(cells, "cells", _FEWEST)
    constraints = Constraints(chart, singularity)
    _check_reference(constraints)
    tree = refine(constraints, tolerance, cells, watch or (lambda *_: None))
    return _result(constraints, tree, tolerance)


def _tolerance(given: float) -> float:
    tolerance = float(frozen(given, (), "tolerance", InputError))
    if not 0 < tolerance < 1:
        raise InputError("tolerance", given, "above 0 and below 1")
    return tolerance


def _check_reference(constraints: Constraints) -> None:
    """Raises EmptyWorkspaceError, saying which limit the reference pose breaks and by how much."""
    chart = constraints.chart
    position, rotation = chart.poses(np.zeros((1, 3)))
    broken = [
        f"{margin.name} of leg {margin.legs[leg]} is {margin.values[0, leg]:.6g} {margin.unit}, "
        f"limit {margin.limit[leg]:.6g}"
        for margin in pose_margins(chart.mechanism, position, rotation).limits.values()
        for leg in np.flatnonzero(margin.violated[0])
    ]
    value = constraints.over(np.zeros((1, 3)), np.zeros((1, 3))).value[0]
    if not broken and SINGULARITY in constraints.names and value[constraints.names.index(SINGULARITY)] <= 0:
        broken = ["singular, or beyond a singularity from the home pose"]
    if broken:
        more = f" (and {len(broken) - 1} more)" if len(broken) > 1 else ""
        where = ", ".join(f"{x:.6g}" for x in chart.position)
        raise EmptyWorkspaceError(
            f"no workspace: the reference pose at {where} m breaks a limit: {broken[0]}{more}"
        )


def _result(constraints: Constraints, tree: Tree, tolerance: float) -> Workspace:
    chart, leaf = constraints.chart, tree.leaf
    centre, half = placed(chart, leaf.index, leaf.level)
    verdicts = leaf.verdicts
    part = np.where(verdicts.state == OUTSIDE, -1, tree.part)
    cells = WorkspaceCells(
        centre, half, verdicts.state, verdicts.limit, part, tree.proven, leaf.low, leaf.high
    )
    return Workspace(
        mechanism=chart.mechanism,
        kind=chart.kind,
        position=chart.position,
        rotation=chart.rotation,
        limits=constraints.names,
        volume=tree.volume,
        apart=_apart(cells),
        inscribed=(float(verdicts.near.min()), float(verdicts.far.min())),
        extent=_extent(chart, cells),
        ranges=axis_ranges(constraints),
        tilts=tilts(constraints) if chart.kind == "orientation" else (),
        cells=cells,
        judged=tree.judged,
        tolerance=tolerance,
        _constraints=constraints,
        _leaves=Leaves(leaf.index, leaf.level),
    )


def _apart(cells: WorkspaceCells) -> tuple[tuple[float, float], ...]:
    """Returns the bounds of other parts in which some cell keeps all limits, the largest first."""
    others = np.unique(cells.part[(cells.part > 0) & (cells.state == INSIDE)])
    found = [
        (float(cells.lower[cells.part == other].sum()), float(cells.upper[cells.part == other].sum()))
        for other in others
    ]
    return tuple(sorted(found, reverse=True))


def _extent(chart: Chart, cells: WorkspaceCells) -> Array:
    here = cells.part == 0
    low = np.maximum((cells.centre[here] - cells.half[here, None]).min(axis=0), chart.box[:, 0])
    high = np.minimum((cells.centre[here] + cells.half[here, None]).max(axis=0), chart.box[:, 1])
    origin = chart.position if chart.kind == "translation" else np.zeros(3)
    return np.column_stack([low + origin, high + origin])
