"""Lagrange's equations: that theta'' is the angular acceleration, and the laws of the two energies."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from differences import curvature, slope
from scipy.spatial.transform import Rotation

import sixsps
from sixsps import symbolic
from sixsps.bodies import Leg, Link
from sixsps.formulations import lagrange
from sixsps.kinematics import inverse_kinematics
from sixsps.rotation import skew
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Two evaluations of the same forces differ by this many cond(J) unit roundoffs at most; 8 was seen.
FACTOR = 20


def forces_of(mechanism, motion):
    return sixsps.inverse_dynamics(mechanism, motion, formulation="lagrange")


def bound(mechanism, motion):
    return FACTOR * UNIT_ROUNDOFF * inverse_kinematics(mechanism, motion).condition


@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_kane(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed, tilt=1.0)
    expected = sixsps.inverse_dynamics(mechanism, motion)
    error = np.abs(forces_of(mechanism, motion) - expected).max(axis=1) / np.abs(expected).max(axis=1)
    assert np.all(error <= bound(mechanism, motion))


@pytest.mark.parametrize("seed", range(5))
def test_world_frame_far_away_costs_no_digits(seed):
    """Beyond those that the coordinates themselves have lost, which are lost to both."""
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    far = 1e6 * mechanism.characteristic_length * np.array([1.0, -2.0, 0.5])
    mechanism = dataclasses.replace(mechanism, base_anchors=mechanism.base_anchors + far)
    motion = dataclasses.replace(motion, position=motion.position + far)
    expected = sixsps.inverse_dynamics(mechanism, motion)
    error = np.abs(forces_of(mechanism, motion) - expected).max(axis=1) / np.abs(expected).max(axis=1)
    assert np.all(error <= bound(mechanism, motion))


class TestCoordinates:
    """R(theta), from which angular velocity and acceleration come."""

    @pytest.fixture
    def rotation(self):
        theta = ca.SX.sym("theta", 3)
        function = ca.Function("rotation", [theta], [lagrange.turned_by(theta)])
        return lambda value: np.asarray(function(value))

    @pytest.mark.parametrize("seed", range(10))
    def test_is_the_cayley_transform(self, rotation, seed):
        theta = np.random.default_rng(seed).standard_normal(3)
        half = skew(theta / 2)
        expected = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
        np.testing.assert_allclose(rotation(theta), expected, atol=1e-14)
        np.testing.assert_allclose(expected @ expected.T, np.eye(3), atol=1e-14)

    @pytest.mark.parametrize("seed", range(10))
    def test_rates_of_theta_are_angular_velocity_and_acceleration_at_zero(self, rotation, seed):
        """R' = [omega]x R and R'' = ([epsilon]x + [omega]x^2) R, with differences of rotations."""
        omega, epsilon = np.random.default_rng(seed).standard_normal((2, 3))

        def at(t):
            return rotation(omega * t + epsilon * t**2 / 2)

        np.testing.assert_allclose(slope(at), skew(omega), atol=1e-11)
        np.testing.assert_allclose(curvature(at), skew(epsilon) + skew(omega) @ skew(omega), atol=1e-9)

    def test_away_from_zero_they_are_not(self, rotation):
        """Which is why the equations are written around each sample's own rotation."""
        omega, theta = np.array([0.3, -0.5, 0.8]), np.array([0.4, 0.2, -0.1])
        turning = slope(lambda t: rotation(theta + omega * t)) @ rotation(theta).T
        assert np.abs(turning - skew(omega)).max() > 0.01


def platform_alone(seed):
    """A mechanism whose legs weigh hardly anything."""
    light = Link(1e-18, 1.0, 0.5, 1e-18, 1e-19)
    return dataclasses.replace(random_mechanism(seed), legs=(Leg(light, light),) * 6)


