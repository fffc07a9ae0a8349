"""Proof, in float64, that a solution is where it is said to be, and whether it is real.

Krawczyk's test for T(x) = x - Y f(x) with Y the computed inverse of Df(x0), in the maximum norm of C^8.
As f is quadratic, f(x0 + h) = f(x0) + Df(x0) h + Q(h, h), a ball of radius r about x0 holds exactly one
solution where

    Y0 + Z0 r + Z2 r^2 <= r  and  Z0 + 2 Z2 r < 1,
    Y0 >= |Y f(x0)|,  Z0 >= |1 - Y Df(x0)|,  Z2 >= |Y| sup |Q|.

Every quantity that is computed carries a bound of its rounding, taken from the same expression in
absolute values, and of the data: d and m are differences and sums of anchors that were shifted to their
centre, each of which was rounded. A real ball holds the conjugate of what it holds: what is in it is real.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.assembly.double_double import ROUNDING, precise_residuals
from sixsps.assembly.equations import factorise, jacobian, norm, residuals, solve
from sixsps.assembly.frame import Frame
from sixsps.machine_code import entry, exact_part, part

Complex = NDArray[np.complex128]

UNPROVEN, REAL, NOT_REAL = 0, 1, 2
# Unit roundoffs, generously: a component of v is a sum of four products of d or m, themselves rounded three
# times, with a coordinate; f adds five squares of such; a row of Y Df adds eight complex products.
_UNIT = 2.0**-53
_OF_F = 96 * _UNIT
_OF_JACOBIAN = 64 * _UNIT
_OF_PRODUCT = 64 * _UNIT
# Sums of positive numbers, some hundred roundings deep.
_UP = 1 + 1e-12
# Coordinates of length one with imaginary parts below that are first taken for real ones.
_NEAR_REAL = 1e-4
# Newton's corrections stop shrinking after so many; real solutions are corrected in twice the precision after
# one below that.
_CORRECTIONS, _NEAR = 12, 1e-6


@part
def modulus(z):  # type: ignore[no-untyped-def]
    """Returns |z|."""
    return np.sqrt(z.real * z.real + z.imag * z.imag)


@exact_part
def magnitudes(legs, anchors, x, v, f, j):  # type: ignore[no-untyped-def]
    """Sets v (6, 4), f (8,), j (8, 8) to their expressions in absolute values.

    Args:
        legs: (6, 7).
        anchors: (6, 3) |a| + |b|, which bounds |d| and |m| and, by roundoff, their errors.
        x: (8,) absolute values of the coordinates.
        v: (6, 4), out.
        f: (8,), out.
        j: (8, 8), out.
    """
    square = x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + x[3] ** 2
    for i in range(6):
        p, q, r = anchors[i, 0], anchors[i, 1], anchors[i, 2]
        length = modulus(legs[i, 6])
        v[i, 0] = x[4] + p * x[1] + q * x[2] + r * x[3]
        v[i, 1] = x[5] + p * x[0] + q * x[3] + r * x[2]
        v[i, 2] = x[6] + q * x[0] + r * x[1] + p * x[3]
        v[i, 3] = x[7] + r * x[0] + p * x[2] + q * x[1]
        f[i] = 0.5 * (v[i, 0] ** 2 + v[i, 1] ** 2 + v[i, 2] ** 2 + v[i, 3] ** 2 + length * square)
        j[i, 0] = p * v[i, 1] + q * v[i, 2] + r * v[i, 3] + length * x[0]
        j[i, 1] = p * v[i, 0] + q * v[i, 3] + r * v[i, 2] + length * x[1]
        j[i, 2] = q * v[i, 0] + r * v[i, 1] + p * v[i, 3] + length * x[2]
        j[i, 3] = r * v[i, 0] + p * v[i, 2] + q * v[i, 1] + length * x[3]
        for k in range(4):
            j[i, 4 + k] = v[i, k]
    f[6] = x[0] * x[4] + x[1] * x[5] + x[2] * x[6] + x[3] * x[7]
    f[7] = 1.0
    for k in range(4):
        j[6, k], j[6, 4 + k] = x[4 + k], x[k]


@exact_part
def bounds(legs, anchors, of_f, x, y, f, workspace):  # type: ignore[no-untyped-def]
    """Returns (Y0, Z0, Z2) at x; arguments as of `test`."""
    _, _, j, _, patch, _, sizes, va, fa, ja = workspace
    for k in range(8):
        sizes[k] = modulus(x[k])
    magnitudes(legs, anchors, sizes, va, fa, ja)
    fa[7] = 0.0
    for k in range(8):
        ja[7, k] = modulus(patch[k])
        fa[7] += ja[7, k] * sizes[k]
    fa[7] += 1.0
    y0, z0, z2 = 0.0, 0.0, 0.0
    # the second-order terms, for coordinates of modulus one at most
    for i in range(6):
        reach = 1.0 + anchors[i, 0] + anchors[i, 1] + anchors[i, 2]
        sizes[i] = 2.0 * reach * reach + 2.0 * modulus(legs[i, 6])
    sizes[6], sizes[7] = 4.0, 0.0
    for i in range(8):
        value, error, second, row = 0.0j, 0.0, 0.0, 0.0
        for k in range(8):
            here = modulus(y[i, k])
            value += y[i, k] * f[k]
            error += here * (of_f * fa[k] + _OF_PRODUCT * modulus(f[k]))
            second += here * sizes[k]
        for n in range(8):
            total = -1.0 + 0.0j if i == n else 0.0j
            slack = 1.0 if i == n else 0.0
            for k in range(8):
                total += y[i, k] * j[k, n]
                slack += modulus(y[i, k]) * ja[k, n]
            row += modulus(total) + (_OF_JACOBIAN + _OF_PRODUCT) * slack
        y0 = max(y0, modulus(value) + error)
        z0 = max(z0, row)
        z2 = max(z2, second)
    return y0 * _UP, z0 * _UP, z2 * _UP


@part
def turn(x):  # type: ignore[no-untyped-def]
    """Scales x (8,) to length one with its largest entry positive; returns how far it is from real."""
    largest, where = 0.0, 0
    for k in range(8):
        here = x[k].real ** 2 + x[k].imag ** 2
        if here > largest:
            largest, where = here, k
    factor = np.conj(x[where]) * (1.0 / (np.sqrt(largest) * norm(x)))
    apart = 0.0
    for k in range(8):
        x[k] *= factor
        apart = max(apart, abs(x[k].imag))
    return apart


@exact_part
def inside(x, radius):  # type: ignore[no-untyped-def]
    """Returns whether no pose within the ball is at infinity: e.e is not zero in it."""
    square, slack = 0.0j, 0.0
    for k in range(4):
        square += x[k] * x[k]
        here = modulus(x[k])
        slack += 2.0 * here * radius + radius * radius + 16 * _UNIT * here * here
    return modulus(square) > slack * _UP


@exact_part
def away_from_real(x, radius):  # type: ignore[no-untyped-def]
    """Returns whether no point of the ball is a multiple of a real one."""
    for j in range(8):
        for k in range(j):
            here = abs(x[j].imag * x[k].real - x[j].real * x[k].imag)
            a, b = modulus(x[j]), modulus(x[k])
            if here > ((a + b) * radius + radius * radius + 8 * _UNIT * a * b) * _UP:
                return True
    return False


@exact_part
def test(legs, anchors, of_f, x, y, f, workspace):  # type: ignore[no-untyped-def]
    """Returns the radius of a ball about x (8,) that holds exactly one solution, infinite without proof.

    Args:
        legs: (6, 7).
        anchors: (6, 3) |a| + |b|.
        of_f: bound of f's error over its magnitude.
        x: (8,).
        y: (8, 8) approximate inverse of the derivative.
        f: (8,) the equations at x.
        workspace: arrays; the derivative at x and the patch are taken from it.
    """
    y0, z0, z2 = bounds(legs, anchors, of_f, x, y, f, workspace)
    room = 1.0 - z0
    root = room * room - 4.0 * z2 * y0
    if not (room > 0.0 and root > 0.0):
        return np.inf
    radius = 2.0 * y0 / (room + np.sqrt(root)) * (1 + 1e-6) + 1e-300
    if not (y0 + radius * (z0 + z2 * radius) <= radius and z0 + 2.0 * z2 * radius < 1.0 - 1e-9):
        return np.inf
    return radius


@exact_part
def examine(legs, low, anchors, real, x, y, f, workspace):  # type: ignore[no-untyped-def]
    """Polishes x (8,) by Newton's method; returns the radius of `test`."""
    v, lu, j, pivots, patch, work, _, _, _, _ = workspace
    scale = 1.0 / norm(x) ** 2
    for k in range(8):
        patch[k] = np.conj(x[k]) * scale
    before = 1e300
    precise = False
    for _ in range(_CORRECTIONS):
        if real and not precise and before < _NEAR:
            precise, before = True, 1e300  # what float64 sees as converged may still move
        residuals(legs, patch, x, v, f)
        if precise:
            precise_residuals(legs, low, patch, x, f)
        jacobian(legs, patch, x, v, j)
        for k in range(8):
            work[k] = f[k]
            for n in range(8):
                lu[k, n] = j[k, n]
        if not factorise(lu, pivots):
            return np.inf
        solve(lu, pivots, work)
        change = norm(work)
        if not change < 0.5 * before or change < _UNIT * norm(x):
            if precise or not real:
                break
            before = 0.0
            continue
        before = change
        for k in range(8):
            x[k] -= work[k]
    for n in range(8):
        for k in range(8):
            work[k] = 1.0 if k == n else 0.0
        solve(lu, pivots, work)
        for k in range(8):
            y[k, n] = work[k]
    return test(legs, anchors, ROUNDING if precise else _OF_F, x, y, f, workspace)


