"""Where paths end that do not end at a regular pose: Cauchy's integral around the end of the line.

About s = 1 the coordinates are a power series in (1 - s)^(1/w), with the winding number w. After w turns
around s = 1 a path is back where it was, and the mean over the turns is where it ends (Morgan, Sommese &
Wampler, "A power series method for computing singular solutions to nonlinear analytic systems", 1992).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sixsps.assembly.continua import System
from sixsps.assembly.paths import Settings, follow
from sixsps.assembly.start_systems import Complex

# Other ways from the start to the mechanism: places off the straight line, of which it is 0 and 1.
DETOURS = (0.5 + 0.4j, 0.5 - 0.4j, 0.4 + 0.8j, 0.6 - 0.8j)
CAREFUL = Settings(tolerance=1e-5, contraction=0.01, least_step=1e-10, most_steps=2000)
# Radii about s = 1, the next where the one before holds other branch points or brings no answer.
_RADII = (1e-3, 1e-5, 1e-7)
_CORNERS = 16
_RESIDUAL = 1e-9
_MOST_TURNS = 10
# 1 - cosine between the lines in C^8 of two points that are the same.
SAME = 1e-11
# sqrt|e.e| of coordinates of length one that are those of no pose.
_NOTHING = 1e-5


@dataclass(frozen=True, eq=False)
class End:
    """Where a path ends.

    Attributes:
        x: (8,) coordinates there, of length one.
        near: (8,) a point of the path shortly before.
        winding: number of turns after which it closes.
    """

    x: Complex
    near: Complex
    winding: int

    @property
    def infinite(self) -> bool:
        """Whether the coordinates are those of no pose."""
        e = self.x[:4]
        return bool(abs(e @ e) < _NOTHING**2)


def ends(start: Complex, end: Complex, solutions: Complex) -> list[End | None]:
    """Returns where paths end, None where that could not be found out.

    Args:
        start: (6, 7) legs of which the solutions are.
        end: (6, 7) legs.
        solutions: (n, 8).
    """
    found: list[End | None] = [None] * len(solutions)
    for radius in _RADII:
        missing = [k for k, one in enumerate(found) if one is None]
        if not missing:
            break
        for k, one in zip(missing, _around(start, end, solutions[missing], radius), strict=True):
            found[k] = one
    return found


def _around(start: Complex, end: Complex, solutions: Complex, radius: float) -> list[End | None]:
    system = System.of(end)
    angles = 2 * np.pi * np.arange(_CORNERS + 1) / _CORNERS
    corners = [end + radius * np.exp(1j * angle) * (start - end) for angle in angles]
    paths = follow(start, corners[0], solutions, CAREFUL)
    found: list[End | None] = [None] * len(solutions)
    active = np.flatnonzero(paths.arrived)
    first = _unit(paths.ends)
    now, total = first.copy(), np.zeros_like(first)
    for turns in range(1, _MOST_TURNS + 1):
        for one, other in pairwise(corners):
            if not len(active):
                return found
            paths = follow(one, other, now[active], CAREFUL)
            active = active[paths.arrived]
            now[active] = _unit(paths.ends[paths.arrived])
            total[active] += now[active] / _overlap(first[active], now[active])[:, None]
        closed = np.abs(_overlap(first[active], now[active])) > 1 - SAME
        for k in active[closed]:
            x = _unit(total[k : k + 1])[0]
            # where other branch points lie within the radius, the mean is no solution
            if np.abs(system.values(x)[0]).max() < _RESIDUAL:
                found[k] = End(x, first[k], turns)
        active = active[~closed]
    return found


def _unit(x: Complex) -> Complex:
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def _overlap(x: Complex, y: Complex) -> NDArray[np.complex128]:
    return np.sum(x.conj() * y, axis=-1)
