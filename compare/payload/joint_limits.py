"""Whether a robot's joints leave the limits of its description; told, and never a change of what they do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array

# Recorded positions and limits are written in decimals.
_ROUNDING = 1e-4
_SHOWN = 3


def told(
    time: Array, position: Array, limits: Array, names: Sequence[str], sliding: NDArray[np.bool_]
) -> tuple[str, ...]:
    """Returns a line that says which joints leave their limits, when furthest and where to; else nothing.

    Args:
        time: (n,) [s].
        position: (n, k) of the joints [rad, m].
        limits: (k, 2) least and largest positions.
        names: of the joints.
        sliding: (k,) bool, which of them slide.
    """
    outside = np.maximum(limits[:, 0] - position, position - limits[:, 1])
    leaving = np.flatnonzero(outside.max(axis=0) > _ROUNDING)
    if not len(leaving):
        return ()
    lines = []
    for joint in leaving[:_SHOWN]:
        sample, unit = int(np.argmax(outside[:, joint])), "m" if sliding[joint] else "rad"
        low, high = limits[joint]
        lines.append(
            f"{names[joint]} to {position[sample, joint]:.4g} {unit} at t = {time[sample]:g} s "
            f"({low:.4g} to {high:.4g})"
        )
    others = len(leaving) - _SHOWN
    more = f" and {others} more" if others > 0 else ""
    return (f"joints leave their limits: {'; '.join(lines)}{more}",)
