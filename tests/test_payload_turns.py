"""Recorded angles that jump by whole turns: undone where a joint turns without end, else refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from texts import put

from compare.payload.joint_limits import told
from compare.payload.joints import load
from sixsps.errors import MotionError

NAMES = ("wheel", "slide")
SLIDING, ENDLESS = np.array([False, True]), np.array([True, False])
BOUNDED = np.array([False, False])
TIME = np.linspace(0, 2, 201)
EPS = np.finfo(float).eps


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def recording(folder, angle, rate=None, endless=ENDLESS, time=TIME):
    columns = {"t": time, "q1": angle, "q2": 10 * time}
    if rate is not None:
        columns |= {"dq1": rate, "dq2": np.full(len(time), 10.0)}
    return load(put(folder, columns), NAMES, SLIDING, endless)


@pytest.mark.parametrize("rate", [3.0, -20.0])
def test_wrapped_angles_are_those_that_were_not(rate, tmp_path):
    angle = rate * TIME + 2
    found, given = recording(tmp_path, wrapped(angle)), recording(tmp_path, angle)
    turns = (found.position[:, 0] - angle) / (2 * np.pi)
    assert_allclose(turns, np.round(turns[0]), rtol=0, atol=100 * EPS)
    assert_array_equal(found.position[:, 1], given.position[:, 1])
    for name in ("velocity", "acceleration"):
        wanted = getattr(given.at(TIME), name)
        # Second differences at 0.01 s of numbers up to 40 with unit roundoff.
        assert_allclose(getattr(found.at(TIME), name), wanted, rtol=0, atol=1e-8)
    assert found.at(TIME).warnings == ("recorded angles jump by whole turns, which were added: q1",)
    assert given.at(TIME).warnings == ()


def test_velocities_say_which_turn_an_angle_is_on(tmp_path):
    """Steps of four radians: alone they could as well be one turn less."""
    time = np.linspace(0, 2, 21)
    angle, rate = 40 * time, np.full(21, 40.0)
    assert_array_equal(recording(tmp_path, angle, rate, time=time).position[:, 0], angle)
    folded = recording(tmp_path, np.where(np.arange(21) % 2, angle - 2 * np.pi, angle), rate, time=time)
    assert_allclose(folded.position[:, 0], angle, rtol=0, atol=100 * EPS)
    with pytest.raises(MotionError, match=r"q1, row 2 .*steps of at most pi \[rad\], or also velocities"):
        recording(tmp_path, angle, time=time)


def test_jumps_of_a_joint_with_limits_are_refused(tmp_path):
    with pytest.raises(MotionError) as caught:
        recording(tmp_path, wrapped(3 * TIME + 2), endless=BOUNDED)
    assert "path.csv: q1, row 40 (line 41): -3.11319 after 3.14; allowed: steps of at" in str(caught.value)


def test_long_steps_that_velocities_explain_are_a_motion(tmp_path):
    time = np.array([0.0, 1.0, 2.0])
    found = recording(tmp_path, 4 * time, np.full(3, 4.0), BOUNDED, time)
    assert_array_equal(found.position[:, 0], 4 * time)
    assert found.warnings == ()


def test_sliding_joints_never_wrap(tmp_path):
    load(put(tmp_path, {"t": TIME, "q1": 0 * TIME, "q2": 1000 * TIME}), NAMES, SLIDING, ENDLESS)


def test_a_residual_that_is_no_noise_is_told(tmp_path):
    jump = np.where(TIME > 1, 2.0, 0.0)
    (warning,) = recording(tmp_path, jump).at(TIME).warnings
    assert warning.startswith("joint positions are ")
    assert "see that none of them jumps" in warning
    quiet = 1e-4 * np.random.default_rng(1).standard_normal(len(TIME))
    assert recording(tmp_path, np.sin(TIME) + quiet).at(TIME).warnings == ()


def test_limits_that_are_left_are_told():
    time = np.array([0.0, 1.0, 2.0])
    position = np.array([[0.0, 0.0], [1.5, 0.0], [0.5, -0.3]])
    limits = np.array([[-1.0, 1.0], [-0.1, 0.1]])
    (line,) = told(time, position, limits, NAMES, SLIDING)
    assert line == (
        "joints leave their limits: wheel to 1.5 rad at t = 1 s (-1 to 1); "
        "slide to -0.3 m at t = 2 s (-0.1 to 0.1)"
    )
    assert told(time, position, np.array([[-np.inf, np.inf], [-0.3, 0.1]]), NAMES, SLIDING) == ()
    five = told(time, np.full((3, 5), 2.0), np.tile([0.0, 1.0], (5, 1)), list("abcde"), np.zeros(5, bool))
    assert five[0].endswith("c to 2 rad at t = 0 s (0 to 1) and 2 more")
