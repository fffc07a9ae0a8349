"""Analytic motions against differences of their own poses, the paper's numbers, and the legs they need."""

import numpy as np
import pytest
from cases import BUNDLED, legs_within_limits
from scipy.spatial.transform import Rotation

from sixsps.errors import UnknownNameError
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.mechanism_file import bundled_mechanisms
from sixsps.trajectories import (
    PAPER_FORCE,
    bundled,
    bundled_motions,
    circle,
    fitted,
    line,
    quintic,
    sinusoids,
    spiral,
)

EPS = np.finfo(float).eps
# Eighth-order central differences; their truncation error is h^8 f^(9) / 630.
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
# Highest frequency of any motion here, Euler angles' combinations included [Hz].
FASTEST = 4.0
MOTIONS = ("circle", "line", "quintic", "sinusoids", "spiral")

TIMES = np.linspace(-0.4, 1.6, 401)
ANALYTIC = {
    "line": line(TIMES, [0.1, -0.2, 0.5], [1.0, 0.5, -0.2], [-0.3, 2.0, 0.7]),
    "sinusoids": sinusoids(
        TIMES,
        [0.1, -0.2, 0.5, 0.4, -0.8, 0.3],
        [0.1, 0.2, 0.05, 0.5, 0.7, 0.9],
        [1.1, 0.7, 0.4, 0.5, 0.8, 0.6],
        [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
    ),
    "quintic": quintic(TIMES, [0.1, -0.2, 0.5], [0.4, 0.1, 0.3], [0.9, -1.4, 2.0]),
    "circle": circle(TIMES, [0.1, -0.2, 0.5], 0.3, 1.2),
    "spiral": spiral(TIMES, [0.1, -0.2, 0.5], 0.3, 1.2, 0.4),
}
EVERY = [pytest.param(motion, id=name) for name, motion in ANALYTIC.items()] + [
    pytest.param(bundled(name, Mechanism.load(mechanism), 401), id=f"{name}-{mechanism}")
    for name in MOTIONS
    for mechanism in BUNDLED
]


def derivative(values, step):
    """First derivative at all but four samples at either end."""
    windows = np.lib.stride_tricks.sliding_window_view(values, 9, axis=0)
    return windows @ FIRST / step


def derivative_bound(values, step):
    """Largest error of that derivative: truncation, and rounding of times up to 3 s and of values."""
    size, pulsation = np.abs(values - values.mean(axis=0)).max(), 2 * np.pi * FASTEST
    truncation = size * pulsation * (pulsation * step) ** 8 / 630
    rounding = EPS * (np.abs(values).max() + 3 * pulsation * size) / step
    return truncation + 10 * rounding


@pytest.mark.parametrize("motion", EVERY)
def test_linear_derivatives_are_those_of_the_position(motion):
    step = motion.time[1] - motion.time[0]
    for values, rates in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        found = derivative(values, step)
        np.testing.assert_allclose(rates[4:-4], found, rtol=0, atol=derivative_bound(values, step))


@pytest.mark.parametrize("motion", EVERY)
def test_angular_derivatives_are_those_of_the_rotation(motion):
    step = motion.time[1] - motion.time[0]
    R, omega = motion.rotation, motion.angular_velocity
    # R' = [omega]x R, column by column.
    turning = np.cross(omega[:, None], R.swapaxes(1, 2)).swapaxes(1, 2)
    np.testing.assert_allclose(turning[4:-4], derivative(R, step), rtol=0, atol=derivative_bound(R, step))
    bound = derivative_bound(omega, step)
    np.testing.assert_allclose(motion.angular_acceleration[4:-4], derivative(omega, step), rtol=0, atol=bound)


@pytest.mark.parametrize("name", ["sinusoids", "quintic"])
def test_motions_that_turn_do_turn(name):
    # The checks above would pass for a platform that stands still.
    assert np.ptp(ANALYTIC[name].rotation, axis=0).max() > 0.5
    assert np.abs(ANALYTIC[name].angular_acceleration).max() > 1


@pytest.mark.parametrize("name", MOTIONS)
def test_motions_are_named_and_carry_the_force_they_are_given(name):
    motion = ANALYTIC[name]
    assert motion.name == name
    np.testing.assert_array_equal(motion.time, TIMES)
    np.testing.assert_array_equal(motion.force, np.zeros((401, 3)))
    arguments = {
        "line": (line, [0, 0, 1], [0, 0, 0], [0, 0, 0]),
        "sinusoids": (sinusoids, [0] * 6, [0] * 6, [1] * 6, [0] * 6),
        "quintic": (quintic, [0, 0, 1], [0, 0, 1], [0, 0, 0]),
        "circle": (circle, [0, 0, 1], 0.1, 1.0),
        "spiral": (spiral, [0, 0, 1], 0.1, 1.0, 0.1),
    }
    make, *given_values = arguments[name]
    pushed = make(TIMES, *given_values, [1.0, -2.0, 3.0])
    np.testing.assert_array_equal(pushed.force, np.tile([1.0, -2.0, 3.0], (401, 1)))
    np.testing.assert_array_equal(pushed.moment, np.zeros((401, 3)))
    assert pushed.estimated == {}


def test_line_starts_as_told_at_time_zero():
    at_zero = ANALYTIC["line"][np.isclose(TIMES, 0, atol=1e-9)]
    np.testing.assert_allclose(at_zero.position[0], [0.1, -0.2, 0.5], atol=1e-14)
    np.testing.assert_allclose(at_zero.velocity[0], [1.0, 0.5, -0.2], atol=1e-14)
    np.testing.assert_array_equal(ANALYTIC["line"].acceleration, np.tile([-0.3, 2.0, 0.7], (401, 1)))


def test_sinusoids_are_euler_angles_about_their_center():
    motion, t = ANALYTIC["sinusoids"], TIMES[:, None]
    center, size = np.array([0.1, -0.2, 0.5, 0.4, -0.8, 0.3]), [0.1, 0.2, 0.05, 0.5, 0.7, 0.9]
    pose = center + size * np.sin(2 * np.pi * t * [1.1, 0.7, 0.4, 0.5, 0.8, 0.6] + np.arange(6.0))
    np.testing.assert_allclose(motion.position, pose[:, :3], rtol=0, atol=1e-14)
    alpha, beta, gamma = (Rotation.from_euler(axis, pose[:, [3 + i]]) for i, axis in enumerate("XYZ"))
    np.testing.assert_allclose(motion.rotation, (alpha * beta * gamma).as_matrix(), rtol=0, atol=1e-14)


def test_quintic_goes_from_rest_to_rest():
    motion = ANALYTIC["quintic"]
    np.testing.assert_allclose(motion.position[[0, -1]], [[0.1, -0.2, 0.5], [0.4, 0.1, 0.3]], atol=1e-14)
    end = Rotation.from_rotvec([0.9, -1.4, 2.0]).as_matrix()
    np.testing.assert_allclose(motion.rotation[[0, -1]], [np.eye(3), end], atol=1e-14)
    for rate in ("velocity", "angular_velocity", "acceleration", "angular_acceleration"):
        values = getattr(motion, rate)
        # The coefficients 30, 60 and 60 of s' and 60, 180 and 120 of s'' cancel at the end, over 2 s.
        np.testing.assert_allclose(values[[0, -1]], 0, rtol=0, atol=400 * EPS * 2)
        assert np.abs(values).max() > 0.1
    middle = motion.position[200]
    np.testing.assert_allclose(middle, [0.25, -0.05, 0.4], atol=1e-14)


def test_circle_is_level_and_round_at_constant_speed():
    motion = ANALYTIC["circle"]
    offset = motion.position - [0.1, -0.2, 0.5]
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 0.3, atol=1e-14)
    np.testing.assert_array_equal(offset[:, 2], 0)
    np.testing.assert_allclose(np.linalg.norm(motion.velocity, axis=1), 0.3 * 2 * np.pi * 1.2, rtol=1e-14)
    np.testing.assert_allclose(motion.acceleration, -((2 * np.pi * 1.2) ** 2) * offset, atol=1e-12)


