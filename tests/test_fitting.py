"""Homes of mechanisms, and motions shifted and scaled until every leg follows them."""

import numpy as np
import pytest
from cases import BUNDLED, legs_within_limits, random_mechanism
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sixsps.bodies import Leg
from sixsps.errors import SixspsError
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import fitted


def with_limits(mechanism, low, high):
    legs = tuple(Leg(leg.lower, leg.upper, (low, high)) for leg in mechanism.legs)
    return Mechanism(
        name=mechanism.name,
        gravity=mechanism.gravity,
        base_anchors=mechanism.base_anchors,
        platform_anchors=mechanism.platform_anchors,
        platform=mechanism.platform,
        legs=legs,
    )


def wandering(seed, samples=50, tilt=0.2, span=3.0):
    """Poses far from any mechanism, with derivatives and a wrench of their own."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((6, samples, 3))
    angles = rng.uniform(-1, 1, (samples, 3))
    return Motion(
        time=np.arange(samples),
        position=span * rng.standard_normal((samples, 3)) + 10,
        quaternion=Rotation.from_rotvec(tilt / np.sqrt(3) * angles).as_quat(scalar_first=True),
        velocity=columns[0],
        angular_velocity=columns[1],
        acceleration=columns[2],
        angular_acceleration=columns[3],
        force=columns[4],
        moment=columns[5],
        name="wandering",
        estimated={"velocity": "guessed"},
    )


def test_home_has_the_legs_on_average_at_mid_stroke(mechanism):
    home = home_position(mechanism)
    legs = home + mechanism.platform_anchors - mechanism.base_anchors
    middle = mechanism.length_limits.mean()
    # brentq stops within 2e-12 m of the height.
    assert np.linalg.norm(legs, axis=1).mean() == pytest.approx(middle, abs=4e-12)
    # Above the base, one centroid over the other: all bundled bases are level.
    np.testing.assert_allclose(legs.mean(axis=0)[:2], 0, rtol=0, atol=1e-15)
    assert legs.mean(axis=0)[2] > 0


@pytest.mark.parametrize("seed", range(6))
def test_home_of_a_tilted_uneven_base_points_against_gravity(seed):
    drawn = random_mechanism(seed)
    # Long legs, so that there is such a place.
    size = np.ptp(drawn.base_anchors, axis=0).max()
    mechanism = with_limits(drawn, 2 * size, 4 * size)
    home = home_position(mechanism)
    legs = home + mechanism.platform_anchors - mechanism.base_anchors
    assert np.linalg.norm(legs, axis=1).mean() == pytest.approx(3 * size, abs=1e-11)
    direction = legs.mean(axis=0)
    assert direction @ mechanism.gravity < 0
    # Along the direction in which the anchors scatter least.
    centred = mechanism.base_anchors - mechanism.base_anchors.mean(axis=0)
    direction /= np.linalg.norm(direction)
    smallest = np.linalg.eigvalsh(centred.T @ centred)[0]
    assert direction @ (centred.T @ centred) @ direction == pytest.approx(smallest, rel=1e-9)


def test_a_hanging_mechanism_has_its_home_below(wu2012):
    hanging = Mechanism(
        name="hanging",
        gravity=-wu2012.gravity,
        base_anchors=wu2012.base_anchors,
        platform_anchors=wu2012.platform_anchors,
        platform=wu2012.platform,
        legs=wu2012.legs,
    )
    np.testing.assert_allclose(home_position(hanging), -home_position(wu2012), rtol=0, atol=1e-11)


def test_legs_too_short_for_a_home_put_it_at_half_their_middle_length(wu2012):
    # At height 0 the legs are 0.17 m long on average: with half of that they reach the platform nowhere.
    short = with_limits(wu2012, 0.05, 0.12)
    np.testing.assert_allclose(home_position(short), [0, 0, 0.085 / 2], rtol=0, atol=1e-15)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), tilt=st.floats(0, 0.4), name=st.sampled_from(BUNDLED))
def test_fitted_motions_stay_within_the_limits(seed, tilt, name):
    mechanism = Mechanism.load(name)
    motion = fitted(wandering(seed, tilt=tilt), mechanism)
    assert legs_within_limits(mechanism, motion)


def test_fitted_motions_are_as_large_as_promised(mechanism):
    # Without rotation the middle is home and the farthest is at nine tenths of the least stroke left.
    motion = fitted(wandering(1, tilt=0.0), mechanism)
    home = home_position(mechanism)
    middle = (motion.position.min(axis=0) + motion.position.max(axis=0)) / 2
    np.testing.assert_allclose(middle, home, rtol=0, atol=1e-13)
    lengths = np.linalg.norm(home + mechanism.platform_anchors - mechanism.base_anchors, axis=1)
    low, high = mechanism.length_limits.T
    left = min((lengths - low).min(), (high - lengths).min())
    reach = np.linalg.norm(motion.position - home, axis=1).max()
    assert reach == pytest.approx(0.9 * left, rel=1e-12)


def test_fitting_scales_derivatives_along_and_leaves_the_rest(mechanism):
    before = wandering(2)
    after = fitted(before, mechanism)
    scale = np.linalg.norm(np.ptp(after.position, axis=0)) / np.linalg.norm(np.ptp(before.position, axis=0))
    assert 0 < scale < 1
    shape = before.position - before.position.mean(axis=0)
    np.testing.assert_allclose(
        after.position, after.position.mean(axis=0) + scale * shape, rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(after.velocity, scale * before.velocity, rtol=1e-12)
    np.testing.assert_allclose(after.acceleration, scale * before.acceleration, rtol=1e-12)
    for kept in ("time", "quaternion", "angular_velocity", "angular_acceleration", "force", "moment"):
        np.testing.assert_array_equal(getattr(after, kept), getattr(before, kept))
    assert (after.name, after.estimated) == (before.name, before.estimated)


def test_fitting_twice_is_fitting_once(mechanism):
    once = fitted(wandering(3), mechanism)
    twice = fitted(once, mechanism)
    np.testing.assert_allclose(twice.position, once.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(twice.velocity, once.velocity, rtol=1e-12)


@pytest.mark.parametrize("place", [0.0, 10.0, 0.1])
def test_a_motion_that_only_turns_is_only_shifted(place, mechanism):
    # The mean of fifty times 0.1 is not 0.1: what rounding leaves is no translation to be scaled up.
    drawn = wandering(4, span=0.0)
    columns = {name: getattr(drawn, name) for name in ("time", "quaternion", "angular_velocity")}
    still = np.zeros((50, 3))
    turning = Motion(
        position=np.full((50, 3), place),
        velocity=still + 1e-12,
        acceleration=still,
        angular_acceleration=drawn.angular_acceleration,
        **columns,
    )
    motion = fitted(turning, mechanism)
    np.testing.assert_allclose(motion.position, np.tile(home_position(mechanism), (50, 1)), atol=1e-13)
    np.testing.assert_allclose(motion.velocity, 0, rtol=0, atol=1e-9)


def test_a_motion_that_turns_too_far_is_refused_or_not_left_at_its_own_size():
    # Half a turn about the vertical uses up every leg of tsai2000; there is no room for any translation.
    mechanism = Mechanism.load("tsai2000")
    drawn = wandering(5)
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (50, 1))
    quaternion[25:] = [0.0, 0.0, 0.0, 1.0]
    rates = ("velocity", "angular_velocity", "acceleration", "angular_acceleration")
    columns = {name: getattr(drawn, name) for name in ("time", "position", *rates)}
    try:
        motion = fitted(Motion(**columns, quaternion=quaternion), mechanism)
    except SixspsError:
        return
    home = home_position(mechanism)
    reach = np.linalg.norm(motion.position - home, axis=1).max()
    stroke = np.diff(mechanism.length_limits).min()
    assert reach < stroke


def test_the_recorded_motion_fits_every_mechanism(recorded, mechanism):
    motion = fitted(recorded, mechanism)
    assert legs_within_limits(mechanism, motion)
    assert inverse_kinematics(mechanism, motion).condition.max() < 100
    # It uses the stroke: half of the least that any leg has left at home.
    lengths = inverse_kinematics(mechanism, motion).lengths
    assert np.ptp(lengths, axis=0).max() > 0.25 * np.diff(mechanism.length_limits).min()
    assert set(motion.estimated) == {
        "velocity",
        "angular_velocity",
        "acceleration",
        "angular_acceleration",
    }
