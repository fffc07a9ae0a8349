"""The picture of workspaces: three sections through the reference pose, and a view of the surface.

Needs matplotlib, the extra `figures`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from compare.figure_style import COLORS, save, styled
from sixsps.arrays import Array
from sixsps.workspace.constraints import HALF_TURN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from sixsps.workspace import Workspace

NAME = "workspace"
_LINES = {"shortest": "--", "longest": "-", "base cone": ":", "platform cone": "-."}
_OTHERS = {"clearance": "0.0", "singularity": "0.45", "half turn": "0.7"}
_REACHED, _APART = "#DCE9F2", "#E8E8E8"
_CHANGES = {"font.size": 8, "axes.grid": False, "axes.spines.top": True, "axes.spines.right": True}
# Points of a section in each direction.
_POINTS = 181
# Pieces of the surface in the view.
_PIECES = 6000
_AXES = {
    "translation": ("x [m]", "y [m]", "z [m]"),
    "orientation": ("r_x [rad]", "r_y [rad]", "r_z [rad]"),
}


def write_figures(found: list[Workspace], folder: Path) -> list[Path]:
    """Draws `workspace.svg` and `workspace.png` into an existing folder; returns their paths.

    Args:
        found: workspaces, one a row.
        folder: existing folder.

    Raises:
        OutputError: a file cannot be written.
    """
    from matplotlib.figure import Figure

    with styled(_CHANGES):
        figure = Figure(figsize=(15, 4.2 * len(found)), layout="constrained")
        for row, workspace in enumerate(found):
            names: dict[str, Any] = {}
            for k, across in enumerate(((0, 1), (0, 2), (1, 2))):
                axes = figure.add_subplot(len(found), 4, 4 * row + k + 1)
                _section(axes, workspace, across, names)
            view: Any = figure.add_subplot(len(found), 4, 4 * row + 4, projection="3d")
            _surface(view, workspace, names)
            view.legend(
                [_handle(name) for name in sorted(names)],
                sorted(names),
                loc="center left",
                bbox_to_anchor=(1.2, 0.5),
                frameon=False,
                fontsize=7,
            )
        return [save(figure, folder / f"{NAME}.{suffix}", dpi=150) for suffix in ("svg", "png")]


def style_of(name: str) -> tuple[str, str]:
    """Returns colour and line style of a limit: the colour is the leg's, the style the kind's."""
    words = name.split(" ", 2)
    if words[0] == "leg":
        return COLORS[int(words[1]) - 1], _LINES[words[2]]
    kind = "clearance" if words[0] == "legs" else name
    return _OTHERS[kind], "-"


def _handle(name: str) -> Any:
    from matplotlib.lines import Line2D

    color, line = style_of(name)
    return Line2D([], [], color=color, ls=line)


def _section(axes: Axes, workspace: Workspace, across: tuple[int, int], names: dict[str, Any]) -> None:
    """Draws what is allowed in a plane through the reference pose, and which limit ends it where."""
    origin = workspace.position if workspace.kind == "translation" else np.zeros(3)
    sides = []
    for axis in across:
        low, high = workspace.extent[axis] - origin[axis]
        edge = 0.04 * (high - low)
        sides.append(np.linspace(low - edge, high + edge, _POINTS))
    grid = np.zeros((_POINTS, _POINTS, 3))
    grid[..., across[0]], grid[..., across[1]] = np.meshgrid(*sides, indexing="ij")
    margins = workspace.margins(grid.reshape(-1, 3))
    part = _parts(workspace, grid.reshape(-1, 3))
    allowed = (margins >= 0).all(axis=1)
    state = np.where(allowed & (part == 0), 2, np.where(allowed, 1, 0)).reshape(_POINTS, _POINTS)
    x, y = (side + origin[axis] for side, axis in zip(sides, across, strict=True))
    axes.contourf(x, y, state.T, levels=[0.5, 1.5, 2.5], colors=[_APART, _REACHED])
    for k, name in enumerate(workspace.limits):
        others = np.delete(margins, k, axis=1)
        line = _kept(others).reshape(_POINTS, _POINTS)
        values = np.ma.array(margins[:, k].reshape(_POINTS, _POINTS), mask=~line)
        if values.count() and values.min() < 0 < values.max():
            color, style = style_of(name)
            axes.contour(x, y, values.T, levels=[0.0], colors=[color], linestyles=[style], linewidths=1.4)
            names[name] = True
    axes.plot(origin[across[0]], origin[across[1]], "+", color="k", ms=8)
    labels = _AXES[workspace.kind]
    axes.set_xlabel(labels[across[0]])
    axes.set_ylabel(labels[across[1]])
    axes.set_aspect("equal")


def _parts(workspace: Workspace, parameters: Array) -> NDArray[np.int64]:
    cell = workspace.cell_of(parameters)
    return np.where(cell >= 0, workspace.cells.part[cell], -1)


def _kept(margins: Array) -> NDArray[np.bool_]:
    """Returns where limits are kept, and the points beside, so that lines meet."""
    from scipy.ndimage import binary_dilation

    kept = (margins >= 0).all(axis=1).reshape(_POINTS, _POINTS)
    return np.asarray(binary_dilation(kept, np.ones((3, 3)))).ravel()


def _surface(view: Any, workspace: Workspace, names: dict[str, Any]) -> None:
    """Draws a small square on each piece of the surface, in the colour of the limit that makes it."""
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    for k, axis in enumerate("xyz"):
        getattr(view, f"set_{axis}lim")(*workspace.extent[k])
        getattr(view, f"set_{axis}label")(_AXES[workspace.kind][k])
        getattr(view, f"{axis}axis").set_major_locator(MaxNLocator(4))
    view.set_box_aspect(np.ptp(workspace.extent, axis=1))
    centre, half, limit = _pieces(workspace)
    if not len(centre):
        return
    origin = workspace.position if workspace.kind == "translation" else np.zeros(3)
    centre, normal, kept = _feet(workspace, centre, half, limit)
    centre, normal, half, limit = centre[kept], normal[kept], half[kept], limit[kept]
    across = np.cross(normal, np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    across *= 1.15 * (half / np.linalg.norm(across, axis=1))[:, None]
    along = np.cross(normal, across)
    corners = np.stack([-across - along, across - along, across + along, along - across], axis=1)
    light = 0.55 + 0.45 * np.abs(normal @ np.array([0.48, -0.6, 0.64]))
    colors = np.array([_rgb(style_of(workspace.limits[k])[0]) for k in limit]) * light[:, None]
    squares = centre[:, None] + corners + origin
    faces = Poly3DCollection(squares, facecolors=np.clip(colors, 0, 1), rasterized=True)
    view.add_collection3d(faces)
    names.update(dict.fromkeys(workspace.limits[k] for k in np.unique(limit)))


def _rgb(color: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    return to_rgb(color)


def _pieces(workspace: Workspace) -> tuple[Array, Array, NDArray[np.int64]]:
    """Returns centres, half edges and limits of cells of one size on the surface, few enough to draw."""
    cells = workspace.cells
    here = (cells.state == 1) & (cells.part == 0)
    if HALF_TURN in workspace.limits:
        here &= cells.limit != workspace.limits.index(HALF_TURN)
    centre, limit = cells.centre[here], cells.limit[here]
    if not len(centre):
        return centre, cells.half[here], limit
    size = cells.half[here].min()
    while True:
        at = np.floor(centre / (2 * size)).astype(np.int64)
        unique, first = np.unique(at, axis=0, return_index=True)
        if len(unique) <= _PIECES:
            return (2 * unique + 1) * size, np.full(len(unique), size), limit[first]
        size *= 2


def _feet(
    workspace: Workspace, centre: Array, half: Array, limit: NDArray[np.int64]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Returns feet on the surfaces of the limits, unit normals, and which of them bound the workspace."""
    rows = np.arange(len(limit))
    step = 1e-4 * half[0]
    ahead, behind = (
        np.stack([workspace.margins(centre + sign * step * axis)[rows, limit] for axis in np.eye(3)], axis=1)
        for sign in (1, -1)
    )
    slope = (ahead - behind) / (2 * step)
    size = np.maximum(np.linalg.norm(slope, axis=1), np.finfo(float).tiny)
    normal = slope / size[:, None]
    way = workspace.margins(centre)[rows, limit] / size
    foot = centre - way[:, None] * normal
    margins = workspace.margins(foot)
    # Others may be broken by what a quarter of a cell changes.
    slack = 0.25 * half * size
    margins[rows, limit] = np.inf
    return foot, normal, np.asarray((margins >= -slack[:, None]).all(axis=1) & (np.abs(way) <= 2 * half))