@pytest.mark.parametrize("seed", range(5))
def test_energy_of_the_platform_alone(seed):
    """Written with angular velocity and inertia tensor, neither of which the formulation knows."""
    mechanism = platform_alone(seed)
    motion = random_motion(mechanism, seed)
    platform, R = mechanism.platform, motion.rotation
    v = motion.velocity + np.cross(motion.angular_velocity, R @ platform.com)
    omega = np.einsum("nji,nj->ni", R, motion.angular_velocity)
    spin = np.einsum("ni,ij,nj->n", omega, platform.inertia, omega)
    kinetic, potential = lagrange.evaluate(lagrange.energy(), mechanism, motion)
    expected = (platform.mass * np.sum(v * v, axis=1) + spin) / 2
    np.testing.assert_allclose(kinetic[:, 0, 0], expected, rtol=1e-10)
    height = (motion.position + R @ platform.com) @ mechanism.gravity
    np.testing.assert_allclose(potential[:, 0, 0], -platform.mass * height, rtol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_free_spinning_body_needs_no_forces(seed):
    """The platform alone falls with gravity and turns as Euler's equations have it."""
    mechanism = platform_alone(seed)
    motion = random_motion(mechanism, seed)
    platform, R, omega = mechanism.platform, motion.rotation, motion.angular_velocity
    inertia = R @ platform.inertia @ R.swapaxes(1, 2)
    gyroscopic = np.cross(omega, np.einsum("nij,nj->ni", inertia, omega))
    epsilon = -np.linalg.solve(inertia, gyroscopic[..., None])[..., 0]
    arm = R @ platform.com
    turning = np.cross(epsilon, arm) + np.cross(omega, np.cross(omega, arm))
    free = dataclasses.replace(
        motion,
        acceleration=mechanism.gravity - turning,
        angular_acceleration=epsilon,
        force=np.zeros_like(omega),
        moment=np.zeros_like(omega),
    )
    held = dataclasses.replace(free, angular_acceleration=np.zeros_like(omega))
    scale = np.abs(forces_of(mechanism, held)).max(axis=1)
    assert np.all(np.abs(forces_of(mechanism, free)).max(axis=1) <= 1e-10 * scale)


@pytest.mark.parametrize("seed", range(5))
def test_energies_equal_those_of_the_casadi_formulation(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    kinetic, potential = lagrange.evaluate(lagrange.energy(), mechanism, motion)
    expected = symbolic.evaluate(symbolic.energy(), mechanism, motion)
    np.testing.assert_allclose(kinetic[..., 0], expected["kinetic"], rtol=1e-13)
    size = np.abs(expected["potential"]).max()
    np.testing.assert_allclose(potential[..., 0], expected["potential"], atol=1e-13 * size)


@pytest.mark.parametrize("seed", range(10))
def test_power_balance(seed):
    """Actuators and load exchange with the mechanism what its energy, differenced in time, gains."""
    mechanism = random_mechanism(seed)
    start = random_motion(mechanism, seed)
    rotation = Rotation.from_matrix(start.rotation)
    omega = start.angular_velocity
    scale = 0.02 * mechanism.characteristic_length / np.abs(start.velocity).max()

    def at(t):
        """Constant acceleration; the angular velocity is constant, so that its rate is zero."""
        return dataclasses.replace(
            start,
            position=start.position + start.velocity * t + start.acceleration * t**2 / 2,
            quaternion=(Rotation.from_rotvec(omega * t) * rotation).as_quat(scalar_first=True),
            velocity=start.velocity + start.acceleration * t,
            angular_acceleration=np.zeros_like(omega),
        )

    def energy(t):
        return sum(lagrange.evaluate(lagrange.energy(), mechanism, at(t)))[:, 0, 0]

    gain = slope(lambda h: energy(h * scale)) / scale
    motion = at(0.0)
    legs = inverse_kinematics(mechanism, motion)
    actuators = forces_of(mechanism, motion) * legs.length_rates
    velocity = motion.velocity + np.cross(omega, motion.rotation @ mechanism.platform.com)
    load = np.sum(motion.force * velocity + motion.moment * omega, axis=1)
    exchanged = np.abs(actuators).sum(axis=1) + np.abs(load) + np.abs(gain)
    assert np.all(np.abs(actuators.sum(axis=1) + load - gain) <= 1e-9 * exchanged)


def accelerated(motion, acceleration):
    """The motion with this twist rate (6,) at every sample."""
    linear, angular = np.tile(acceleration, (len(motion), 1)).reshape(-1, 2, 3).swapaxes(0, 1)
    return dataclasses.replace(motion, acceleration=linear, angular_acceleration=angular)


def generalised(mechanism, motion):
    """C (n, 6), what the actuators exert along the coordinates."""
    return lagrange.evaluate(lagrange.equations(), mechanism, motion)[1][..., 0]


@pytest.mark.parametrize("seed", range(10))
def test_mass_matrix_is_symmetric_positive_definite_and_gives_the_energy(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    still = generalised(mechanism, accelerated(motion, np.zeros(6)))
    unit = np.array([1.0] * 3 + [1 / mechanism.characteristic_length] * 3)
    # Large accelerations leave few digits of what does not depend on them.
    rate = 1e3 * np.abs(motion.acceleration).max()
    columns = [generalised(mechanism, accelerated(motion, rate * axis)) - still for axis in np.diag(unit)]
    mass = np.stack(columns, axis=-1) * unit[:, None] / rate
    scale = np.abs(mass).max()
    assert np.abs(mass - mass.swapaxes(1, 2)).max() <= 1e-12 * scale
    assert np.linalg.eigvalsh(mass).min() > 1e-6 * scale
    speeds = np.hstack([motion.velocity, motion.angular_velocity]) / unit
    kinetic, _ = lagrange.evaluate(lagrange.energy(), mechanism, motion)
    expected = np.einsum("ni,nij,nj->n", speeds, mass, speeds) / 2
    np.testing.assert_allclose(kinetic[:, 0, 0], expected, rtol=1e-11)


@pytest.mark.parametrize("seed", range(10))
def test_forces_are_linear_in_the_acceleration(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    one, other = np.random.default_rng(seed).standard_normal((2, 6)) * np.abs(motion.acceleration).max()

    def forces(acceleration):
        return forces_of(mechanism, accelerated(motion, acceleration))

    parts = [forces(one), forces(other), forces(np.zeros(6))]
    difference = parts[0] + parts[1] - parts[2] - forces(one + other)
    size = sum(np.abs(part).max(axis=1) for part in parts)
    assert np.all(np.abs(difference).max(axis=1) <= bound(mechanism, motion) * size)


@pytest.mark.parametrize("seed", range(10))
def test_at_rest_and_unloaded_the_legs_carry_the_slope_of_the_potential(seed):
    """Weights lifted by small displacements of the platform, with lengths and heights differenced."""
    mechanism = random_mechanism(seed)
    state = random_motion(mechanism, seed, samples=1)
    still = at_rest(state.position[0], state.quaternion[0])
    rotation, size = Rotation.from_matrix(still.rotation), mechanism.characteristic_length
    forces = forces_of(mechanism, still)[0]
    for axis in np.eye(6):

        def displaced(h, axis=axis):
            turn = Rotation.from_rotvec(h * axis[3:]) * rotation
            return at_rest(still.position[0] + h * size * axis[:3], turn.as_quat(scalar_first=True)[0])

        def potential(h):
            return lagrange.evaluate(lagrange.energy(), mechanism, displaced(h))[1][0, 0, 0]

        def lengths(h):
            return inverse_kinematics(mechanism, displaced(h)).lengths[0]

        work = forces * slope(lengths)
        assert abs(work.sum() - slope(potential)) <= 1e-9 * np.abs(work).sum()


def test_singular_poses_give_nan_and_the_others_forces(wu2012):
    motion = bundled("line", wu2012, 5)
    position = np.array(motion.position)
    position[1] = [0.01, 0.02, 0.0]  # flat: no leg can push out of the plane
    position[3] = wu2012.base_anchors[0] - wu2012.platform_anchors[0]  # a leg of no length
    forces = forces_of(wu2012, dataclasses.replace(motion, position=position))
    assert np.isnan(forces[[1, 3]]).all()
    assert np.isfinite(forces[[0, 2, 4]]).all()
    single = forces_of(wu2012, dataclasses.replace(motion, position=position)[1:2])
    assert np.isnan(single).all()


def test_no_samples_give_no_forces(wu2012):
    empty = bundled("line", wu2012, 5)[:0]
    assert lagrange.inverse_dynamics(wu2012, empty).shape == (0, 6)