def test_spiral_grows_evenly_from_its_center_and_climbs():
    motion = ANALYTIC["spiral"]
    share = np.linspace(0, 1, 401)
    offset = motion.position - [0.1, -0.2, 0.5]
    np.testing.assert_allclose(np.linalg.norm(offset[:, :2], axis=1), 0.3 * share, atol=1e-14)
    np.testing.assert_allclose(offset[:, 2], 0.4 * share, atol=1e-14)


def test_the_papers_line(wu2012):
    motion = bundled("line", wu2012)
    assert motion.time[0] == 0
    assert motion.time[-1] == 2
    np.testing.assert_array_equal(motion.position[0], [0, 0.2, 0.45])
    np.testing.assert_array_equal(motion.velocity[0], [0, 0.1, 0])
    np.testing.assert_array_equal(motion.acceleration, np.tile([0, 0.1, 0], (2001, 1)))
    np.testing.assert_array_equal(motion.force, np.tile([80, -50, -100], (2001, 1)))
    np.testing.assert_array_equal(motion.moment, 0)
    np.testing.assert_array_equal(motion.rotation, np.tile(np.eye(3), (2001, 1, 1)))
    np.testing.assert_allclose(motion.position[-1], [0, 0.6, 0.45], rtol=0, atol=1e-15)
    lengths = inverse_kinematics(wu2012, motion).lengths
    assert lengths.min() == pytest.approx(0.460, abs=5e-4)
    assert lengths.max() == pytest.approx(0.879, abs=5e-4)
    assert legs_within_limits(wu2012, motion)


