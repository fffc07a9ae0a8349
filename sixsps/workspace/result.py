"""What is known of a workspace."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sixsps.arrays import Array
from sixsps.errors import SixspsError
from sixsps.mechanism import Mechanism
from sixsps.workspace.constraints import Constraints
from sixsps.workspace.octree import DEEPEST, Booleans, Integers, Leaves
from sixsps.workspace.ranges import AxisRange, Tilt

STATES = ("outside", "boundary", "inside")


class EmptyWorkspaceError(SixspsError):
    """A reference pose that breaks a limit, so that nothing can be reached from it."""


@dataclass(frozen=True, eq=False)
class WorkspaceCells:
    """The cubes that the space of parameters was cut into.

    Attributes:
        centre: (n, 3) parameters: displacement from the reference position [m], or rotation vector r [rad]
            of the orientation exp(r) times the reference orientation.
        half: (n,) half edges [m or rad].
        state: (n,) number in `STATES`: 2 keeps all limits, 0 breaks one everywhere, both proven; 1 neither.
        limit: (n,) number of the limit that decides, -1 inside.
        part: (n,) 0 may hang together with the reference pose, other numbers hang together with one another,
            -1 outside.
        proven: (n,) whether the allowed part of the cell is proven to hang together with the reference pose.
        lower: (n,) least allowed volume.
        upper: (n,) largest allowed volume.
    """

    centre: Array
    half: Array
    state: Integers
    limit: Integers
    part: Integers
    proven: Booleans
    lower: Array
    upper: Array

    def __len__(self) -> int:
        return len(self.half)


@dataclass(frozen=True, eq=False)
class Workspace:
    """The poses that can be reached from a reference pose without breaking a limit on the way.

    Attributes:
        mechanism: whose workspace it is.
        kind: `translation` at one orientation, or `orientation` at one position.
        position: (3,) of the reference pose [m].
        rotation: (3, 3) of the reference pose.
        limits: m names of the limits that were kept.
        volume: lower and upper bound [m^3], or [rad^3] by Haar's measure, of which all rotations have 8 pi^2.
        apart: bounds of the volumes of parts that keep all limits and that the reference pose cannot reach.
        inscribed: lower and upper bound of the radius of the largest ball of displacements or of rotation
            vectors around the reference pose [m or rad].
        extent: (3, 2) a box that holds the workspace: positions [m] or rotation vectors [rad].
        ranges: along, or about, the three world axes.
        tilts: without torsion, of an orientation workspace; else none.
        cells: the cubes.
        judged: number of cubes that were looked at.
        tolerance: gap between the bounds of the volume, relative to the upper one, that was asked for.
    """

    mechanism: Mechanism = field(repr=False)
    kind: str
    position: Array
    rotation: Array
    limits: tuple[str, ...] = field(repr=False)
    volume: tuple[float, float]
    apart: tuple[tuple[float, float], ...]
    inscribed: tuple[float, float]
    extent: Array
    ranges: tuple[AxisRange, ...]
    tilts: tuple[Tilt, ...] = field(repr=False)
    cells: WorkspaceCells = field(repr=False)
    judged: int
    tolerance: float
    _constraints: Constraints = field(repr=False)
    _leaves: Leaves = field(repr=False)

    @property
    def gap(self) -> float:
        """What the bounds of the volume differ by, relative to the upper one."""
        return 1 - self.volume[0] / self.volume[1]

    @property
    def converged(self) -> bool:
        """Whether the gap is as small as was asked for; else the number of cells ended the search."""
        return self.gap <= self.tolerance

    @property
    def unit(self) -> str:
        """Unit of parameters: m or rad."""
        return self._constraints.chart.unit

    def cell_of(self, parameters: Array) -> Integers:
        """Returns the number of the cell that holds each of (n, 3) parameters, -1 outside of all."""
        centre, half = self._constraints.chart.root
        place = np.floor((parameters - centre + half) * ((1 << DEEPEST) / (2 * half)))
        return self._leaves.holding(np.clip(place, -1, 1 << DEEPEST).astype(np.int64))

    def poses(self, parameters: Array) -> tuple[Array, Array]:
        """Returns positions (n, 3) and rotations (n, 3, 3) of (n, 3) parameters."""
        return self._constraints.chart.poses(parameters)

    def margins(self, parameters: Array) -> Array:
        """Returns (n, m) numbers that are >= 0 where limits are kept, of (n, 3) parameters.

        They are l - shortest and longest - l, S . axis - l cos(cone), distance - clearance [m], the
        determinant of the Jacobian with its angular columns over the characteristic length, positive on the
        side of home, and the angle that is left to half a turn [rad].
        """
        return self._constraints.at(parameters)
