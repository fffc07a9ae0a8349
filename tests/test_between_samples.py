"""Extremes between samples, against the same cubics sampled densely."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from sixsps.between_samples import extremes

NUMBERS = st.floats(-10, 10, allow_subnormal=False)


@given(values=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=2, max_size=6), step=st.floats(1e-3, 10))
@settings(max_examples=200, deadline=None)
def test_no_denser_sampling_goes_beyond(values, step):
    y, rates = np.array(values).T[:, :, None]
    time = step * np.arange(len(y))
    least, largest = extremes(time, y, rates)
    curve = CubicHermiteSpline(time, y[:, 0], rates[:, 0])
    for k in range(len(y) - 1):
        dense = curve(np.linspace(time[k], time[k + 1], 501))
        size = np.abs(y).max() + step * np.abs(rates).max()
        # The curve is flat at an extreme: within half a step of it, by half its curvature.
        rounding = 1e-13 * size + 1e-320  # products of the smallest floats are subnormal
        missed = 8 * size / 1000**2 * 4 + rounding
        assert dense.min() - missed <= least[k, 0] <= dense.min() + rounding
        assert dense.max() - rounding <= largest[k, 0] <= dense.max() + missed


def test_straight_lines_and_parabolas_are_what_they_are():
    time = np.array([0.0, 1.0, 3.0])
    least, largest = extremes(time, 2 * time[:, None], np.full((3, 1), 2.0))
    assert least[:, 0].tolist() == [0, 2]
    assert largest[:, 0].tolist() == [2, 6]
    least, largest = extremes(np.array([-1.0, 2.0]), np.array([[1.0], [4.0]]), np.array([[-2.0], [4.0]]))
    assert least[0, 0] == pytest.approx(0, abs=1e-15)
    assert largest[0, 0] == 4


def test_what_is_missing_stays_missing():
    y = np.array([[1.0], [np.nan], [1.0], [2.0]])
    least, largest = extremes(np.arange(4.0), y, np.zeros((4, 1)))
    assert np.isnan(least[:, 0]).tolist() == [True, True, False]
    assert np.isnan(largest[:, 0]).tolist() == [True, True, False]