def test_the_catalogue_is_complete(wu2012):
    assert bundled_motions() == sorted(MOTIONS)
    assert {name for name in bundled_mechanisms() if Mechanism.load(name).has_inertia} == set(BUNDLED)


@pytest.mark.parametrize("name", MOTIONS)
def test_bundled_motions_suit_the_bundled_mechanisms(name, mechanism):
    motion = bundled(name, mechanism)
    assert (motion.name, len(motion)) == (name, 2001)
    assert motion.estimated == {}
    np.testing.assert_array_equal(motion.force, np.tile(PAPER_FORCE, (2001, 1)))
    assert legs_within_limits(mechanism, motion)
    legs = inverse_kinematics(mechanism, motion)
    assert legs.condition.max() < 100
    # Not so small that it tests nothing: some leg uses a twentieth of its stroke or more.
    assert np.ptp(legs.lengths, axis=0).max() > 0.05 * np.diff(mechanism.length_limits).min()


@pytest.mark.parametrize("samples", [2, 3, 50])
@pytest.mark.parametrize("name", MOTIONS)
def test_bundled_motions_have_as_many_samples_as_asked_for(name, samples, wu2012):
    few, usual = bundled(name, wu2012, samples), bundled(name, wu2012)
    assert len(few) == samples
    for end in (0, -1):
        assert few.time[end] == usual.time[end]
        np.testing.assert_allclose(few.position[end], usual.position[end], rtol=0, atol=1e-14)


def test_bundled_motions_sit_at_the_home_of_the_mechanism(mechanism):
    home = home_position(mechanism)
    for name in MOTIONS:
        if name == "line" and mechanism.name == "wu2012":
            continue
        motion = bundled(name, mechanism)
        stroke = np.diff(mechanism.length_limits).min()
        assert np.linalg.norm(motion.position - home, axis=1).max() < 0.3 * stroke


@pytest.mark.parametrize("name", ["", "Line", "spirale", "../line"])
def test_unknown_motions_are_named_and_the_known_ones_listed(name, wu2012):
    with pytest.raises(UnknownNameError) as caught:
        bundled(name, wu2012)
    assert caught.value.value == name
    assert caught.value.allowed == "circle, line, quintic, sinusoids, spiral"


def test_fitted_derivatives_are_still_those_of_the_position(mechanism):
    motion = fitted(bundled("sinusoids", Mechanism.load("wu2012"), 1001), mechanism)
    step = motion.time[1] - motion.time[0]
    for values, rates in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        found = derivative(values, step)
        np.testing.assert_allclose(rates[4:-4], found, rtol=0, atol=derivative_bound(values, step))


def test_the_papers_line_goes_with_the_anchors_and_not_with_the_name():
    from dataclasses import replace

    paper = Mechanism.load("wu2012")
    start = bundled("line", paper, 2).position[0]
    assert np.array_equal(bundled("line", replace(paper, name="mine"), 2).position[0], start)
    larger = replace(
        paper, base_anchors=10 * paper.base_anchors, platform_anchors=10 * paper.platform_anchors
    )
    assert not np.array_equal(bundled("line", larger, 2).position[0], start)
