"""Twist and acceleration of the platform from rates of its legs."""

import numpy as np
import pytest
from cases import DERIVATIVES, at_rest, random_mechanism, random_motion
from hypothesis import given
from hypothesis import strategies as st
from lengths import UNIT_ROUNDOFF, lengths_of
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.errors import InputError, MotionError
from sixsps.mechanism import Mechanism
from sixsps.trajectories import bundled

WU = Mechanism.load("wu2012")
BARE = Mechanism.load("dietmaier1998")


@given(seed=st.integers(0, 10_000))
def test_rates_of_the_legs_lead_back_to_those_of_the_platform(seed):
    """The inverse of inverse kinematics at both levels, to rounding times the condition number."""
    mechanism = random_mechanism(seed % 50)
    motion = random_motion(mechanism, seed, samples=6)
    legs = sixsps.inverse_kinematics(mechanism, motion)
    found = sixsps.forward_rates(mechanism, motion, legs.length_rates, legs.length_accelerations)
    size = mechanism.characteristic_length
    growth = 20 * UNIT_ROUNDOFF * legs.error_growth[:, None]
    twist = np.hstack([motion.velocity / size, motion.angular_velocity])
    error = np.hstack([found.velocity / size, found.angular_velocity]) - twist
    largest = np.abs(twist).max(axis=1, keepdims=True)
    assert (np.abs(error) <= growth * largest).all()
    acceleration = np.hstack([motion.acceleration / size, motion.angular_acceleration])
    error = np.hstack([found.acceleration / size, found.angular_acceleration]) - acceleration
    # The velocity terms that are taken off carry the twist's error twice.
    arms = np.abs(legs.lengths / size).max(axis=1, keepdims=True)
    squares = largest**2 * (1 + arms) * (1 + size / legs.lengths.min(axis=1, keepdims=True))
    scale = np.abs(acceleration).max(axis=1, keepdims=True) + squares * legs.condition[:, None]
    assert (np.abs(error) <= growth * scale).all()


def test_rates_are_derivatives_of_poses(mechanism):
    """Against differences of forward kinematics over time: their error falls with the square of the step."""
    motion = bundled("sinusoids", mechanism, 2001)
    legs = sixsps.inverse_kinematics(mechanism, motion)
    found = sixsps.forward_kinematics(mechanism, legs.lengths)
    rates = sixsps.forward_rates(mechanism, found, legs.length_rates, legs.length_accelerations)
    errors = []
    for step in (8, 4):
        h = step * (motion.time[1] - motion.time[0])
        middle = slice(step, -step)
        ahead, behind = found.position[2 * step :], found.position[: -2 * step]
        turn = Rotation.from_matrix(found.rotation[2 * step :] @ found.rotation[: -2 * step].swapaxes(1, 2))
        second = (ahead - 2 * found.position[middle] + behind) / h**2
        spin = (rates.angular_velocity[2 * step :] - rates.angular_velocity[: -2 * step]) / (2 * h)
        differences = (
            (ahead - behind) / (2 * h) - rates.velocity[middle],
            turn.as_rotvec() / (2 * h) - rates.angular_velocity[middle],
            second - rates.acceleration[middle],
            spin - rates.angular_acceleration[middle],
        )
        errors.append([np.abs(one).max() for one in differences])
    coarse, fine = np.array(errors)
    scales = [np.abs(getattr(rates, name)).max() for name in DERIVATIVES]
    assert (fine / scales < 1e-3).all()
    assert np.abs(coarse / fine - 4).max() < 0.3


def test_motion_has_the_rates(mechanism):
    motion = bundled("sinusoids", mechanism, 200)
    legs = sixsps.inverse_kinematics(mechanism, motion)
    found = sixsps.forward_kinematics(mechanism, legs.lengths)
    back = found.motion(motion.time, legs.length_rates, legs.length_accelerations, name="back")
    assert back.name == "back"
    assert not back.estimated
    for name in ("position", *DERIVATIVES):
        expected = getattr(motion, name)
        assert np.abs(getattr(back, name) - expected).max() <= 1e-12 * np.abs(expected).max()
    again = sixsps.inverse_kinematics(mechanism, back)
    for name in ("lengths", "length_rates", "length_accelerations"):
        expected = getattr(legs, name)
        assert np.abs(getattr(again, name) - expected).max() <= 1e-12 * np.abs(expected).max()


def test_motion_estimates_what_is_not_given():
    motion = bundled("sinusoids", WU, 200)
    legs = sixsps.inverse_kinematics(WU, motion)
    found = sixsps.forward_kinematics(WU, legs.lengths)
    assert set(found.motion(motion.time, cutoff=30.0).estimated) == set(DERIVATIVES)
    half = found.motion(motion.time, legs.length_rates)
    assert set(half.estimated) == {"acceleration", "angular_acceleration"}
    assert np.abs(half.velocity - motion.velocity).max() < 1e-12
    with pytest.raises(InputError, match="length_rates"):
        found.motion(motion.time, None, legs.length_accelerations)


