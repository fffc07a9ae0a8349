"""Estimated derivatives against motions whose derivatives are known, and against the poses themselves."""

import numpy as np
import pytest
from cases import DERIVATIVES, RECORDED, times, wobble
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sixsps.differentiation import differentiate
from sixsps.errors import MotionError
from sixsps.motion import Motion
from sixsps.smoothing import fit
from sixsps.trajectories import sinusoids

EPS = np.finfo(float).eps
# Condition of the normal equations, what rounding grows by; see test_smoothing.py.
CONDITION = 1e6


def with_noise(motion, noise, seed=0):
    """Positions and quaternions of a motion with noise [m] and [rad] on every axis."""
    rng = np.random.default_rng(seed)
    position = motion.position + noise * rng.standard_normal(motion.position.shape)
    turn = Rotation.from_rotvec(noise * rng.standard_normal(motion.position.shape))
    orientation = turn * Rotation.from_quat(motion.quaternion, scalar_first=True)
    return position, orientation.as_quat(scalar_first=True)


def interior(time, margin=1.0):
    """Samples further than `margin` seconds from both ends, where the spline is the filter."""
    return (time > time[0] + margin) & (time < time[-1] - margin)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def expected_noise(order, noise, cutoff, rate):
    """RMS of the order-th derivative of white noise behind the filter 1 / (1 + (f / cutoff)^6).

    From the integral of x^(2 k) / (1 + x^6)^2 over x > 0, that is B((2 k + 1) / 6, (11 - 2 k) / 6) / 6:
    pi / 12 for k = 1, pi / 18 for k = 2.
    """
    share = {1: 1 / 12, 2: 1 / 18}[order]
    return noise * np.sqrt(share * (2 * np.pi * cutoff) ** (2 * order + 1) / rate)


def angle_between(a, b):
    """Angle of each rotation of `a` from `b`, exact for small ones."""
    return (a * b.inv()).magnitude()


def refused_or(action):
    """What `action` returns, None when it says that the motion is no good."""
    try:
        return action()
    except MotionError:
        return None


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_exact_poses_give_nearly_exact_derivatives(jitter):
    time = times(jitter=jitter)
    motion = wobble(time)
    found = differentiate(time, motion.position, motion.quaternion)
    inside = interior(time)
    assert min(found.position_cutoff, found.rotation_cutoff) > 10
    for field in DERIVATIVES:
        truth = getattr(motion, field)
        error = getattr(found, field)[inside] - truth[inside]
        # The filter takes (0.7 / 10)^6 = 1e-7; jitter makes that uneven, which differentiation magnifies.
        assert rms(error) < 1e-5 * rms(truth)


@pytest.mark.parametrize("noise", [1e-5, 1e-3])
@pytest.mark.parametrize("cutoff", [4.0, 8.0])
def test_a_set_cutoff_leaves_the_noise_that_theory_gives(cutoff, noise):
    time = times(4000, seed=1)
    motion = wobble(time)
    found = differentiate(time, *with_noise(motion, noise, 1), cutoff)
    inside = interior(time)
    assert found.position_cutoff == found.rotation_cutoff == cutoff
    for field in DERIVATIVES:
        order = 2 if "acceleration" in field else 1
        truth = getattr(motion, field)[inside]
        expected = expected_noise(order, noise, cutoff, 100.0)
        # What the motion itself loses: 0.7 Hz, and the Euler angles' combinations up to 1.5 Hz.
        bias = (1.5 / cutoff) ** 6 * rms(truth) * 0.1
        error = rms(getattr(found, field)[inside] - truth)
        # 40 s at 4 Hz hold some 900 independent values in three columns: 2.4 % (one sigma), and jitter of
        # the instants adds what the derivative changes within a step.
        assert 0.85 * expected - bias < error < 1.15 * expected + bias


@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_noisy_uneven_poses_give_derivatives_and_their_noise(noise):
    time = times(2000, seed=2)
    motion = wobble(time)
    found = differentiate(time, *with_noise(motion, noise, 2))
    inside = interior(time)
    for field in DERIVATIVES:
        order = 2 if "acceleration" in field else 1
        cutoff = found.rotation_cutoff if "angular" in field else found.position_cutoff
        error = rms(getattr(found, field)[inside] - getattr(motion, field)[inside])
        # Where the cutoff is right, what the filter takes of the motion is less than the noise it passes.
        assert error < 1.25 * expected_noise(order, noise, cutoff, 100.0)
        assert error < (0.01 if noise == 1e-4 else 0.1) * rms(getattr(motion, field))
    # The curve follows a small part of the noise at these cutoffs, a tenth at most.
    assert found.position_noise == pytest.approx(noise, rel=0.1)
    assert found.rotation_noise == pytest.approx(noise * np.sqrt(3), rel=0.1)


