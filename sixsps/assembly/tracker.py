"""Paths of solutions while the legs change on a straight line, as power series and Newton's corrections.

Along the line the coordinates x(s + h) are a power series in h, whose coefficients cost one solution
of a linear system each, as the equations are quadratic. Its last terms say how far it may be trusted
(as in Telen, Van Barel & Verschelde, "A robust numerical path tracking algorithm for polynomial homotopy
continuation", 2020); Newton's method must then contract at once, or the step is halved.
"""

from __future__ import annotations

import numpy as np

from sixsps.assembly.equations import LEG, SIZE, factorise, jacobian, leg_map, norm, residuals, solve
from sixsps.machine_code import entry, part, section

ARRIVED, STALLED, LOST = 0, 1, 2
ORDER = 8
"""Of the series."""

# Corrections: one larger than this is no correction, one below that needs no new derivative after it, and one
# below that is rounding, whose own corrections need not contract.
_LARGEST, _SMALL, _ROUNDING = 0.1, 1e-5, 1e-9


@part
def square(e):  # type: ignore[no-untyped-def]
    """Returns e.e of the quaternion in the first four numbers."""
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]


@section
def known_terms(legs, slopes, moving, x, v, c, k):  # type: ignore[no-untyped-def]
    """Sets x[k] to minus what lower coefficients contribute to the equations of order k.

    Returns the part of the coefficient of e.e that lower ones contribute.
    """
    ee, eg = 0.0j, 0.0j
    for j in range(1, k):
        for n in range(4):
            ee += x[j, n] * x[k - j, n]
            eg += x[j, n] * x[k - j, 4 + n]
    for i in range(6):
        total = 0.0j
        for j in range(1, (k - 1) // 2 + 1):
            for n in range(4):
                total += v[j, i, n] * v[k - j, i, n]
        total += total  # a sum of pairs of equal products, and the middle
        if k % 2 == 0:
            for n in range(4):
                total += v[k // 2, i, n] * v[k // 2, i, n]
        total = 0.5 * (total - legs[i, 6] * ee - slopes[i, 6] * c[k - 1])
        if moving:
            before = x[k - 1]
            leg_map(slopes[i], before[0], before[1], before[2], before[3], v[k, i])
            for n in range(4):
                total += v[0, i, n] * v[k, i, n]
        x[k, i] = -total
    x[k, 6] = -eg
    x[k, 7] = 0.0
    return ee


@section
def series(legs, slopes, moving, lu, pivots, x, v, c, work):  # type: ignore[no-untyped-def]
    """Fills x[1:] and v[1:], the coefficients of the path through x[0] with quaternions v[0].

    Args:
        legs: (6, 7) at this place.
        slopes: (6, 7) their derivatives along the line.
        moving: whether any but the lengths change.
        lu: (8, 8) factors of the derivative at x[0].
        pivots: (8,).
        x: (ORDER + 1, 8).
        v: (ORDER + 1, 6, 4).
        c: (ORDER + 1,) for e.e.
        work: (4,).
    """
    c[0] = square(x[0])
    for k in range(1, ORDER + 1):
        ee = known_terms(legs, slopes, moving, x, v, c, k)
        row = x[k]
        solve(lu, pivots, row)
        for n in range(4):
            ee += 2.0 * x[0, n] * row[n]
        c[k] = ee
        for i in range(6):
            leg_map(legs[i], row[0], row[1], row[2], row[3], work)
            for n in range(4):
                work[n] += row[4 + n]
                v[k, i, n] = v[k, i, n] + work[n] if moving else work[n]


@section
def reach(x, tolerance):  # type: ignore[no-untyped-def]
    """Returns how far the series may be followed: its last terms stay below tolerance."""
    first = norm(x[0]) * tolerance
    far = 1e300
    for k in range(ORDER - 1, ORDER + 1):
        size = norm(x[k])
        if size > 0.0:
            far = min(far, (first / size) ** (1.0 / k))
    return far


@section
def correct(legs, patch, y, contraction, v, f, lu, pivots):  # type: ignore[no-untyped-def]
    """Moves y (8,) to the path by two corrections; returns whether they contract as on the path."""
    scale = 1.0 / norm(y)
    for k in range(SIZE):
        y[k] *= scale
        patch[k] = np.conj(y[k])
    first, second = 0.0, 0.0
    for again in range(2):
        residuals(legs, patch, y, v, f)
        if again == 0 or first > _SMALL:
            jacobian(legs, patch, y, v, lu)
            if not factorise(lu, pivots):
                return False
        solve(lu, pivots, f)
        second = norm(f)
        if again == 0:
            first = second
        if not second < _LARGEST:
            return False
        for k in range(SIZE):
            y[k] -= f[k]
    return second <= contraction * first or first < _ROUNDING


@section
def advance(x, h, y):  # type: ignore[no-untyped-def]
    """Sets y (8,) to the series at h."""
    for k in range(SIZE):
        y[k] = x[ORDER, k]
    for n in range(ORDER - 1, -1, -1):
        for k in range(SIZE):
            y[k] = y[k] * h + x[n, k]


@section
def track(start, slopes, moving, settings, workspace):  # type: ignore[no-untyped-def]
    """Follows x[0] from s = 0 to s = 1; returns (status, s, steps) and leaves x[0] where it ended."""
    tolerance, contraction, least, most = settings
    x, v, c, legs, lu, pivots, patch, y, f, work = workspace
    origin, s, h, steps = 0.0, 0.0, 0.0, 0
    for k in range(SIZE):
        y[k] = x[0, k]
    while True:
        for i in range(6):
            for k in range(LEG):
                legs[i, k] = start[i, k] + s * slopes[i, k]
        if correct(legs, patch, y, contraction, v[0], f, lu, pivots):
            for k in range(SIZE):
                x[0, k] = y[k]
            origin = s
            if s >= 1.0:
                return ARRIVED, origin, steps
            series(legs, slopes, moving, lu, pivots, x, v, c, work)
            h = reach(x, tolerance)
        else:
            h *= 0.5  # the series of the last place is still there
        if not h >= least:
            return STALLED, origin, steps
        steps += 1
        if steps > most:
            return LOST, origin, steps
        s = origin + h
        if s >= 1.0:
            s, h = 1.0, 1.0 - origin
        advance(x, h, y)


@section
def track_range(start, end, solutions, first, last, settings, out, facts, places):  # type: ignore[no-untyped-def]
    """Follows the solutions first..last, as `track_paths`."""
    x = np.zeros((ORDER + 1, SIZE), np.complex128)
    v = np.zeros((ORDER + 1, 6, 4), np.complex128)
    c, work = np.zeros(ORDER + 1, np.complex128), np.zeros(4, np.complex128)
    legs, lu = np.zeros((6, LEG), np.complex128), np.zeros((SIZE, SIZE), np.complex128)
    pivots, patch = np.zeros(SIZE, np.int64), np.zeros(SIZE, np.complex128)
    y, f = np.zeros(SIZE, np.complex128), np.zeros(SIZE, np.complex128)
    workspace = (x, v, c, legs, lu, pivots, patch, y, f, work)
    slopes = end - start
    moving = False
    for i in range(6):
        for k in range(6):
            moving = moving or slopes[i, k] != 0.0
    for n in range(first, last):
        for k in range(SIZE):
            x[0, k] = solutions[n, k]
        status, place, steps = track(start, slopes, moving, settings, workspace)
        for k in range(SIZE):
            out[n, k] = x[0, k]
        facts[n, 0], facts[n, 1], places[n] = status, steps, place


@entry(
    "void(complex128[:, ::1], complex128[:, ::1], complex128[:, ::1], intp, intp,"
    " UniTuple(float64, 4), complex128[:, ::1], int64[:, ::1], float64[::1])",
    "assembly",
)
def track_paths(start, end, solutions, first, last, settings, out, facts, places):  # type: ignore[no-untyped-def]
    """Follows the solutions first..last from one mechanism to another.

    Args:
        start: (6, 7) legs at s = 0.
        end: (6, 7) legs at s = 1.
        solutions: (n, 8) at s = 0.
        first: number of the first path to follow.
        last: number after the last.
        settings: tolerance, contraction, least step, most steps.
        out: (n, 8) coordinates where each ended.
        facts: (n, 2) status and number of steps.
        places: (n,) s where each ended.
    """
    track_range(start, end, solutions, first, last, settings, out, facts, places)