def test_motion_needs_poses():
    lengths = np.full((3, 6), 0.7)
    one = sixsps.forward_kinematics(WU, lengths[0])
    with pytest.raises(InputError, match="for a motion"):
        one.motion([0.0])
    lengths[1, 1] = 9
    found = sixsps.forward_kinematics(WU, lengths, on_failure="return")
    with pytest.raises(MotionError, match="sample 1: unreachable"):
        found.motion([0, 1, 2], np.zeros((3, 6)), np.zeros((3, 6)))
    rates = sixsps.forward_rates(WU, found, np.ones((3, 6)), np.ones((3, 6)))
    for array in rates.arrays.values():
        assert list(np.isnan(array).all(axis=1)) == [False, True, False]


def test_single_pose_has_the_rates_of_an_array_of_one():
    motion = random_motion(WU, 5, samples=1)
    legs = sixsps.inverse_kinematics(WU, motion)
    lengths, rates, accelerations = legs.lengths[0], legs.length_rates[0], legs.length_accelerations[0]
    one = sixsps.forward_kinematics(WU, lengths)
    several = sixsps.forward_kinematics(WU, lengths[None])
    for more in (None, accelerations):
        found = sixsps.forward_rates(WU, one, rates, more)
        expected = sixsps.forward_rates(WU, several, rates[None], None if more is None else more[None])
        for name, array in found.arrays.items():
            if more is None and "acceleration" in name:
                assert array is None
            else:
                assert array.shape == (3,)
                assert np.array_equal(array, getattr(expected, name)[0])
    assert np.abs(found.velocity - motion.velocity[0]).max() <= 1e-12
    pose = sixsps.Pose.of(motion)
    assert sixsps.forward_rates(WU, pose, rates).velocity.shape == (3,)
    lost = sixsps.forward_kinematics(WU, np.full(6, 0.01), on_failure="return")
    assert np.isnan(sixsps.forward_rates(WU, lost, rates).velocity).all()
    for wrong in (rates[None], np.ones(5), "x"):
        with pytest.raises(InputError, match="length_rates"):
            sixsps.forward_rates(WU, one, wrong)


@pytest.mark.parametrize("poses", ["x", None, (np.zeros(3), np.eye(3)), np.zeros((2, 3))])
def test_rates_need_poses(poses):
    with pytest.raises(InputError, match="poses: "):
        sixsps.forward_rates(WU, poses, np.ones(6))


def test_singular_poses_have_no_rates():
    """wu2012 turned by a right angle about its axis; and a leg without length."""
    turned = Rotation.from_rotvec([0, 0, np.pi / 2]).as_quat(scalar_first=True)
    anchor = BARE.base_anchors[2] - BARE.platform_anchors[2]
    for mechanism, motion in ((WU, at_rest([0, 0, 0.5], turned)), (BARE, at_rest(anchor))):
        condition = sixsps.inverse_kinematics(mechanism, motion).condition
        found = sixsps.forward_rates(mechanism, motion, np.ones((1, 6)), np.ones((1, 6)))
        singular = not condition[0] <= 1e12
        for array in found.arrays.values():
            assert np.isnan(array).all() == singular


def test_no_accelerations_unless_they_are_given():
    motion = at_rest([0, 0, 0.6])
    found = sixsps.forward_rates(WU, motion, np.ones((1, 6)))
    assert found.acceleration is found.angular_acceleration is None


@pytest.mark.parametrize("rates", [np.ones(6), np.ones((2, 6)), np.full((1, 6), np.nan)])
def test_rates_that_are_none_are_refused(rates):
    motion = at_rest([0, 0, 0.6])
    with pytest.raises(InputError, match="length_rates"):
        sixsps.forward_rates(WU, motion, rates)
    with pytest.raises(InputError, match="length_accelerations"):
        sixsps.forward_rates(WU, motion, np.ones((1, 6)), rates)


def test_geometry_alone_is_enough():
    motion = random_motion(WU, 3, samples=4)
    bare = Mechanism.geometry("bare", WU.base_anchors, WU.platform_anchors)
    legs = sixsps.inverse_kinematics(WU, motion)
    guess = motion.position, motion.quaternion
    found = sixsps.forward_kinematics(bare, lengths_of(WU, motion.position, motion.rotation), guess)
    compiled = sixsps.compile(bare).forward_kinematics(found.lengths, guess)
    assert np.array_equal(compiled.position, found.position)
    back = found.motion(motion.time, legs.length_rates, legs.length_accelerations)
    assert np.abs(back.velocity - motion.velocity).max() <= 1e-12 * np.abs(motion.velocity).max()
