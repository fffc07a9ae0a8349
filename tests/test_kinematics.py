"""Leg kinematics against differences of positions, and the geometry it must obey."""

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion

from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.trajectories import sinusoids

STEP = 1e-3
# Eighth-order central differences: first and second derivative.
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


@pytest.fixture
def smooth():
    """A smooth motion of a random mechanism, sampled for nine-point differences about its middle."""
    mechanism = random_mechanism(3)
    size = mechanism.characteristic_length
    home = random_motion(mechanism, 1).position.mean(axis=0)
    amplitude = [0.1 * size] * 3 + [0.2, 0.3, 0.25]
    frequency, phase = [0.5, 0.7, 0.4, 0.6, 0.3, 0.8], [0.1, 1, 2, 3, 4, 5]
    time = 0.3 + STEP * np.arange(-4, 5)
    return mechanism, sinusoids(time, [*home, 0.1, -0.2, 0.3], amplitude, frequency, phase)


def differences(values):
    """First and second derivative at the middle sample, and the rounding of each."""
    scale = np.abs(values).max() * np.finfo(float).eps
    first = np.tensordot(FIRST, values, axes=1) / STEP
    second = np.tensordot(SECOND, values, axes=1) / STEP**2
    return first, second, 10 * scale / STEP, 10 * scale / STEP**2


def test_rates_are_derivatives_of_positions(smooth):
    mechanism, motion = smooth
    legs = inverse_kinematics(mechanism, motion)
    first, second, rounding, rounding2 = differences(legs.lengths)
    np.testing.assert_allclose(legs.length_rates[4], first, atol=rounding)
    np.testing.assert_allclose(legs.length_accelerations[4], second, atol=rounding2)
    first, second, rounding, rounding2 = differences(legs.leg_vectors)
    np.testing.assert_allclose(legs.anchor_velocity[4], first, atol=rounding)
    np.testing.assert_allclose(legs.anchor_acceleration[4], second, atol=rounding2)


def test_leg_turns_as_its_direction_does(smooth):
    mechanism, motion = smooth
    legs = inverse_kinematics(mechanism, motion)
    s, omega, epsilon = (
        array[4] for array in (legs.directions, legs.leg_angular_velocity, legs.leg_angular_acceleration)
    )
    first, second, rounding, rounding2 = differences(legs.directions)
    np.testing.assert_allclose(np.cross(omega, s), first, atol=rounding)
    turned = np.cross(epsilon, s) + np.cross(omega, np.cross(omega, s))
    np.testing.assert_allclose(turned, second, atol=rounding2)


def test_centres_of_mass_move_as_their_positions_do(smooth):
    mechanism, motion = smooth
    legs = inverse_kinematics(mechanism, motion)
    lower = mechanism.base_anchors + mechanism.lower.com[:, None] * legs.directions
    joints = mechanism.base_anchors + legs.leg_vectors
    upper = joints - mechanism.upper.com[:, None] * legs.directions
    for positions, velocity, acceleration in (
        (lower, legs.lower_velocity, legs.lower_acceleration),
        (upper, legs.upper_velocity, legs.upper_acceleration),
    ):
        first, second, rounding, rounding2 = differences(positions)
        np.testing.assert_allclose(velocity[4], first, atol=rounding)
        np.testing.assert_allclose(acceleration[4], second, atol=rounding2)


@pytest.mark.parametrize("seed", range(20))
def test_legs_do_not_spin_and_jacobian_maps_twist_to_rates(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    legs = inverse_kinematics(mechanism, motion)
    twist = np.hstack([motion.velocity, motion.angular_velocity])
    rates = np.einsum("nij,nj->ni", legs.jacobian, twist)
    scale = np.abs(legs.anchor_velocity).max()
    np.testing.assert_allclose(rates, legs.length_rates, atol=20 * np.finfo(float).eps * scale)
    for vectors in (legs.leg_angular_velocity, legs.leg_angular_acceleration):
        spin = np.sum(vectors * legs.directions, axis=-1)
        assert np.abs(spin).max() <= 20 * np.finfo(float).eps * np.abs(vectors).max()


def test_paper_example_runs_within_its_limits(wu2012):
    from sixsps.trajectories import bundled

    lengths = inverse_kinematics(wu2012, bundled("line", wu2012)).lengths
    assert lengths.min() == pytest.approx(0.460, abs=5e-4)
    assert lengths.max() == pytest.approx(0.879, abs=5e-4)


def test_condition_number_does_not_depend_on_the_unit_of_length():
    mechanism = random_mechanism(5)
    motion = random_motion(mechanism, 5)
    legs = inverse_kinematics(mechanism, motion)
    in_mm = Mechanism(
        name="mm",
        gravity=mechanism.gravity,
        base_anchors=1000 * mechanism.base_anchors,
        platform_anchors=1000 * mechanism.platform_anchors,
        platform=mechanism.platform,
        legs=mechanism.legs,
    )
    moved = at_rest(1000 * motion.position[0], motion.quaternion[0])
    condition = inverse_kinematics(in_mm, moved).condition[0]
    # Condition numbers are themselves known to about cond(J) unit roundoffs.
    assert condition == pytest.approx(legs.condition[0], rel=100 * legs.condition[0] * 2e-16)


def test_zero_leg_length_gives_infinite_condition_and_no_exception(wu2012):
    motion = at_rest(wu2012.base_anchors[0] - wu2012.platform_anchors[0])
    legs = inverse_kinematics(wu2012, motion)
    assert legs.lengths[0, 0] < 1e-16
    assert np.isinf(legs.condition[0])