@pytest.mark.parametrize("size", [1e-10, 1e-8, 1e-3])
def test_reported_rotation_noise_holds_for_tiny_noise_too(size):
    # Every second sample is turned by `size` to and fro about x: no curve at 5 Hz follows that.
    time = times(400, jitter=0.0)
    wiggle = size * (-1.0) ** np.arange(400)
    quaternion = np.column_stack([np.ones(400), wiggle / 2, np.zeros((400, 2))])
    found = differentiate(time, np.zeros((400, 3)), quaternion, 5.0)
    assert found.rotation_noise == pytest.approx(size, rel=0.01, abs=0)


def test_estimates_are_derivatives_of_one_another():
    # A turn of 1.5 rad to and fro at the corner of the filter: its quaternions are averaged well inside
    # the sphere, nearer or farther at every instant, and the way back to the sphere has to be in epsilon.
    time = times(4000, 1000.0, jitter=0.0)
    motion = sinusoids(time, [0.0] * 6, [0.1, 0, 0, 1.5, 0.8, 0.4], [2.0, 1.0, 1.0, 2.0, 1.0, 0.5])
    found = differentiate(time, motion.position, motion.quaternion, 2.0)
    for rate, acceleration in (
        (found.velocity, found.acceleration),
        (found.angular_velocity, found.angular_acceleration),
    ):
        # Fourth-order differences of a curve whose fourth derivative has corners at the knots, 25 ms apart.
        difference = (rate[:-4] - 8 * rate[1:-3] + 8 * rate[3:-1] - rate[4:]) / 12e-3
        np.testing.assert_allclose(
            difference, acceleration[2:-2], rtol=0, atol=1e-6 * np.abs(acceleration).max()
        )


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_the_estimate_turns_with_the_world_and_not_with_the_platform(seed):
    time = times(300)
    motion = wobble(time)
    position, quaternion = with_noise(motion, 1e-3, seed)
    world, platform = Rotation.random(2, rng=np.random.default_rng(seed))
    turned = world * Rotation.from_quat(quaternion, scalar_first=True) * platform
    given_frame = differentiate(time, position, quaternion, 6.0)
    other = differentiate(time, world.apply(position), turned.as_quat(scalar_first=True), 6.0)
    for field in DERIVATIVES:
        expected = world.apply(getattr(given_frame, field))
        # Unit-sized poses, rounded in the normal equations, at the pulsation of 6 Hz when differentiated.
        order = 2 if "acceleration" in field else 1
        rounding = CONDITION * EPS * (2 * np.pi * 6) ** order
        np.testing.assert_allclose(getattr(other, field), expected, rtol=0, atol=rounding)
    assert other.rotation_noise == pytest.approx(given_frame.rotation_noise, rel=1e-6)


def test_the_chosen_cutoff_does_not_depend_on_the_frames():
    time = times(500)
    position, quaternion = with_noise(wobble(time), 1e-3)
    world, platform = Rotation.random(2, rng=np.random.default_rng(4))
    turned = world * Rotation.from_quat(quaternion, scalar_first=True) * platform
    given_frame = differentiate(time, position, quaternion)
    other = differentiate(time, world.apply(position), turned.as_quat(scalar_first=True))
    # 0.01 is how closely the optimiser finds the logarithm of each.
    assert abs(np.log(other.position_cutoff / given_frame.position_cutoff)) < 0.02
    assert abs(np.log(other.rotation_cutoff / given_frame.rotation_cutoff)) < 0.02


def test_signs_of_quaternions_change_nothing():
    time = times(500)
    position, quaternion = with_noise(wobble(time), 1e-3)
    signs = np.random.default_rng(5).choice([-1.0, 1.0], 500)
    expected = differentiate(time, position, quaternion)
    for flips in (signs, -signs):
        found = differentiate(time, position, flips[:, None] * quaternion)
        assert found.rotation_cutoff == expected.rotation_cutoff
        for field in DERIVATIVES:
            np.testing.assert_array_equal(getattr(found, field), getattr(expected, field))


def test_lengths_of_quaternions_change_nothing():
    # Files may be off unit length by 1e-3; only the direction in R^4 means anything.
    time = times(500)
    motion = wobble(time)
    stretched = motion.quaternion * np.random.default_rng(6).uniform(0.9991, 1.0009, (500, 1))
    found = differentiate(time, motion.position, stretched, 10.0)
    expected = differentiate(time, motion.position, motion.quaternion, 10.0)
    bound = CONDITION * EPS * (2 * np.pi * 10)
    np.testing.assert_allclose(found.angular_velocity, expected.angular_velocity, rtol=0, atol=bound)