@exact_part
def certify_one(legs, low, anchors, near_real, x, y, f, facts, workspace):  # type: ignore[no-untyped-def]
    """Returns UNPROVEN, REAL or NOT_REAL for x (8,); see `certify`."""
    real = turn(x) < near_real
    for _ in range(2):
        if real:
            for k in range(8):
                x[k] = x[k].real
        radius = examine(legs, low, anchors, real, x, y, f, workspace)
        facts[0] = radius
        if not radius < np.inf:
            return UNPROVEN
        facts[1] = 1.0 if inside(x, radius) else 0.0
        if real:
            return REAL
        if away_from_real(x, radius):
            return NOT_REAL
        if near_real < 0.0:
            return UNPROVEN
        # it may be real: the real ball decides
        turn(x)
        real = True
    return UNPROVEN


@entry(
    "void(complex128[:, ::1], float64[:, ::1], float64[:, ::1], float64, complex128[:, ::1], int64[::1],"
    " float64[:, ::1])",
    "assembly",
    exact=True,
)
def certify(legs, low, anchors, near_real, x, kinds, facts):  # type: ignore[no-untyped-def]
    """Polishes the solutions x and proves what can be proven of them.

    Args:
        legs: (6, 7) d, m, l^2 of the legs; l^2 may be complex.
        low: (6, 7) what legs lack of the exact data, where they are real.
        anchors: (6, 3) |a| + |b|.
        near_real: imaginary part up to which a solution is first taken for real; negative where none is.
        x: (n, 8) solutions; polished in place, real where they are.
        kinds: (n,) UNPROVEN, REAL or NOT_REAL, out.
        facts: (n, 2) out: radius of the ball that holds exactly one solution, infinite without proof, and
            whether it is proven to be a pose that is not at infinity.
    """
    v, f, work = np.zeros((6, 4), np.complex128), np.zeros(8, np.complex128), np.zeros(8, np.complex128)
    lu, y = np.zeros((8, 8), np.complex128), np.zeros((8, 8), np.complex128)
    j, patch = np.zeros((8, 8), np.complex128), np.zeros(8, np.complex128)
    sizes, va, fa, ja = np.zeros(8), np.zeros((6, 4)), np.zeros(8), np.zeros((8, 8))
    workspace = (v, lu, j, np.zeros(8, np.int64), patch, work, sizes, va, fa, ja)
    for n in range(len(x)):
        facts[n, 0], facts[n, 1] = np.inf, 0.0
        kinds[n] = certify_one(legs, low, anchors, near_real, x[n], y, f, facts[n], workspace)


