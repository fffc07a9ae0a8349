"""The picture of `sixsps check`: margins to all limits over time.

Needs matplotlib, the extra `figures`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from compare.check import Check
from compare.figure_style import COLORS, check_suffix, save, styled
from sixsps.arrays import Array
from sixsps.margins import Margin

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STRETCHES = 800


def write_figure(found: Check, path: Path) -> None:
    """Draws the margins of every limit, and the distance from singularity by the least singular value.

    Legs have their colours; of pairs of legs the least margin is drawn. Of a long motion every stretch shows
    its least margin, so that no violation is thinned away.

    Args:
        found: what to draw.
        path: file to write.

    Raises:
        OutputError: it cannot be written, or has another suffix.
    """
    from matplotlib.figure import Figure

    check_suffix(path)
    time, limits = found.motion.time, found.margins.limits
    starts = np.unique(np.linspace(0, len(time) - 1, min(len(time), _STRETCHES)).astype(np.intp))
    with styled():
        number = len(limits) + 1
        figure = Figure(figsize=(8, 0.8 + 1.4 * number), layout="constrained")
        places = figure.subplots(number, 1, sharex=True, squeeze=False)[:, 0]
        for axes, margin in zip(places, limits.values(), strict=False):
            _draw_margin(axes, time[starts], np.minimum.reduceat(margin.margins, starts), margin)
        handles, labels = places[0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, title="leg", loc="outside right upper")
        least = np.minimum.reduceat(np.nan_to_num(found.quality.singular_values[:, -1]), starts)
        places[-1].plot(time[starts], least, color="0.3", lw=1)
        places[-1].set_ylim(bottom=0)
        places[-1].set_ylabel("least singular\nvalue of J")
        for t in found.crossings.time:
            places[-1].axvline(t, color="#D55E00", lw=1)
        places[-1].set_xlabel("time [s]")
        figure.suptitle("margins to the limits: positive inside, negative outside", fontsize=9)
        save(figure, path)


def _draw_margin(axes: Axes, time: Array, margins: Array, margin: Margin) -> None:
    pairs = any("-" in leg for leg in margin.legs)
    if pairs:
        axes.plot(time, margins.min(axis=1), color="0.3", lw=1)
    else:
        for leg, color in enumerate(COLORS):
            axes.plot(time, margins[:, leg], color=color, lw=1, label=str(leg + 1))
    lowest = float(np.nanmin(margins, initial=0.0))
    axes.axhspan(lowest, 0, color="#D55E00", alpha=0.15, lw=0)
    axes.set_ylabel(f"{margin.name}\n{'least pair ' if pairs else ''}[{margin.unit}]")
