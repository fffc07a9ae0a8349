"""The other solution of a pair that lies close together, where paths came to one of them or to neither.

Along the null direction v of the derivative at x, with its left null vector u, the equations f are

    u* f(x + d + t v) = c + s t + q t^2,    q = u* f(v),

as f is quadratic and homogeneous; d takes the other directions to their solution. The roots t are where the
two solutions of a pair are to be looked for, whatever x was: one of them, or a point of a path that stalled.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sixsps.assembly.continua import System
from sixsps.assembly.start_systems import Complex

# Smallest singular value over the largest of a solution that may have a partner: the pair is then about so
# far apart, and float64 follows paths to pairs that are further apart without trouble.
_PAIRED = 1e-2
# The middle between the roots is found to third order in their distance: a correction or two.
_CENTRINGS = 3
# Where float64 does not see the roots apart, Newton's method starts about their middle: it halves the
# distance and keeps the side. Rounding sets a double solution 2^-27 apart.
_SIZES = (1e-7, 1e-5, 1e-3)
_PHASES = (1, -1, 1j, -1j)


def paired(system: System, x: Complex) -> bool:
    """Returns whether the derivative at x (8,), of length one, has a small singular value."""
    sizes = np.linalg.svd(system.values(x)[1], compute_uv=False)
    return bool(sizes[-1] < _PAIRED * sizes[0])


def candidates(system: System, x: Complex) -> Iterator[Complex]:
    """Yields places (8,) where Newton's method may find either solution of the pair next to x.

    Args:
        system: the equations.
        x: (8,) of length one, near a double solution.
    """
    x = np.asarray(x, np.complex128)
    for _ in range(_CENTRINGS):
        point, v, roots = _model(system, x)
        middle = point + roots.mean() * v
        if not np.isfinite(middle).all():
            return
        yield from (point + root * v for root in roots)
        x = middle / np.linalg.norm(middle)
    for size in _SIZES:
        yield from (x + size * phase * v for phase in _PHASES)


def _model(system: System, x: Complex) -> tuple[Complex, Complex, Complex]:
    """Returns x + d (8,), v (8,) and the two roots t."""
    values, rows = system.values(x)
    left, sizes, right = np.linalg.svd(np.vstack([rows, x.conj()]))
    keep = slice(0, 7)
    d = -right[keep].conj().T @ ((left[:7, keep].conj().T @ values) / sizes[keep])
    point, v, u = x + d, right[7].conj(), left[:7, 7].conj()
    there, slopes = system.values(point)
    c, s, q = u @ there, u @ (slopes @ v), u @ system.values(v)[0]
    with np.errstate(all="ignore"):
        half = np.sqrt(s * s - 4 * q * c)
        return point, v, np.array([(-s + half) / (2 * q), (-s - half) / (2 * q)])
