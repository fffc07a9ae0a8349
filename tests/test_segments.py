"""The distance of two segments, against exact arithmetic, another solver and dense sampling."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from sixsps.segments import segment_distances

UNIT = np.finfo(float).eps
# Whole numbers meet on purpose: crossing, touching, parallel, collinear and degenerate segments.
WHOLE = st.lists(st.integers(-3, 3), min_size=12, max_size=12).map(np.array)
# Products of four lengths have to stay above the smallest floats: nothing shorter than 1e-30.
NUMBER = st.floats(-1, 1).map(lambda number: number if abs(number) > 1e-30 else 0.0)
REAL = st.lists(NUMBER, min_size=12, max_size=12).map(np.array)


def parts(numbers):
    return np.asarray(numbers, dtype=float).reshape(4, 3)


def exact(a, u, b, v):
    """The distance by rational arithmetic: the least over all 9 kinds of where the two points may lie."""
    a, u, b, v = ([Fraction(float(x)) for x in vector] for vector in (a, u, b, v))

    def dot(x, y):
        return sum(p * q for p, q in zip(x, y, strict=True))

    r = [q - p for p, q in zip(a, b, strict=True)]
    uu, uv, vv, ru, rv = dot(u, u), dot(u, v), dot(v, v), dot(r, u), dot(r, v)
    best = None
    for first, second in product((None, 0, 1), repeat=2):
        s, t = (None if end is None else Fraction(end) for end in (first, second))
        if s is None and t is None:
            determinant = uu * vv - uv * uv
            if not determinant:
                continue
            s, t = (ru * vv - rv * uv) / determinant, (ru * uv - rv * uu) / determinant
        elif s is None:
            if not uu:
                continue
            s = (ru + t * uv) / uu
        elif t is None:
            if not vv:
                continue
            t = (s * uv - rv) / vv
        if 0 <= s <= 1 and 0 <= t <= 1:
            gap = [k + t * y - s * x for k, x, y in zip(r, u, v, strict=True)]
            square = dot(gap, gap)
            best = square if best is None else min(best, square)
    return float(best) ** 0.5


def tolerance(a, u, b, v):
    """Coordinates of a gap round by some units; where it is large its square rounds as well."""
    return 50 * UNIT * max(np.abs(x).max() for x in (a, u, b, v))


@given(numbers=st.one_of(WHOLE, REAL))
@settings(max_examples=500, deadline=None)
def test_is_exact_to_rounding(numbers):
    a, u, b, v = parts(numbers)
    assert segment_distances(a, u, b, v) == pytest.approx(
        exact(a, u, b, v), rel=1e-14, abs=tolerance(a, u, b, v)
    )


@given(
    numbers=REAL, angle=st.sampled_from([1e-16, 1e-12, 1e-9, 1e-8, 1e-7, 1e-5, 1e-3]), gap=st.floats(0, 1e-6)
)
@settings(max_examples=300, deadline=None)
def test_is_exact_where_segments_are_nearly_parallel(numbers, angle, gap):
    """And cross or nearly do, where the determinant of the usual formula has lost all its digits."""
    a, u, b, v = parts(numbers)
    v = u + angle * v
    b = a + 0.4 * u - 0.6 * v + gap * b
    assert segment_distances(a, u, b, v) == pytest.approx(
        exact(a, u, b, v), rel=1e-14, abs=tolerance(a, u, b, v)
    )


@given(numbers=REAL)
@settings(max_examples=50, deadline=None)
def test_agrees_with_a_solver_and_with_dense_sampling(numbers):
    a, u, b, v = parts(numbers)
    found = float(segment_distances(a, u, b, v))
    solved = lsq_linear(np.column_stack([u, -v]), b - a, bounds=(0, 1), tol=1e-12)
    assert found == pytest.approx(np.sqrt(2 * solved.cost), abs=1e-5)  # of a first-order method
    assert found <= np.sqrt(2 * solved.cost) + 1e-12
    tau = np.linspace(0, 1, 201)[:, None]
    sampled = np.linalg.norm((a + tau * u)[:, None] - (b + tau * v), axis=2).min()
    step = (np.linalg.norm(u) + np.linalg.norm(v)) / 400
    assert sampled - step - 1e-15 <= found <= sampled + 1e-15


@given(numbers=REAL, seed=st.integers(0, 99), scale=st.sampled_from([1e-30, 1e-3, 1e3, 1e40]))
@settings(max_examples=100, deadline=None)
def test_order_direction_and_units_do_not_matter(numbers, seed, scale):
    a, u, b, v = parts(numbers)
    found = segment_distances(a, u, b, v)
    for other in ((b, v, a, u), (a + u, -u, b, v), (a, u, b + v, -v)):
        assert segment_distances(*other) == pytest.approx(found, rel=1e-13, abs=4 * tolerance(*other))
    bigger = segment_distances(*(scale * part for part in (a, u, b, v)))
    assert bigger == pytest.approx(scale * found, rel=1e-13, abs=4 * scale * tolerance(a, u, b, v))


def test_many_at_once_are_each_by_itself():
    rng = np.random.default_rng(1)
    a, u, b, v = rng.standard_normal((4, 7, 5, 3))
    u[0], v[1], u[2] = 0.0, 0.0, v[2]
    found = segment_distances(a, u, b, v)
    one_by_one = [
        segment_distances(*(part[i, j] for part in (a, u, b, v))) for i in range(7) for j in range(5)
    ]
    assert found.tolist() == np.reshape(one_by_one, (7, 5)).tolist()