@pytest.mark.parametrize("rate", [0.7, -1.3, 2.0])
def test_several_full_turns_at_constant_rate(rate):
    time = times(1000)
    axis = np.array([2.0, -1.0, 2.0]) / 3
    turns = Rotation.from_rotvec(2 * np.pi * rate * time[:, None] * axis)
    # scipy keeps no sign from one sample to the next, nor one half of the sphere.
    quaternion = (turns * Rotation.from_euler("XYZ", [0.3, 1.2, -2.0])).as_quat(
        canonical=True, scalar_first=True
    )
    assert (np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0).sum() >= int(10 * abs(rate)) - 1
    found = differentiate(time, np.zeros((1000, 3)), quaternion)
    inside = interior(time)
    omega = 2 * np.pi * rate * axis
    # A turning quaternion is a wave of half the rate: 1 Hz at most, of which (1 / 20)^6 = 2e-8 is lost.
    assert found.rotation_cutoff > 20
    assert rms(found.angular_velocity[inside] - omega) < 1e-6 * rms(omega)
    assert rms(found.angular_acceleration[inside]) < 1e-5 * rms(omega) * 2 * np.pi * abs(rate)


@pytest.mark.parametrize("cutoff", [None, 5.0])
def test_a_constant_pose_gives_zero(cutoff):
    time = times(300)
    orientation = Rotation.from_euler("XYZ", [0.3, 1.2, -2.0]).as_quat(scalar_first=True)
    found = differentiate(time, np.full((300, 3), 1.7), np.tile(orientation, (300, 1)), cutoff)
    pulsation = 2 * np.pi * max(found.position_cutoff, found.rotation_cutoff, 1 / time[-1])
    for field in DERIVATIVES:
        order = 2 if "acceleration" in field else 1
        bound = 2 * CONDITION * EPS * pulsation**order
        np.testing.assert_allclose(getattr(found, field), 0, rtol=0, atol=bound)
    assert found.position_noise <= 2 * CONDITION * EPS
    assert found.rotation_noise <= 2 * CONDITION * EPS


@pytest.mark.parametrize("offset", [-5.0, 1024.0, 2.0**30])
def test_the_clock_may_start_anywhere(offset):
    # Steps of 1/64 s: exact at every offset.
    time = np.arange(500) / 64.0
    poses = with_noise(wobble(time), 1e-3)
    expected, found = differentiate(time, *poses), differentiate(time + offset, *poses)
    for field in DERIVATIVES:
        np.testing.assert_array_equal(getattr(found, field), getattr(expected, field))


def test_recorded_motion_has_plausible_cutoffs_and_says_so(recorded):
    found = differentiate(recorded.time, recorded.position, recorded.quaternion)
    # A hand moves at some Hz; beyond 25 of the 50 Hz that the samples can tell nothing would be smoothed.
    assert 2 < found.position_cutoff < 25
    assert 2 < found.rotation_cutoff < 25
    # The file is rounded to 1e-5 m and 1e-6; the motion capture scatters more than that, below a millimetre.
    assert 1e-5 < found.position_noise < 1e-3
    assert 1e-4 < found.rotation_noise < 5e-3
    assert set(recorded.estimated) == set(DERIVATIVES)
    for field in DERIVATIVES:
        np.testing.assert_array_equal(getattr(recorded, field), getattr(found, field))
        turning = "angular" in field
        cutoff = found.rotation_cutoff if turning else found.position_cutoff
        assert f"{cutoff:.3g} Hz (chosen from the data)" in recorded.estimated[field]
        assert ("rad RMS" in recorded.estimated[field]) == turning


def test_recorded_velocity_and_acceleration_integrate_back_to_the_positions(recorded):
    dt = np.diff(recorded.time)[:, None]
    v, a = recorded.velocity, recorded.acceleration
    # Hermite's rule, one order above Simpson's on the same samples.
    steps = dt / 2 * (v[1:] + v[:-1]) + dt**2 / 12 * (a[:-1] - a[1:])
    path = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    deviation = recorded.position - path
    deviation -= deviation.mean(axis=0)
    noise = differentiate(recorded.time, recorded.position, recorded.quaternion).position_noise
    assert rms(deviation) == pytest.approx(noise, rel=0.05)
    # No drift: the largest deviation of 3000 is some sigmas of a distribution with heavy tails.
    assert np.abs(deviation).max() < 15 * noise
    span = np.linalg.norm(np.ptp(recorded.position, axis=0))
    assert noise < 1e-3 * span


