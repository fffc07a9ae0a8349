"""The equations of assembly: six legs and Study's condition, homogeneous in (e, G) = (e, P e).

A leg from A (base) to b (platform) of length l reads v.v = l^2 e.e with the quaternion

    v = P e + e b - A e = G + L e,    L e = (d.e_v, -e_0 d - m x e_v),    d = A - b,  m = A + b,

and P is a vector where e.G = 0 (Wampler, "Forward displacement analysis of general six-in-parallel SPS
(Stewart) platform manipulators using soma coordinates", 1996). Seven quadrics in P^7, and x.patch = 1.
A leg is a row of LEG numbers d, m, l^2; these and l^2 enter linearly, the coordinates quadratically.
"""

from __future__ import annotations

import numpy as np

from sixsps.machine_code import part

LEG = 7
SIZE = 8


@part
def leg_map(leg, x, y, z, w, out):  # type: ignore[no-untyped-def]
    """Sets out (4,) to L e with e = (x, y, z, w)."""
    out[0] = leg[0] * y + leg[1] * z + leg[2] * w
    out[1] = -x * leg[0] - (leg[4] * w - leg[5] * z)
    out[2] = -x * leg[1] - (leg[5] * y - leg[3] * w)
    out[3] = -x * leg[2] - (leg[3] * z - leg[4] * y)


@part
def residuals(legs, patch, x, v, f):  # type: ignore[no-untyped-def]
    """Sets v (6, 4) to the legs' quaternions and f (8,) to half the equations: legs, Study, patch."""
    square = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3]
    for i in range(6):
        leg_map(legs[i], x[0], x[1], x[2], x[3], v[i])
        total = -legs[i, 6] * square
        for k in range(4):
            v[i, k] += x[4 + k]
            total += v[i, k] * v[i, k]
        f[i] = 0.5 * total
    f[6] = x[0] * x[4] + x[1] * x[5] + x[2] * x[6] + x[3] * x[7]
    total = patch[0] * x[0]
    for k in range(1, 8):
        total += patch[k] * x[k]
    f[7] = total - 1.0


@part
def jacobian(legs, patch, x, v, j):  # type: ignore[no-untyped-def]
    """Sets j (8, 8) to the derivative of f at x; v as `residuals` leaves it."""
    for i in range(6):
        # L is antisymmetric
        leg_map(legs[i], v[i, 0], v[i, 1], v[i, 2], v[i, 3], j[i])
        for k in range(4):
            j[i, k] = -j[i, k] - legs[i, 6] * x[k]
            j[i, 4 + k] = v[i, k]
    for k in range(4):
        j[6, k], j[6, 4 + k] = x[4 + k], x[k]
    for k in range(8):
        j[7, k] = patch[k]


@part
def size(z):  # type: ignore[no-untyped-def]
    """Returns a norm of a complex number that takes no root."""
    return abs(z.real) + abs(z.imag)


@part
def factorise(a, pivots):  # type: ignore[no-untyped-def]
    """Replaces a (8, 8) by its LU factors with inverse diagonal; returns whether it is regular."""
    for k in range(8):
        best, row = size(a[k, k]), k
        for i in range(k + 1, 8):
            here = size(a[i, k])
            if here > best:
                best, row = here, i
        pivots[k] = row
        if not best > 0.0:
            return False
        if row != k:
            for j in range(8):
                a[k, j], a[row, j] = a[row, j], a[k, j]
        diagonal = a[k, k]
        inverse = np.conj(diagonal) * (1.0 / (diagonal.real**2 + diagonal.imag**2))
        a[k, k] = inverse
        for i in range(k + 1, 8):
            factor = a[i, k] * inverse
            a[i, k] = factor
            for j in range(k + 1, 8):
                a[i, j] -= factor * a[k, j]
    return True


@part
def solve(a, pivots, b):  # type: ignore[no-untyped-def]
    """Replaces b (8,) by the solution; a and pivots as `factorise` leaves them."""
    for k in range(8):
        row = pivots[k]
        if row != k:
            b[k], b[row] = b[row], b[k]
    for k in range(1, 8):
        total = b[k]
        for j in range(k):
            total -= a[k, j] * b[j]
        b[k] = total
    for k in range(7, -1, -1):
        total = b[k]
        for j in range(k + 1, 8):
            total -= a[k, j] * b[j]
        b[k] = total * a[k, k]


@part
def norm(x):  # type: ignore[no-untyped-def]
    """Returns the Euclidean norm of x (8,)."""
    total = 0.0
    for k in range(8):
        total += x[k].real ** 2 + x[k].imag ** 2
    return np.sqrt(total)
