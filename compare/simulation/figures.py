"""The paper's figures 3 to 7: planned motion and simulated motion, and the forces between them.

Needs matplotlib, the extra `figures`.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from compare.figure_style import COLORS, save, styled
from compare.simulation.trajectory import Trajectory, rotation_between
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS = 800
# Where the axis of differences ends when there are none.
_FLOOR = 1e-18
# Least range of an axis, of the largest planned value.
_FLAT = 0.01


def write_figures(path: Trajectory, mechanism: Mechanism, folder: Path) -> list[Path]:
    """Draws figures 3 to 7, each as SVG and PNG, into an existing folder; returns their paths.

    Args:
        path: simulated motion, k >= 2 samples.
        mechanism: what moved.
        folder: existing folder.

    Raises:
        OutputError: a file cannot be written.
    """
    with styled():
        return [
            save(figure, folder / f"{name}.{suffix}")
            for name, figure in _figures(path, mechanism)
            for suffix in ("svg", "png")
        ]


def _figures(path: Trajectory, mechanism: Mechanism) -> Iterator[tuple[str, Figure]]:
    planned, state = path.planned, path.state
    first = planned.quaternion[:1].repeat(len(planned), axis=0)
    yield "figure3_driving_forces", _forces(path)
    yield "figure4_trajectory", _trajectory(path, mechanism)
    yield "figure5_velocity", _compared(
        path, ("velocity of O1 [m/s]", planned.velocity, state.velocity),
        ("angular velocity [rad/s]", planned.angular_velocity, state.angular_velocity),
    )  # fmt: skip
    yield "figure6_acceleration", _compared(
        path, ("acceleration of O1 [m/s²]", planned.acceleration, path.accelerations[:, :3]),
        ("angular acceleration [rad/s²]", planned.angular_acceleration, path.accelerations[:, 3:]),
    )  # fmt: skip
    moved, followed = (p - planned.position[0] for p in (planned.position, state.position))
    turned, turning = (rotation_between(first, q) for q in (planned.quaternion, state.quaternion))
    yield (
        "figure7_displacement",
        _compared(
            path, ("displacement of O1 [m]", moved, followed), ("rotation vector [rad]", turned, turning)
        ),
    )


def _forces(path: Trajectory) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.3, 3.6), layout="constrained")
    axes = figure.subplots()
    shown = _thinned(len(path.planned))
    for leg in range(6):
        axes.plot(
            path.planned.time[shown], path.forces[shown, leg], color=COLORS[leg], lw=1.4, label=str(leg + 1)
        )
    axes.axhline(0, color="0.4", lw=0.6)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("driving force [N]\npositive: pushes")
    axes.margins(x=0)
    figure.legend(title="leg", loc="outside right center", frameon=False)
    return figure


def _compared(path: Trajectory, *quantities: tuple[str, Array, Array]) -> Figure:
    """Draws vectors (k, 3), planned and simulated, and below how far they are apart."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(6.3, 4.4), layout="constrained")
    rows = figure.subplots(2, 2, sharex=True, height_ratios=(1.7, 1))
    time, shown = path.planned.time, _thinned(len(path.planned))
    for column, (label, planned, simulated) in enumerate(quantities):
        above, below = rows[:, column]
        for axis in range(3):
            above.plot(time[shown], planned[shown, axis], color=COLORS[axis], lw=4, alpha=0.35)
            above.plot(time[shown], simulated[shown, axis], color=COLORS[axis], lw=1)
        _flat(above, planned, simulated)
        _draw_difference(below, time[shown], np.linalg.norm(simulated - planned, axis=1), shown)
        above.set_ylabel(label)
        below.set_ylabel(f"difference {label[label.index('[') :]}")
        below.set_xlabel("time [s]")
        below.margins(x=0)
    lines = [Line2D([], [], color=COLORS[axis], label="xyz"[axis]) for axis in range(3)]
    lines += [Line2D([], [], color="0.4", lw=4, alpha=0.5, label="planned")]
    lines += [Line2D([], [], color="0.25", lw=1, label="simulated")]
    figure.legend(handles=lines, loc="outside upper center", ncols=5, frameon=False)
    return figure


