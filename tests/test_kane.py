"""Kane's method: published numbers, laws, and the printed equations that do not hold."""

import dataclasses

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sixsps
from sixsps import symbolic
from sixsps.bodies import Leg, Link, Platform
from sixsps.formulations import kane
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import euler_rate_matrix, skew
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Two evaluations of the same forces differ by this many cond(J) unit roundoffs at most; 8 was seen.
FACTOR = 20


def assert_same_forces(mechanism, motion, forces, expected):
    condition = inverse_kinematics(mechanism, motion).condition
    bound = FACTOR * UNIT_ROUNDOFF * condition * np.abs(expected).max(axis=1)
    assert np.all(np.abs(forces - expected).max(axis=1) <= bound)


def replaced(mechanism, **changes):
    return dataclasses.replace(mechanism, **changes)


def test_design_value_at_the_start_of_the_paper_example(wu2012):
    forces = sixsps.inverse_dynamics(wu2012, bundled("line", wu2012, 2))
    expected = [111.42242, 95.50980, -70.67089, 57.29178, 46.68433, -94.22973]
    np.testing.assert_allclose(forces[0], expected, atol=5e-6)


def test_platform_alone_obeys_newton_and_euler():
    """With legs of hardly any mass, J F is the rate of the platform's momentum less the load."""
    mechanism = random_mechanism(11)
    light = Link(1e-12, 1.0, 0.5, 1e-12, 1e-13)
    mechanism = replaced(mechanism, legs=(Leg(light, light),) * 6)
    motion = random_motion(mechanism, 11)
    forces = sixsps.inverse_dynamics(mechanism, motion)
    legs = inverse_kinematics(mechanism, motion)
    platform, R = mechanism.platform, motion.rotation
    omega, epsilon = motion.angular_velocity, motion.angular_acceleration
    arm = R @ platform.com
    acceleration = motion.acceleration + np.cross(epsilon, arm) + np.cross(omega, np.cross(omega, arm))
    momentum_rate = platform.mass * (acceleration - mechanism.gravity) - motion.force
    body_omega, body_epsilon = (np.einsum("nji,nj->ni", R, vector) for vector in (omega, epsilon))
    body_moment = body_epsilon @ platform.inertia + np.cross(body_omega, body_omega @ platform.inertia)
    moment = np.einsum("nij,nj->ni", R, body_moment) - motion.moment + np.cross(arm, momentum_rate)
    wrench = np.einsum("nij,ni->nj", legs.jacobian, forces)
    np.testing.assert_allclose(wrench, np.hstack([momentum_rate, moment]), rtol=1e-9)


@given(seed=st.integers(0, 10_000))
def test_forces_do_not_depend_on_the_world_frame(seed):
    mechanism = random_mechanism(seed % 40)
    motion = random_motion(mechanism, seed)
    rng = np.random.default_rng(seed)
    rotation, shift = Rotation.random(rng=rng), rng.standard_normal(3)

    def turned(vectors):
        return vectors @ rotation.as_matrix().T

    moved_mechanism = replaced(
        mechanism,
        gravity=turned(mechanism.gravity),
        base_anchors=turned(mechanism.base_anchors) + shift,
    )
    vectors = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
    moved_motion = Motion(
        time=motion.time,
        position=turned(motion.position) + shift,
        quaternion=(rotation * Rotation.from_matrix(motion.rotation)).as_quat(scalar_first=True),
        **{name: turned(getattr(motion, name)) for name in vectors},
    )
    forces = sixsps.inverse_dynamics(moved_mechanism, moved_motion)
    # A shift of several sizes of the mechanism costs digits of its anchors' differences.
    size = 1 + np.abs(shift).max() / mechanism.characteristic_length
    expected = sixsps.inverse_dynamics(mechanism, motion)
    condition = inverse_kinematics(mechanism, motion).condition
    bound = size * FACTOR * UNIT_ROUNDOFF * condition * np.abs(expected).max(axis=1)
    assert np.all(np.abs(forces - expected).max(axis=1) <= bound)


