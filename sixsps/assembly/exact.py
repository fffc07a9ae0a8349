"""Proof in ball arithmetic, for solutions too close to singular for float64.

The float64 anchors and lengths are taken as exact. Newton's method at high precision, then Krawczyk's test.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import acb, acb_mat, arb, ctx

from sixsps.assembly.frame import Frame
from sixsps.assembly.start_systems import Complex

_BITS = 320
# Newton's method halves the distance to a pair of solutions until it sees them apart. Rounded data set a
# double solution 2^-27 apart, those of higher multiplicity further.
_CORRECTIONS = 60
_CONVERGED = 2.0**-240
# Real solutions have imaginary parts of that size, others have none below it that Krawczyk could prove.
_REAL = 2.0**-200
_UNIT = 2.0**-52


@dataclass(frozen=True, eq=False)
class Exact:
    """A solution that is proven to exist.

    Attributes:
        x: (8,) nearest float64 coordinates.
        radius: of the ball about x, in the maximum norm, that holds the solution.
        real: whether it is proven to be real; otherwise it is proven not to be.
        finite: whether it is proven to be a pose that is not at infinity.
    """

    x: Complex
    radius: float
    real: bool
    finite: bool


def prove(base: Any, platform: Any, lengths: Any, frame: Frame, x: Complex) -> Exact | None:
    """Returns the solution near x, or None where Newton's method or the proof fails.

    Args:
        base: (6, 3) base anchors [m].
        platform: (6, 3) platform anchors [m].
        lengths: (6,) leg lengths [m].
        frame: the coordinates of x.
        x: (8,) approximate solution.
    """
    with _precision():
        legs = _legs(base, platform, lengths, frame)
        gauge = np.conj(x) / np.linalg.norm(x) ** 2
        patch = [acb(*pair) for pair in zip(gauge.real.tolist(), gauge.imag.tolist(), strict=True)]
        point = _newton(legs, patch, _column(x))
        if point is None:
            return None
        turned = _turned(point)
        if max(float(abs(entry.imag).upper()) for entry in turned.entries()) < _REAL:
            real = acb_mat(8, 1, [acb(entry.real.mid()) for entry in turned.entries()])
            norm = sum((entry.real**2 for entry in real.entries()), arb(0))
            patch = [acb((entry.real / norm).mid()) for entry in real.entries()]
            return _proof(legs, patch, real, real=True)
        return _proof(legs, patch, point, real=False)


@contextmanager
def _precision() -> Iterator[None]:
    before, ctx.prec = ctx.prec, _BITS
    try:
        yield
    finally:
        ctx.prec = before


def _legs(base: Any, platform: Any, lengths: Any, frame: Frame) -> list[tuple[Any, Any]]:
    """Returns (L, l^2) of the legs in the frame, whose centres and unit are exact."""
    scale = arb(frame.scale)

    def moved(anchor: Any, centre: Any) -> list[Any]:
        pairs = zip(anchor.tolist(), centre.tolist(), strict=True)
        return [(arb(one) - arb(other)) / scale for one, other in pairs]

    legs = []
    for a, b, length in zip(np.asarray(base), np.asarray(platform), np.asarray(lengths), strict=True):
        near, far = moved(a, frame.base_centre), moved(b, frame.platform_centre)
        d = [p - q for p, q in zip(near, far, strict=True)]
        m = [p + q for p, q in zip(near, far, strict=True)]
        rows = [
            [0, d[0], d[1], d[2]],
            [-d[0], 0, m[2], -m[1]],
            [-d[1], -m[2], 0, m[0]],
            [-d[2], m[1], -m[0], 0],
        ]
        legs.append(
            (acb_mat(4, 4, [acb(entry) for row in rows for entry in row]), (arb(length) / scale) ** 2)
        )
    return legs


def _column(x: Complex) -> Any:
    return acb_mat(8, 1, [acb(value.real, value.imag) for value in x.tolist()])


def _values(legs: Any, patch: Any, x: Any) -> tuple[Any, Any]:
    """Returns the equations (8, 1) and their derivative (8, 8) at x, balls or points."""
    e = acb_mat(4, 1, x.entries()[:4])
    g = acb_mat(4, 1, x.entries()[4:])
    square = (e.transpose() * e)[0, 0]
    values, rows = [], []
    for turn, length in legs:
        v = g + turn * e
        values.append(((v.transpose() * v)[0, 0] - length * square) / 2)
        rows += (turn.transpose() * v - e * acb(length)).entries() + v.entries()
    values.append((e.transpose() * g)[0, 0])
    rows += g.entries() + e.entries()
    values.append(sum((p * entry for p, entry in zip(patch, x.entries(), strict=True)), acb(-1)))
    return acb_mat(8, 1, values), acb_mat(8, 8, rows + patch)


def _middle(matrix: Any) -> Any:
    return acb_mat(matrix.nrows(), matrix.ncols(), [entry.mid() for entry in matrix.entries()])


def _newton(legs: Any, patch: Any, x: Any) -> Any:
    for _ in range(_CORRECTIONS):
        f, j = _values(legs, patch, x)
        try:
            change = _middle(j.solve(f))
        except ZeroDivisionError:  # singular as far as the precision sees
            return None
        x = _middle(x - change)
        largest = _largest(change)
        if not largest < 1e6:
            return None
        if largest < _CONVERGED:
            return x
    return None


def _largest(matrix: Any) -> float:
    return max(float(abs(entry).upper()) for entry in matrix.entries())


def _turned(x: Any) -> Any:
    """Returns x such that the largest entry is positive and the length is one."""
    entries = x.entries()
    largest = max(entries, key=lambda entry: float(abs(entry).mid()))
    norm = sum((abs(entry) ** 2 for entry in entries), arb(0)).sqrt()
    return x * (largest.conjugate() / abs(largest) / norm)


def _proof(legs: Any, patch: Any, x: Any, real: bool) -> Exact | None:
    f, j = _values(legs, patch, x)
    try:
        inverse = _middle(j.inv())
    except ZeroDivisionError:
        return None
    newton = inverse * f
    radius = arb(max(2 * _largest(newton), 2.0**-300))
    ball = acb(arb(0, radius.upper()), arb(0) if real else arb(0, radius.upper()))
    box = acb_mat(8, 1, [entry + ball for entry in x.entries()])
    one = acb_mat(8, 8, [acb(int(k % 9 == 0)) for k in range(64)])
    _, wide = _values(legs, patch, box)
    image = (one - inverse * wide) * acb_mat(8, 1, [ball] * 8) - newton
    if not _largest(image) < float(radius.lower()):
        return None
    nearest = np.array([complex(entry.mid()) for entry in x.entries()])
    reach = float(radius.upper()) + _UNIT * float(np.abs(nearest).max())
    e = box.entries()[:4]
    finite = not sum((entry * entry for entry in e), acb(0)).contains(0)
    if not real and not _away_from_real(box.entries()):
        return None
    return Exact(nearest, reach, real, finite)


def _away_from_real(x: Any) -> bool:
    pairs = ((x[j] * x[k].conjugate()).imag for j in range(8) for k in range(j))
    return any(not imaginary.contains(0) for imaginary in pairs)
