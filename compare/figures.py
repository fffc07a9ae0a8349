"""The picture beside the report: the hexapod, its leg forces, and how far the engines are apart.

Needs matplotlib, the extra `figures`; a report without it has no picture and says how to get one.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from compare.figure_style import COLORS, save, styled
from compare.tolerances import tolerance_of
from sixsps.arrays import Array
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from compare.comparison import Comparison

FIGURE = "report.svg"
_MARKERS = ("o", "s", "^", "v", "D", "P", "X")
_POINTS = 800
# Of errors on a logarithmic axis.
_FLOOR = float(np.finfo(float).eps) / 8
# The hexapod is seen from the front, a little from the right and from above.
_AZIMUTH, _ELEVATION = np.radians(-60), np.radians(20)


def available() -> bool:
    """Returns whether matplotlib is installed and imports."""
    try:
        import_module("matplotlib.figure")
    except ImportError:
        return False
    return True


def preload() -> None:
    """Begins to import matplotlib, meant for while engines compute in processes of their own."""
    Thread(target=available, daemon=True).start()


def write_figure(comparison: Comparison, mechanism: Mechanism, folder: Path) -> Path:
    """Draws `report.svg` into `folder` and returns its path.

    Args:
        comparison: outcomes to draw.
        mechanism: what moved.
        folder: of the report.

    Raises:
        OutputError: it cannot be written.
    """
    from matplotlib.figure import Figure

    with styled():
        figure = Figure(figsize=(10, 4.6))
        places = figure.subplot_mosaic([["view", "forces"], ["view", "errors"]], width_ratios=(1, 1.7))
        figure.subplots_adjust(left=0.02, right=0.83, bottom=0.11, top=0.94, wspace=0.25, hspace=0.1)
        _draw_hexapod(
            places["view"], mechanism, comparison.motion, np.nan_to_num(comparison.reference.forces[0])
        )
        _draw_forces(places["forces"], comparison)
        _draw_errors(places["errors"], comparison)
        return save(figure, folder / FIGURE)


def _thinned(samples: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, samples - 1, min(samples, _POINTS)).astype(np.intp))


def _draw_forces(axes: Axes, comparison: Comparison) -> None:
    forces, time = comparison.reference.forces, comparison.motion.time
    shown = _thinned(len(time))
    for leg in range(6):
        axes.plot(time[shown], forces[shown, leg], color=COLORS[leg], label=str(leg + 1))
    axes.legend(title="leg", loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    axes.set_ylabel("leg force [N]\npositive: pushes")
    axes.tick_params(labelbottom=False)


def _draw_errors(axes: Axes, comparison: Comparison) -> None:
    """True errors as marks; differences from the stand-in as one band, or as a line where they are wrong."""
    reference, time = comparison.reference, comparison.motion.time
    axes.set_xlabel("time [s]")
    axes.set_ylabel(
        "relative error" if reference.truth is not None else f"difference from\n{reference.engine}"
    )
    axes.set_yscale("log")
    if not np.isfinite(reference.forces).any():
        return
    starts, stand_in = _thinned(len(time)), _stand_in(comparison)
    band = np.full(len(starts), _FLOOR)
    for index, outcome in enumerate(comparison.outcomes):
        if outcome.forces is None:
            continue
        color, marker = COLORS[index % len(COLORS)], _MARKERS[index % len(_MARKERS)]
        difference = _relative(np.abs(outcome.forces - stand_in), reference.largest)
        # The largest of every stretch, so that thinning hides no extreme.
        difference = np.maximum.reduceat(difference, starts)
        label = outcome.engine
        wrong = comparison.results["engines"][outcome.engine]["within_tolerance"] is False
        if reference.truth is None and outcome.engine != reference.engine:
            style = "-" if index < len(COLORS) else "--"
            axes.plot(time[starts], difference, color=color, ls=style, lw=1, label=label)
        elif wrong:
            axes.plot(time[starts], difference, color=color, lw=1, zorder=3)
        else:
            band = np.maximum(band, difference)
        if reference.truth is not None:
            true = _relative(reference.errors(outcome.forces), reference.largest)
            axes.plot(time[reference.samples], true, ls="", marker=marker, ms=3.5, color=color, label=label)
    if reference.truth is not None:
        among = f"all, against {reference.stand_in}"
        axes.fill_between(time[starts], _FLOOR, band, color="0.85", zorder=1, label=among)
    bound = tolerance_of(reference.stand_in).rounding(comparison.largest_error_growth)
    axes.axhline(bound, color="0.3", ls=":", lw=1, label="what rounding may do")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, fontsize=7)


def _stand_in(comparison: Comparison) -> Array:
    for outcome in comparison.outcomes:
        if outcome.engine == comparison.reference.stand_in and outcome.forces is not None:
            return outcome.forces
    return comparison.reference.forces


def _relative(errors: Array, scale: float) -> Array:
    """Returns the largest error of each sample, relative, with a floor that a logarithm can show."""
    return np.maximum(np.nan_to_num(errors).max(axis=1) / scale, _FLOOR)


def _draw_hexapod(axes: Axes, mechanism: Mechanism, motion: Motion, forces: Array) -> None:
    legs = inverse_kinematics(mechanism, motion[:1])
    base = _projected(mechanism.base_anchors)
    platform = _projected(mechanism.base_anchors + legs.leg_vectors[0])
    for anchors, color in ((base, "0.75"), (platform, "#E69F00")):
        around = anchors[_around(anchors)]
        axes.fill(*around.T, facecolor=color, edgecolor="0.3", alpha=0.7, zorder=1 if color == "0.75" else 3)
    largest = np.abs(forces).max() or 1.0
    for leg in range(6):
        ends = np.array([base[leg], platform[leg]])
        color = "#D55E00" if forces[leg] >= 0 else "#0072B2"
        axes.plot(
            *ends.T, color=color, lw=1 + 5 * abs(forces[leg]) / largest, solid_capstyle="round", zorder=2
        )
        axes.annotate(str(leg + 1), base[leg], textcoords="offset points", xytext=(0, -12), ha="center")
    axes.set_title(f"t = {motion.time[0]:g} s: red legs push, blue legs pull", fontsize=9)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.margins(0.1)


def _projected(points: Array) -> Array:
    """Returns (n, 2) points of an orthographic view of (n, 3) points."""
    across = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
    depth = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
    up = np.array([0.0, 0.0, np.cos(_ELEVATION)]) - np.sin(_ELEVATION) * depth
    return points @ np.column_stack([across, up])


def _around(points: Array) -> NDArray[np.intp]:
    center = points - points.mean(axis=0)
    return np.argsort(np.arctan2(center[:, 1], center[:, 0]))