@given(seed=st.integers(0, 10_000))
def test_forces_do_not_depend_on_the_platform_frame(seed):
    mechanism = random_mechanism(seed % 40)
    motion = random_motion(mechanism, seed)
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng)
    shift = 0.5 * mechanism.characteristic_length * rng.standard_normal(3)
    to_new = turn.inv().as_matrix()
    platform = mechanism.platform
    moved_mechanism = replaced(
        mechanism,
        platform_anchors=(mechanism.platform_anchors - shift) @ to_new.T,
        platform=Platform(
            platform.mass,
            to_new @ (platform.com - shift),
            symmetric(to_new @ platform.inertia @ to_new.T),
        ),
    )
    arm = motion.rotation @ shift
    omega, epsilon = motion.angular_velocity, motion.angular_acceleration
    turning = np.cross(omega, arm)
    moved_motion = Motion(
        time=motion.time,
        position=motion.position + arm,
        quaternion=(Rotation.from_matrix(motion.rotation) * turn).as_quat(scalar_first=True),
        velocity=motion.velocity + turning,
        angular_velocity=omega,
        acceleration=motion.acceleration + np.cross(epsilon, arm) + np.cross(omega, turning),
        angular_acceleration=epsilon,
        force=motion.force,
        moment=motion.moment,
    )
    expected = sixsps.inverse_dynamics(mechanism, motion)
    forces = sixsps.inverse_dynamics(moved_mechanism, moved_motion)
    worse = np.maximum(
        inverse_kinematics(moved_mechanism, moved_motion).condition,
        inverse_kinematics(mechanism, motion).condition,
    )
    bound = 2 * FACTOR * UNIT_ROUNDOFF * worse * np.abs(expected).max(axis=1)
    assert np.all(np.abs(forces - expected).max(axis=1) <= bound)


def symmetric(matrix):
    return (matrix + matrix.T) / 2


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("length", "mass", "time"), [(1000, 1, 1), (1, 1000, 1), (1, 1, 60), (0.3, 7, 2)])
def test_forces_scale_with_the_units(seed, length, mass, time):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    force, moment_of_inertia = mass * length / time**2, mass * length**2

    def scaled(link):
        return Link(
            link.mass * mass,
            link.length * length,
            link.com * length,
            link.transverse * moment_of_inertia,
            link.axial * moment_of_inertia,
        )

    platform = mechanism.platform
    other_mechanism = Mechanism(
        name="other units",
        gravity=mechanism.gravity * length / time**2,
        base_anchors=mechanism.base_anchors * length,
        platform_anchors=mechanism.platform_anchors * length,
        platform=Platform(platform.mass * mass, platform.com * length, platform.inertia * moment_of_inertia),
        legs=tuple(Leg(scaled(leg.lower), scaled(leg.upper)) for leg in mechanism.legs),
    )
    other_motion = Motion(
        time=motion.time * time,
        position=motion.position * length,
        quaternion=motion.quaternion,
        velocity=motion.velocity * length / time,
        angular_velocity=motion.angular_velocity / time,
        acceleration=motion.acceleration * length / time**2,
        angular_acceleration=motion.angular_acceleration / time**2,
        force=motion.force * force,
        moment=motion.moment * force * length,
    )
    expected = force * sixsps.inverse_dynamics(mechanism, motion)
    forces = sixsps.inverse_dynamics(other_mechanism, other_motion)
    assert_same_forces(mechanism, motion, forces, expected)