def certified(frame: Frame, legs: Complex, x: Complex) -> tuple[NDArray[np.int64], Array]:
    """Returns kinds (n,) and radii (n,) of solutions x (n, 8), polished in place; UNPROVEN where at infinity.

    Args:
        frame: of the mechanism.
        legs: (6, 7) in it, with these or with complex lengths.
        x: (n, 8).
    """
    kinds, facts = np.zeros(len(x), np.int64), np.zeros((len(x), 2))
    near_real = -1.0 if legs[:, 6].imag.any() else _NEAR_REAL
    certify(legs, frame.low, frame.reach, near_real, x, kinds, facts)
    kinds[facts[:, 1] == 0] = UNPROVEN
    return kinds, np.ascontiguousarray(facts[:, 0])


@entry("boolean(complex128[:, ::1], float64[::1], boolean[::1])", "assembly", exact=True)
def all_distinct(x, radii, doubles):  # type: ignore[no-untyped-def]
    """Marks the solutions whose ball may hold one that came before; returns whether there are none.

    Two lines in C^8 make an angle of sine^2 = sum |x_j y_k - x_k y_j|^2 / (|x|^2 |y|^2), and one within a
    ball makes at most asin(sqrt(8) r / |x|) with its centre.

    Args:
        x: (n, 8) centres.
        radii: (n,) of balls in the maximum norm; infinite where there is no proof.
        doubles: (n,) out.
    """
    distinct = True
    for n in range(len(x)):
        doubles[n] = False
        length = norm(x[n])
        for m in range(n):
            other = norm(x[m])
            apart = 0.0
            near = 4.0 * (radii[n] / length + radii[m] / other) + 1e-14
            for j in range(8):
                for k in range(j):
                    minor = x[n, j] * x[m, k] - x[n, k] * x[m, j]
                    apart += minor.real**2 + minor.imag**2
                if apart > (near * length * other) ** 2:
                    break
            if not apart > (near * length * other) ** 2:
                doubles[n] = True
                distinct = False
                break
    return distinct
