"""Recorded joint motions: which columns they have, what is kept, interpolated and estimated."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from texts import FORMATS, put, row

from compare.payload.joints import Recording, load
from sixsps.errors import MotionError

NAMES = ("shoulder", "elbow", "finger")
SLIDING = np.array([False, False, True])
NUMBERS = ("q1", "q2", "q3")
EPS = np.finfo(float).eps


def curve(time, order=0):
    """Smooth positions (n, 3) or a derivative of them; the finger moves millimetres."""
    rate, size = np.array([1.0, 2.0, 1.5]), np.array([1.0, 0.5, 0.002])
    return size * rate**order * np.sin(np.outer(time, rate) + [0, 1, 2] + order * np.pi / 2)


def table(time, names=NUMBERS, orders=(0,)):
    columns = {"t": time}
    for order in orders:
        columns |= dict(zip([order * "d" + name for name in names], curve(time, order).T, strict=True))
    return columns


def read(path):
    return load(path, NAMES, SLIDING)


def refusal(function, path):
    with pytest.raises(MotionError) as caught:
        function()
    message = str(caught.value)
    assert message.isprintable()
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


TIME = np.linspace(0, 2, 201)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("names", [NUMBERS, NAMES])
def test_given_derivatives_are_used_as_they_are_at_their_own_times(names, form, tmp_path):
    columns = table(TIME, names, (0, 1, 2))
    shuffled = {name: columns[name] for name in sorted(columns, reverse=True)}
    motion = read(put(tmp_path, shuffled, form)).at(TIME)
    for order, values in enumerate((motion.position, motion.velocity, motion.acceleration)):
        assert_array_equal(values, curve(TIME, order))
    assert (motion.name, motion.estimated) == ("path", "")


@pytest.mark.parametrize("given_orders", [(0,), (0, 1), (0, 2)])
def test_missing_derivatives_come_from_a_spline_and_are_told(given_orders, tmp_path):
    motion = read(put(tmp_path, table(TIME, orders=given_orders))).at(TIME)
    inner = slice(20, -20)  # at its ends a spline knows half as much
    for order, values in enumerate((motion.position, motion.velocity, motion.acceleration)):
        if order in given_orders:
            assert_array_equal(values, curve(TIME, order))
        else:
            scale = np.abs(curve(TIME, order)).max(axis=0)
            assert (np.abs(values - curve(TIME, order))[inner] < 1e-3 * scale).all()
    assert motion.estimated.startswith("quintic smoothing spline, cutoff ")
    assert "rad RMS; cutoff " in motion.estimated
    assert motion.estimated.endswith(" m RMS")


@pytest.mark.parametrize(("orders", "error"), [((0,), 1e-3), ((0, 1, 2), 1e-9)])
def test_other_times_are_interpolated(orders, error, tmp_path):
    time = np.linspace(0.3, 1.7, 87)
    motion = read(put(tmp_path, table(TIME, orders=orders))).at(time)
    for order, values in enumerate((motion.position, motion.velocity, motion.acceleration)):
        scale = np.abs(curve(TIME, order)).max(axis=0)
        assert (np.abs(values - curve(time, order)) < error * scale).all()
    assert bool(motion.estimated) == (orders == (0,))


@given(seed=st.integers(0, 10**6))
def test_interpolation_reproduces_polynomials_of_degree_five(seed):
    rng = np.random.default_rng(seed)
    curves = [np.polynomial.Polynomial(c) for c in rng.uniform(-1, 1, (3, 6))]
    time = np.sort(rng.uniform(-1, 1, 5))
    time += np.arange(5) * 0.05
    at = np.sort(rng.uniform(time[0], time[-1], 9))
    given_values = [np.column_stack([c.deriv(order)(time) for c in curves]) for order in range(3)]
    motion = Recording(time, *given_values, SLIDING, Path("joints.csv")).at(at)
    shortest = np.diff(time).min()
    for order, values in enumerate((motion.position, motion.velocity, motion.acceleration)):
        wanted = np.column_stack([c.deriv(order)(at) for c in curves])
        # Values up to 100, whose differences are divided by the step at every differentiation.
        assert_allclose(values, wanted, rtol=0, atol=1e4 * EPS / shortest**order)


def test_interpolation_has_the_samples_values(tmp_path):
    motion = read(put(tmp_path, table(TIME, orders=(0, 1, 2)))).at(TIME[3:9])
    for order, values in enumerate((motion.position, motion.velocity, motion.acceleration)):
        assert_allclose(values, curve(TIME[3:9], order), rtol=0, atol=8 * EPS)


def test_last_time_may_be_missed_by_its_rounding(tmp_path):
    recording = read(put(tmp_path, table(TIME)))
    later = np.array([0.5, np.nextafter(2.0, 3.0)])
    assert_allclose(recording.at(later).position, curve(later), rtol=0, atol=1e-3)


def test_joints_called_like_columns_are_meant_by_name(tmp_path):
    names = ("q3", "q1", "q2")
    recording = load(put(tmp_path, table(TIME, names)), names, SLIDING)
    assert_array_equal(recording.position, curve(TIME))
    shifted = ("q0", "q1", "q2")
    path = put(tmp_path, table(TIME, NUMBERS))
    said = refusal(lambda: load(path, shifted, SLIDING), path)
    assert said.startswith("columns: numbers and names of joints; allowed: only one of them")


class TestRefusals:
    @pytest.mark.parametrize("time", [[-0.1, 1.0], [1.0, 2.0001]])
    def test_times_that_are_not_covered(self, time, tmp_path):
        path = put(tmp_path, table(TIME, orders=(0, 1, 2)))
        said = refusal(lambda: read(path).at(np.array(time)), path)
        assert (
            said == f"t: 0 to 2 s; allowed: the times of the platform's motion, {time[0]:g} to {time[1]:g} s"
        )

    def test_gap_between_positions(self, tmp_path):
        time = np.r_[TIME[:50], TIME[90:]]
        path = put(tmp_path, table(time))
        said = refusal(lambda: read(path).at(TIME), path)
        assert said.startswith("t: no samples from 0.49 to 0.9 s; allowed: ")
        assert read(path).at(time).estimated  # at its own times there is none to be bridged
        full = put(tmp_path, table(time, orders=(0, 1, 2)))
        assert_allclose(read(full).at(TIME).position, curve(TIME), rtol=0, atol=1e-3)

    @pytest.mark.parametrize("order", [1, 2])
    def test_one_of_both_derivatives_at_other_times(self, order, tmp_path):
        path = put(tmp_path, table(TIME, orders=(0, order)))
        said = refusal(lambda: read(path).at(TIME[:-1] + 0.001), path)
        assert said.startswith(
            f"columns: only {('velocities', 'accelerations')[order - 1]}; allowed: both or none"
        )

    @pytest.mark.parametrize("time", [TIME[:3], TIME[:3] + 0.001])
    def test_too_few_samples_to_differentiate(self, time, tmp_path):
        path = put(tmp_path, table(TIME[:5]))
        said = refusal(lambda: read(path).at(time), path)
        assert said.startswith("rows: 5 samples without derivatives; allowed: at least 6 samples")

    @pytest.mark.parametrize("form", FORMATS)
    def test_times_that_do_not_increase(self, form, tmp_path):
        path = put(tmp_path, table(np.array([0.0, 1.0, 1.0, 2.0])), form)
        said = refusal(lambda: read(path), path)
        assert said.startswith(f"t, {row(3, form)}: 1.0 after 1.0; allowed: times that strictly increase")

    CHANGES = (
        ({"t": None}, "column t: missing; allowed: times in seconds"),
        ({"q2": None}, "columns: q2 missing; allowed: all 3 of q1 to q3"),
        ({"dq2": TIME}, "columns: dq1, dq3 missing; allowed: all 3 of dq1 to dq3 or none"),
        (
            {"q4": TIME},
            "column: q4; allowed: t, q1 to q3 or the names of the joints (shoulder, elbow, finger)",
        ),
        ({"wrist": TIME}, "column: wrist; allowed: t, q1 to q3 or the names of the joints"),
        ({"elbow": TIME}, "columns: numbers and names of joints; allowed: only one of them"),
        ({"q1": None, "q2": None, "q3": None}, "columns: no joint positions; allowed: t, q1 to q3 or"),
        ({"q1": np.full(201, np.nan)}, "q1, row 1 (line 2): nan; allowed: a finite number"),
    )

    @pytest.mark.parametrize(("change", "said"), CHANGES)
    def test_columns_that_are_missing_or_too_many(self, change, said, tmp_path):
        columns = {name: values for name, values in (table(TIME) | change).items() if values is not None}
        if len(columns) == 1:
            columns["dq1"] = columns["dq2"] = columns["dq3"] = TIME
        path = put(tmp_path, columns)
        assert refusal(lambda: read(path), path).startswith(said)

    def test_columns_of_a_humanoid_are_not_all_listed(self, tmp_path):
        names = tuple(f"joint_{number}" for number in range(50))
        path = put(tmp_path, {"t": TIME, "arm": TIME})
        said = refusal(lambda: load(path, names, np.zeros(50, dtype=bool)), path)
        assert "q1 to q50 or the names of the joints (joint_0, joint_1, joint_2 and 47 more)" in said

    @pytest.mark.parametrize("names", [("t", "elbow", "finger"), ("x", "dx", "finger"), ("x", "y", "ddx")])
    def test_names_that_could_mean_two_things_are_no_columns(self, names, tmp_path):
        path = put(tmp_path, table(TIME) | {names[-1]: TIME})
        said = refusal(lambda: load(path, names, SLIDING), path)
        assert said.startswith(f"column: {names[-1]}; allowed: t, q1 to q3")
        assert_array_equal(load(put(tmp_path, table(TIME)), names, SLIDING).position, curve(TIME))

    def test_motion_of_a_robot_without_joints(self, tmp_path):
        path = put(tmp_path, {"t": TIME, "q1": TIME})
        said = refusal(lambda: load(path, (), np.zeros(0, dtype=bool)), path)
        assert said.startswith("column: q1; allowed: t, no joint")