def test_recorded_angular_velocity_and_acceleration_integrate_back_to_the_orientations(recorded):
    dt = np.diff(recorded.time)[:, None]
    w, e = recorded.angular_velocity, recorded.angular_acceleration
    # Magnus' series for R' = [omega]x R: Hermite's rule, and the commutator of a linearly changing omega.
    steps = dt / 2 * (w[1:] + w[:-1]) + dt**2 / 12 * (e[:-1] - e[1:]) + dt**2 / 12 * np.cross(w[1:], w[:-1])
    path = [Rotation.identity()]
    for step in steps:
        path.append(Rotation.from_rotvec(step) * path[-1])
    start = Rotation.concatenate(path).inv() * Rotation.from_quat(recorded.quaternion, scalar_first=True)
    deviation = angle_between(start, Rotation.concatenate([start.mean()] * len(path)))
    noise = differentiate(recorded.time, recorded.position, recorded.quaternion).rotation_noise
    assert rms(deviation) == pytest.approx(noise, rel=0.05)
    assert deviation.max() < 15 * noise


@pytest.mark.parametrize("field", DERIVATIVES)
def test_recorded_motion_keeps_its_derivatives_when_every_second_sample_is_missing(recorded, field):
    every, second = (
        differentiate(recorded.time[::step], recorded.position[::step], recorded.quaternion[::step])
        for step in (1, 2)
    )
    inside = interior(recorded.time[::2])
    difference = (getattr(every, field)[::2] - getattr(second, field))[inside]
    order, turning = (2 if "acceleration" in field else 1), "angular" in field

    def uncertainty(found, rate):
        noise = found.rotation_noise / np.sqrt(3) if turning else found.position_noise
        return expected_noise(order, noise, found.rotation_cutoff if turning else found.position_cutoff, rate)

    # Two estimates of one motion, each off by the noise that its filter passes and by about as much of the
    # motion that its filter takes.
    allowed = 2 * np.hypot(uncertainty(every, 100.0), uncertainty(second, 50.0))
    assert rms(difference) < allowed
    # And it is the motion that they agree on, not the noise.
    assert rms(difference) < 0.5 * rms(getattr(every, field))


@pytest.mark.skipif(not RECORDED.exists(), reason="the recorded motion is not beside this checkout")
def test_a_set_cutoff_is_named_in_the_motion():
    motion = Motion.load(RECORDED, cutoff=6.0)
    assert set(motion.estimated) == set(DERIVATIVES)
    assert all("6 Hz (set)" in how for how in motion.estimated.values())


@pytest.mark.parametrize("cutoff", [1e-300, 1e-12, 1e-4, 1e-3, 60.0, 1e3, 1e4, 1e6, 1e300])
def test_extreme_cutoffs_are_refused_or_harmless(cutoff):
    time = times(1000)
    position = np.outer(np.sin(2 * np.pi * time), [1.0, 0.0, 0.0])
    motion = refused_or(lambda: Motion.from_poses(time, position, cutoff=cutoff))
    if motion is None:
        return
    if cutoff < 1 / time[-1]:
        # Ten periods and nothing that passes: the best parabola.
        best = np.polynomial.Polynomial.fit(time, position[:, 0], 2)
        np.testing.assert_allclose(motion.velocity[:, 0], best.deriv()(time), rtol=0, atol=1e-3)
    else:
        # Exact samples: whatever follows them all has an acceleration of 4 pi^2 at most.
        assert np.abs(motion.acceleration).max() < 1.1 * (2 * np.pi) ** 2


def test_a_pause_much_longer_than_the_recording_is_refused_or_harmless():
    # Ten seconds, an hour of nothing, ten seconds more.
    time = np.arange(2000) / 100
    time[1000:] += 3600.0
    truth = wobble(time)
    motion = refused_or(lambda: Motion.from_poses(time, truth.position, truth.quaternion))
    if motion is None:
        return
    inside = np.r_[interior(time[:1000]), interior(time[1000:])]
    for field in DERIVATIVES:
        error = getattr(motion, field) - getattr(truth, field)
        assert rms(error[inside]) < 0.01 * rms(getattr(truth, field))


def test_one_stray_sample_long_after_the_others_is_refused_or_harmless():
    time = np.r_[np.arange(100) / 100, 1e6]
    position = wobble(time).position + 1e-3 * np.random.default_rng(8).standard_normal((101, 3))
    motion = refused_or(lambda: Motion.from_poses(time, position))
    assert motion is None or np.isfinite(motion.acceleration).all()


def test_positions_and_orientations_get_cutoffs_of_their_own():
    time = times(500)
    exact = wobble(time)
    position, _ = with_noise(exact, 1e-2)
    found = differentiate(time, position, exact.quaternion)
    assert found.position_cutoff == fit(time, position).cutoff
    assert found.rotation_cutoff > 3 * found.position_cutoff