def _draw_difference(axes: Any, time: Array, difference: Array, starts: NDArray[np.intp]) -> None:
    from matplotlib.ticker import NullFormatter

    # The largest of every stretch, so that thinning hides no extreme; a logarithm shows no zero.
    largest = np.maximum.reduceat(difference, starts)
    shown = largest[np.isfinite(largest) & (largest > 0)]
    axes.plot(time, np.where(largest > 0, largest, np.nan), color="0.25", lw=0.9)
    axes.set_yscale("log")
    low, high = (shown.min(), shown.max()) if len(shown) else (_FLOOR, _FLOOR)
    axes.set_ylim(10 ** np.floor(np.log10(low)), 10 ** (np.floor(np.log10(high)) + 1))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _flat(axes: Any, planned: Array, simulated: Array) -> None:
    """Gives an axis a range where nothing changes, which rounding would be magnified to fill."""
    values = np.hstack([planned, simulated])
    values = values[np.isfinite(values)]
    least = _FLAT * (float(np.abs(planned).max()) or 1.0)
    if np.ptp(values) < least:
        axes.set_ylim(values.mean() - least, values.mean() + least)


def _trajectory(path: Trajectory, mechanism: Mechanism) -> Figure:
    """Draws the path of O1 in space, between the base and the platform at both ends."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.3, 4.8))
    axes: Any = figure.add_axes((0.0, 0.02, 0.95, 0.98), projection="3d", computed_zorder=False)
    shown = _thinned(len(path.planned))
    planned, simulated = path.planned.position[shown], path.state.position[shown]
    _draw_bodies(axes, path, mechanism)
    axes.plot(*planned.T, color=COLORS[1], lw=5, alpha=0.5, label="planned path of O1", zorder=5)
    axes.plot(*simulated.T, color="0.1", lw=1, label="simulated", zorder=6)
    axes.plot(*simulated[:1].T, color="0.1", ls="", marker="o", ms=4, label="start", zorder=6)
    axes.plot(*simulated[-1:].T, color="0.1", ls="", marker="^", ms=5, label="end", zorder=6)
    for direction in (axes.xaxis, axes.yaxis, axes.zaxis):
        direction.set_major_locator(MaxNLocator(5))
        direction.labelpad = 8
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.set_box_aspect(
        [np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())], zoom=0.95
    )
    axes.view_init(elev=22, azim=-55)
    figure.legend(loc="upper left", frameon=False)
    return figure


def _draw_bodies(axes: Any, path: Trajectory, mechanism: Mechanism) -> None:
    """Draws the base, the platform at both ends of the path, and the legs at the last."""
    polygons: Any = import_module("mpl_toolkits.mplot3d.art3d").Poly3DCollection
    base, rotation = mechanism.base_anchors, path.state.rotation
    first, last = (path.state.position[k] + mechanism.platform_anchors @ rotation[k].T for k in (0, -1))
    for anchors, color, alpha in ((base, "0.6", 0.35), (first, "#56B4E9", 0.3), (last, "#56B4E9", 0.6)):
        # Anchors need not lie in a plane, nor in order around it.
        outline = anchors[_around(anchors)]
        axes.add_collection3d(polygons([outline], facecolor=color, edgecolor="0.3", lw=0.8, alpha=alpha))
    for ends in zip(base, last, strict=True):
        axes.plot(*np.array(ends).T, color="0.55", lw=0.8, zorder=2)


def _around(anchors: Array) -> NDArray[np.intp]:
    """Returns the order (n,) of points around their centre, in the plane that fits them best."""
    centred = anchors - anchors.mean(axis=0)
    x, y = np.linalg.svd(centred)[2][:2] @ centred.T
    return np.argsort(np.arctan2(y, x))


def _thinned(samples: int) -> Any:
    return np.unique(np.linspace(0, samples - 1, min(samples, _POINTS)).astype(np.intp))
