"""Real equations in twice float64's precision: unevaluated sums of two numbers.

Dekker, "A floating-point technique for extending the available precision" (1971). Every sum and product of
pairs is right to 2^-102 of its terms' absolute values.
"""

from __future__ import annotations

from sixsps.machine_code import exact_part

ROUNDING = 2.0**-92
"""Bounds the error of `precise_residuals` over the same expressions in absolute values: some hundred
operations, and data that are themselves pairs."""

_SPLIT = 2.0**27 + 1


@exact_part
def two_sum(a, b):  # type: ignore[no-untyped-def]
    """Returns a + b as a pair."""
    total = a + b
    other = total - a
    return total, (a - (total - other)) + (b - other)


@exact_part
def two_product(a, b):  # type: ignore[no-untyped-def]
    """Returns a b as a pair."""
    product = a * b
    c = _SPLIT * a
    high_a = c - (c - a)
    low_a = a - high_a
    c = _SPLIT * b
    high_b = c - (c - b)
    low_b = b - high_b
    return product, ((high_a * high_b - product) + high_a * low_b + low_a * high_b) + low_a * low_b


@exact_part
def add(a, b):  # type: ignore[no-untyped-def]
    """Returns the sum of two pairs."""
    high, low = two_sum(a[0], b[0])
    more, rest = two_sum(a[1], b[1])
    high, low = two_sum(high, low + more)
    return two_sum(high, low + rest)


@exact_part
def times(a, b):  # type: ignore[no-untyped-def]
    """Returns the product of two pairs."""
    high, low = two_product(a[0], b[0])
    return two_sum(high, low + (a[0] * b[1] + a[1] * b[0]))


@exact_part
def leg_residual(high, low, x):  # type: ignore[no-untyped-def]
    """Returns half of v.v - l^2 e.e, for a leg (7,) + (7,) at real coordinates x (8,)."""
    d0, d1, d2 = (high[0], low[0]), (high[1], low[1]), (high[2], low[2])
    m0, m1, m2 = (high[3], low[3]), (high[4], low[4]), (high[5], low[5])
    e0, e1, e2, e3 = (x[0], 0.0), (x[1], 0.0), (x[2], 0.0), (x[3], 0.0)
    n0, n1, n2, n3 = (-x[0], 0.0), (-x[1], 0.0), (-x[2], 0.0), (-x[3], 0.0)
    v0 = add((x[4], 0.0), add(times(d0, e1), add(times(d1, e2), times(d2, e3))))
    v1 = add((x[5], 0.0), add(times(d0, n0), add(times(m1, n3), times(m2, e2))))
    v2 = add((x[6], 0.0), add(times(d1, n0), add(times(m2, n1), times(m0, e3))))
    v3 = add((x[7], 0.0), add(times(d2, n0), add(times(m0, n2), times(m1, e1))))
    total = add(add(times(v0, v0), times(v1, v1)), add(times(v2, v2), times(v3, v3)))
    square = add(add(times(e0, e0), times(e1, e1)), add(times(e2, e2), times(e3, e3)))
    length = (-high[6], -low[6])
    high_part, low_part = add(total, times(length, square))
    return 0.5 * (high_part + low_part)


@exact_part
def precise_residuals(legs, low, patch, x, f):  # type: ignore[no-untyped-def]
    """Sets f (8,) to half the equations at a real x, as `residuals` does, right to ROUNDING.

    Args:
        legs: (6, 7), real parts taken.
        low: (6, 7) what legs lack of the exact data.
        patch: (8,), real parts taken.
        x: (8,), real parts taken.
        f: (8,), out.
    """
    point = x.real
    for i in range(6):
        f[i] = leg_residual(legs[i].real, low[i], point)
    study, gauge = (0.0, 0.0), (-1.0, 0.0)
    for k in range(4):
        study = add(study, two_product(point[k], point[4 + k]))
    for k in range(8):
        gauge = add(gauge, two_product(patch[k].real, point[k]))
    f[6], f[7] = study[0] + study[1], gauge[0] + gauge[1]