@pytest.mark.parametrize("seed", range(10))
def test_running_the_motion_backwards_takes_the_same_forces(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    backwards = dataclasses.replace(
        motion, velocity=-motion.velocity, angular_velocity=-motion.angular_velocity
    )
    forces = sixsps.inverse_dynamics(mechanism, backwards)
    assert_same_forces(mechanism, motion, forces, sixsps.inverse_dynamics(mechanism, motion))


def test_axial_inertia_does_nothing():
    mechanism = random_mechanism(4)
    motion = random_motion(mechanism, 4)
    slim = tuple(
        Leg(dataclasses.replace(leg.lower, axial=1e-9), dataclasses.replace(leg.upper, axial=1e-9))
        for leg in mechanism.legs
    )
    expected = sixsps.inverse_dynamics(mechanism, motion)
    assert np.array_equal(sixsps.inverse_dynamics(replaced(mechanism, legs=slim), motion), expected)


def test_one_sample_gives_what_it_gives_among_others(mechanism):
    motion = bundled("sinusoids", mechanism, 50)
    forces = sixsps.inverse_dynamics(mechanism, motion)
    single = sixsps.inverse_dynamics(mechanism, motion[17:18])
    assert_same_forces(mechanism, motion[17:18], single, forces[17:18])


@pytest.mark.parametrize("name", ["line", "sinusoids", "quintic", "circle", "spiral"])
def test_power_balance(mechanism, name):
    """Forces times length rates and the load's power are the rate of energy, which knows no forces."""
    motion = bundled(name, mechanism, 200)
    forces = sixsps.inverse_dynamics(mechanism, motion)
    assert_power_balances(mechanism, motion, forces)


@pytest.mark.parametrize("seed", range(20))
def test_power_balance_of_random_states(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    assert_power_balances(mechanism, motion, sixsps.inverse_dynamics(mechanism, motion))


def assert_power_balances(mechanism, motion, forces):
    legs = inverse_kinematics(mechanism, motion)
    rate = symbolic.evaluate(symbolic.energy_rate(), mechanism, motion)["rate"][:, 0]
    arm = motion.rotation @ mechanism.platform.com
    velocity = motion.velocity + np.cross(motion.angular_velocity, arm)
    actuators = forces * legs.length_rates
    load = np.sum(motion.force * velocity + motion.moment * motion.angular_velocity, axis=1)
    exchanged = np.abs(actuators).sum(axis=1) + np.abs(load) + np.abs(rate)
    bound = FACTOR * UNIT_ROUNDOFF * legs.condition * exchanged
    assert np.all(np.abs(actuators.sum(axis=1) + load - rate) <= bound)


class TestSingularPoses:
    def test_flat_hexapod_gives_nan_and_no_exception(self, wu2012):
        """With base and platform in one plane no leg can push the platform out of it."""
        flat = at_rest([0.01, 0.02, 0.0])
        assert inverse_kinematics(wu2012, flat).condition[0] > 1e12
        assert np.isnan(sixsps.inverse_dynamics(wu2012, flat)).all()

    def test_only_the_singular_sample_is_lost(self, wu2012):
        motion = bundled("line", wu2012, 5)
        position = np.array(motion.position)
        position[2] = [0.01, 0.02, 0.0]
        forces = sixsps.inverse_dynamics(wu2012, dataclasses.replace(motion, position=position))
        assert np.isnan(forces[2]).all()
        assert np.isfinite(np.delete(forces, 2, axis=0)).all()

    def test_zero_leg_length(self, wu2012):
        motion = at_rest(wu2012.base_anchors[0] - wu2012.platform_anchors[0])
        assert np.isnan(sixsps.inverse_dynamics(wu2012, motion)).all()


class TestErrata:
    """What the paper prints, against what holds; velocities come from differentiated positions."""

    @pytest.fixture
    def state(self):
        mechanism = random_mechanism(8)
        motion = random_motion(mechanism, 8)
        legs = inverse_kinematics(mechanism, motion)
        twist = np.hstack([motion.velocity, motion.angular_velocity])
        return mechanism, motion, legs, twist

    def test_partial_velocities_give_velocities(self, state):
        mechanism, motion, legs, twist = state
        partial = kane.partial_velocities(mechanism, motion, legs)
        for matrix, velocity in (
            (partial.leg, legs.leg_angular_velocity),
            (partial.lower, legs.lower_velocity),
            (partial.upper, legs.upper_velocity),
        ):
            found = np.einsum("nkij,nj->nki", matrix, twist)
            np.testing.assert_allclose(found, velocity, atol=1e-13 * np.abs(velocity).max())

    def test_equation_15_with_the_printed_sign_fails(self, state):
        mechanism, _, legs, twist = state
        s, c = legs.directions, legs.arms
        printed = np.sum(s * c, -1)[..., None, None] * np.eye(3) + c[..., :, None] * s[..., None, :]
        lower_com = mechanism.lower.com[:, None, None]
        linear = np.eye(3) - s[..., :, None] * s[..., None, :]
        matrix = (
            lower_com / legs.lengths[..., None, None] * np.concatenate([linear, -skew(s) @ printed], axis=-1)
        )
        found = np.einsum("nkij,nj->nki", matrix, twist)
        error = np.abs(found - legs.lower_velocity).max() / np.abs(legs.lower_velocity).max()
        assert error > 0.01

    def test_platform_com_left_in_platform_axes_fails(self, state):
        mechanism, motion, legs, _ = state
        partial = kane.partial_velocities(mechanism, motion, legs)
        turned = motion.rotation @ mechanism.platform.com
        np.testing.assert_allclose(-partial.platform[:, :, 3:], skew(turned), atol=1e-15)
        unturned = skew(np.broadcast_to(mechanism.platform.com, turned.shape))
        assert np.abs(unturned - skew(turned)).max() > 0.1 * np.abs(turned).max()

    def test_inertia_left_in_platform_axes_fails(self, state):
        mechanism, motion, _, _ = state
        platform = mechanism.platform
        # In world axes but unturned: what eqs. 27-29 print.
        correct = symbolic_forces(mechanism, motion)
        R = motion.rotation[0]
        unturned = replaced(
            mechanism,
            platform=Platform(platform.mass, platform.com, symmetric(R.T @ platform.inertia @ R)),
        )
        printed = sixsps.inverse_dynamics(unturned, motion[:1])[0]
        ours = sixsps.inverse_dynamics(mechanism, motion[:1])[0]
        assert np.abs(printed - correct[0]).max() > 1e-4 * np.abs(correct[0]).max()
        assert_same_forces(mechanism, motion[:1], ours[None], correct[:1])

    def test_dropping_the_external_force_from_the_moment_rows_fails(self, state):
        mechanism, motion, legs, _ = state
        wrench = kane.actuator_wrench(mechanism, motion, legs)
        unloaded = dataclasses.replace(motion, force=np.zeros_like(motion.force))
        difference = wrench - kane.actuator_wrench(mechanism, unloaded, legs)
        arm = motion.rotation @ mechanism.platform.com
        moment = -np.cross(arm, motion.force)
        np.testing.assert_allclose(difference[:, :3], -motion.force, rtol=1e-9)
        scale = np.abs(wrench).max()
        np.testing.assert_allclose(difference[:, 3:], moment, atol=1e-13 * scale)
        assert np.abs(moment).max() > 0

    def test_angular_velocity_is_not_the_euler_rates(self, state):
        _, motion, _, _ = state
        angles = Rotation.from_matrix(motion.rotation).as_euler("XYZ")
        omega = motion.angular_velocity
        rates = np.linalg.solve(euler_rate_matrix(angles), omega[..., None])[..., 0]
        assert np.abs(rates - omega).max() > 0.01 * np.abs(omega).max()


def symbolic_forces(mechanism, motion):
    return symbolic.evaluate(symbolic.forces(), mechanism, motion)["F"]


def test_unknown_formulation_names_those_that_exist(wu2012):
    with pytest.raises(sixsps.UnknownNameError, match="kane"):
        sixsps.inverse_dynamics(wu2012, bundled("line", wu2012, 3), formulation="lagrnage")
