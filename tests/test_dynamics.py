"""Forward dynamics of the platform: the inverse of the inverse, derivatives of CasADi, laws of mechanics."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from cases import BUNDLED, random_mechanism, random_motion, scaled
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_newton_euler import OpenTree

import sixsps
from sixsps import symbolic
from sixsps.bodies import Leg, Link
from sixsps.dynamics import (
    State,
    bias,
    forward_dynamics,
    kinetic_energy,
    mass_matrix,
    potential_energy,
)
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.rotation import skew
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Seen were 0.7 on the way there and 0.6 on the way back, on 300 random mechanisms; see `assert_inverses`.
FACTOR = 10
NAMES = [*BUNDLED, *range(20)]


def drawn(name):
    """A bundled mechanism by its name or a random one by its seed, with unrelated states of it."""
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    return mechanism, random_motion(mechanism, 7)


def accelerations(motion):
    return np.hstack([motion.acceleration, motion.angular_acceleration])


def twists(motion):
    return np.hstack([motion.velocity, motion.angular_velocity])


def load_wrench(mechanism, motion):
    arm = motion.rotation @ mechanism.platform.com
    return np.hstack([motion.force, motion.moment + np.cross(arm, motion.force)])


def scale_of(mechanism):
    """Divides moments, and multiplies angles, by a length of the mechanism."""
    return np.repeat([1.0, 1 / mechanism.characteristic_length], 3)


def still(motion):
    """The same poses at rest, unaccelerated and without load."""
    zero = np.zeros_like(motion.position)
    names = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
    return dataclasses.replace(motion, **dict.fromkeys(names, zero))


def moving(motion, twist):
    """The same poses with one and the same twist, unaccelerated and without load."""
    velocity, omega = np.broadcast_to(twist, (len(motion), 6)).reshape(-1, 2, 3).swapaxes(0, 1)
    return dataclasses.replace(still(motion), velocity=velocity, angular_velocity=omega)


class TestInverses:
    """Inverse and forward dynamics, one after the other."""

    @pytest.mark.parametrize("name", BUNDLED)
    @pytest.mark.parametrize("path", ["line", "sinusoids", "spiral"])
    def test_on_bundled_mechanisms(self, name, path):
        mechanism = Mechanism.load(name)
        assert_inverses(mechanism, bundled(path, mechanism, 50))

    def test_on_100_random_mechanisms(self):
        for seed in range(100):
            mechanism = random_mechanism(seed)
            assert_inverses(mechanism, random_motion(mechanism, seed, tilt=1.0))

    @pytest.mark.parametrize("length", [1e-3, 1e3])
    def test_whatever_the_unit_of_length(self, wu2012, length):
        mechanism = scaled(wu2012, length, 1.0)
        assert_inverses(mechanism, random_motion(mechanism, 5, samples=20))

    @pytest.mark.parametrize("distance", [1e-2, 1e-5, 1e-8])
    def test_near_a_singularity(self, wu2012, distance):
        motion = random_motion(wu2012, 3, samples=10)
        position = np.array(motion.position)
        position[:, 2] = distance
        flat = dataclasses.replace(motion, position=position, quaternion=np.tile([1.0, 0, 0, 0], (10, 1)))
        assert_inverses(wu2012, flat)


def assert_inverses(mechanism, motion):
    """Rounding of the wrenches that are summed, times the condition of what is solved.

    M is backward stable to solve: the wrench that its accelerations need is off by rounding of the
    wrenches that went in. The accelerations are off by the inverse of M times that, and leg forces
    worked out from them again by the inverse of J times that: cond(M) and cond(J) in metric units.
    """
    scale = scale_of(mechanism)
    legs = inverse_kinematics(mechanism, motion)
    J = np.swapaxes(legs.jacobian, 1, 2) * scale[:, None]
    M = scale[:, None] * mass_matrix(mechanism, motion.position, motion.rotation) * scale
    forces = sixsps.inverse_dynamics(mechanism, motion)
    summed = np.linalg.norm(np.abs(J) @ np.abs(forces)[..., None], axis=(1, 2))
    for wrench in (bias(mechanism, State.of(motion)), load_wrench(mechanism, motion)):
        summed += np.linalg.norm(scale * wrench, axis=1)
    rounding = FACTOR * UNIT_ROUNDOFF * (1 + legs.coordinates / legs.lengths.min(axis=1)) * summed

    found = forward_dynamics(mechanism, State.of(motion), forces, motion.force, motion.moment)
    error = np.linalg.norm((found - accelerations(motion)) / scale, axis=1)
    assert np.all(error <= rounding * np.linalg.norm(np.linalg.inv(M), 2, axis=(1, 2)))

    onwards = dataclasses.replace(motion, acceleration=found[:, :3], angular_acceleration=found[:, 3:])
    error = np.linalg.norm(sixsps.inverse_dynamics(mechanism, onwards) - forces, axis=1)
    assert np.all(error <= rounding * np.linalg.norm(np.linalg.inv(J), 2, axis=(1, 2)))


class TestMassMatrix:
    @given(seed=st.integers(0, 10_000))
    def test_is_symmetric_and_more_than_the_platforms(self, seed):
        """Legs can only add inertia, so that M is positive definite wherever they have a direction."""
        mechanism = random_mechanism(seed % 40)
        motion = random_motion(mechanism, seed, samples=3, tilt=2.0)
        found = mass_matrix(mechanism, motion.position, motion.rotation)
        assert np.array_equal(found, np.swapaxes(found, 1, 2))
        scale = scale_of(mechanism)
        total, alone = (scale[:, None] * M * scale for M in (found, platform_alone(mechanism, motion)))
        assert np.linalg.eigvalsh(total).min() > 0
        added = np.linalg.eigvalsh(total - alone)
        assert np.all(added[:, 0] >= -FACTOR * UNIT_ROUNDOFF * np.linalg.eigvalsh(total)[:, -1])

    @pytest.mark.parametrize("name", NAMES)
    def test_is_the_derivative_of_the_casadi_model(self, name):
        mechanism, motion = drawn(name)
        exact = symbolic.evaluate(wrench_by_acceleration(), mechanism, motion)["M"]
        found = mass_matrix(mechanism, motion.position, motion.rotation)
        assert_same_matrix(mechanism, found, exact)

    @pytest.mark.parametrize("name", NAMES)
    def test_is_the_projection_of_a_tree_in_pinocchio(self, name):
        pin = pytest.importorskip("pinocchio")
        mechanism, motion = drawn(name)
        tree = OpenTree(pin, mechanism)
        units = [moving(motion, unit) for unit in np.eye(6)]
        legs = [inverse_kinematics(mechanism, unit) for unit in units]
        exact = []
        for k in range(len(motion)):
            states = [tree.state(unit, leg, k) for unit, leg in zip(units, legs, strict=True)]
            N = np.column_stack([v for _, v, _, _ in states])
            upper = np.triu(pin.crba(tree.model, tree.data, states[0][0]))
            exact.append(N.T @ (upper + np.triu(upper, 1).T) @ N)
        found = mass_matrix(mechanism, motion.position, motion.rotation)
        assert_same_matrix(mechanism, found, np.array(exact))

    def test_is_what_unit_accelerations_need(self, mechanism):
        """J F - C of inverse dynamics is affine in the acceleration: differences are exact."""
        motion = still(random_motion(mechanism, 2))
        jacobian = inverse_kinematics(mechanism, motion).jacobian
        floating = dataclasses.replace(mechanism, gravity=[0, 0, 0])
        columns = []
        for unit in np.eye(6):
            push = np.broadcast_to(unit, (len(motion), 6))
            pushed = dataclasses.replace(motion, acceleration=push[:, :3], angular_acceleration=push[:, 3:])
            forces = sixsps.inverse_dynamics(floating, pushed, "newton-euler")
            columns.append(np.einsum("nij,ni->nj", jacobian, forces))
        found = mass_matrix(mechanism, motion.position, motion.rotation)
        assert_same_matrix(mechanism, found, np.stack(columns, axis=2))

    def test_of_a_platform_on_massless_legs(self):
        mechanism = on_massless_legs(random_mechanism(3))
        motion = random_motion(mechanism, 3)
        found = mass_matrix(mechanism, motion.position, motion.rotation)
        assert_same_matrix(mechanism, found, platform_alone(mechanism, motion))

    def test_reads_no_gravity(self):
        mechanism, motion = drawn(2)
        floating = dataclasses.replace(mechanism, gravity=[0, 0, 0])
        here, there = (mass_matrix(each, motion.position, motion.rotation) for each in (mechanism, floating))
        assert np.array_equal(here, there)


def assert_same_matrix(mechanism, found, exact):
    scale = scale_of(mechanism)
    found, exact = (scale[:, None] * matrix * scale for matrix in (found, exact))
    largest = np.abs(exact).max(axis=(1, 2))
    assert np.all(np.abs(found - exact).max(axis=(1, 2)) <= 1e-11 * largest)


def wrench_by_acceleration():
    """The CasADi model's generalised forces C, differentiated with respect to [a; epsilon]."""
    equations = symbolic.equations()
    names = equations.name_in()
    inputs = [ca.MX.sym(name, *equations.size_in(name)) for name in names]
    C = equations(*inputs)[equations.index_out("C")]
    slope = ca.densify(ca.jacobian(C, inputs[names.index("acceleration")]))
    return ca.Function("by_acceleration", inputs, [slope], names, ["M"])


def platform_alone(mechanism, motion):
    """Inertia of the platform about O1, from its inertia about the centre of mass."""
    platform, R = mechanism.platform, motion.rotation
    m, arm = platform.mass, skew(R @ platform.com)
    M = np.zeros((len(motion), 6, 6))
    M[:, :3, :3] = m * np.eye(3)
    M[:, 3:, :3] = m * arm
    M[:, :3, 3:] = -m * arm
    M[:, 3:, 3:] = R @ platform.inertia @ np.swapaxes(R, 1, 2) - m * arm @ arm
    return M


def on_massless_legs(mechanism):
    light = Link(1e-14, 1.0, 0.5, 1e-14, 1e-15)
    return dataclasses.replace(mechanism, legs=(Leg(light, light),) * 6)


class TestBias:
    @pytest.mark.parametrize("name", NAMES)
    def test_is_that_of_the_casadi_model(self, name):
        mechanism, motion = drawn(name)
        unloaded = dataclasses.replace(still(motion), velocity=motion.velocity)
        unloaded = dataclasses.replace(unloaded, angular_velocity=motion.angular_velocity)
        exact = symbolic.evaluate(symbolic.equations(), mechanism, unloaded)["C"]
        assert_same_wrench(mechanism, bias(mechanism, State.of(motion)), exact)

    @pytest.mark.parametrize("name", NAMES)
    def test_at_rest_is_the_gradient_of_potential_energy(self, name):
        """Energy's rate along unit twists, less that of the same mechanism without gravity."""
        mechanism, motion = drawn(name)
        floating = dataclasses.replace(mechanism, gravity=[0, 0, 0])
        gradient = np.column_stack(
            [energy_rate(mechanism, along) - energy_rate(floating, along) for along in along_units(motion)]
        )
        assert_same_wrench(mechanism, bias(mechanism, State.of(still(motion))), gradient)

    def test_at_rest_holds_a_platform_on_massless_legs(self):
        mechanism = on_massless_legs(random_mechanism(3))
        motion = still(random_motion(mechanism, 3))
        weight = mechanism.platform.mass * mechanism.gravity
        arm = motion.rotation @ mechanism.platform.com
        expected = -np.hstack([np.broadcast_to(weight, arm.shape), np.cross(arm, weight)])
        assert_same_wrench(mechanism, bias(mechanism, State.of(motion)), expected)

    def test_at_rest_without_gravity_is_nothing(self, mechanism):
        floating = dataclasses.replace(mechanism, gravity=[0, 0, 0])
        motion = still(random_motion(mechanism, 1))
        assert np.array_equal(bias(floating, State.of(motion)), np.zeros((len(motion), 6)))

    @pytest.mark.parametrize("name", NAMES)
    @pytest.mark.parametrize("speed", [-1.0, 0.25, 8.0])
    def test_less_gravity_grows_with_the_square_of_speed(self, name, speed):
        mechanism, motion = drawn(name)
        mechanism = dataclasses.replace(mechanism, gravity=[0, 0, 0])
        faster = dataclasses.replace(
            motion, velocity=speed * motion.velocity, angular_velocity=speed * motion.angular_velocity
        )
        once = bias(mechanism, State.of(motion))
        assert_same_wrench(mechanism, bias(mechanism, State.of(faster)), speed**2 * once, 1e-13)

    @pytest.mark.parametrize("name", NAMES)
    def test_is_gravity_and_velocity_terms_by_themselves(self, name):
        mechanism, motion = drawn(name)
        floating = dataclasses.replace(mechanism, gravity=[0, 0, 0])
        gravity, velocity = bias(mechanism, State.of(still(motion))), bias(floating, State.of(motion))
        assert_same_wrench(mechanism, bias(mechanism, State.of(motion)), gravity + velocity, 1e-13)

    @pytest.mark.parametrize("name", NAMES)
    def test_velocity_terms_do_the_work_that_a_changing_mass_matrix_takes(self, name):
        """v^T (dM/dt) v = 2 v^T (bias - gravity): dM/dt - 2C is skew."""
        mechanism, motion = drawn(name)
        floating = dataclasses.replace(mechanism, gravity=[0, 0, 0])
        speed = np.linalg.norm(scale_of(mechanism) ** -1 * twists(motion), axis=1).max()
        step = 1e-2 * mechanism.characteristic_length / speed

        def at(time):
            turn = Rotation.from_rotvec(time * motion.angular_velocity)
            rotation = (turn * Rotation.from_matrix(motion.rotation)).as_matrix()
            return mass_matrix(mechanism, motion.position + time * motion.velocity, rotation)

        slope = sum(weight * (at(k * step) - at(-k * step)) for k, weight in WEIGHTS.items()) / step
        v = twists(motion)
        left = np.einsum("ni,nij,nj->n", v, slope, v)
        right = 2 * np.sum(v * bias(floating, State.of(motion)), axis=1)
        size = np.einsum("ni,nij,nj->n", np.abs(v), np.abs(slope), np.abs(v))
        assert np.all(np.abs(left - right) <= 1e-8 * size)


# Eighth-order central difference: error of order step^8, rounding of order unit roundoff / step.
WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}


def assert_same_wrench(mechanism, found, exact, tolerance=1e-11):
    scale = scale_of(mechanism)
    largest = np.abs(scale * exact).max(axis=1)
    assert np.all(np.abs(scale * (found - exact)).max(axis=1) <= tolerance * largest)


def along_units(motion):
    return [moving(motion, unit) for unit in np.eye(6)]


def energy_rate(mechanism, motion):
    return symbolic.evaluate(symbolic.energy_rate(), mechanism, motion)["rate"][:, 0]


def total_mass(mechanism):
    return mechanism.platform.mass + mechanism.lower.mass.sum() + mechanism.upper.mass.sum()


@pytest.mark.parametrize("name", NAMES)
def test_nothing_depends_on_the_world_frame(name):
    mechanism, motion = drawn(name)
    rng = np.random.default_rng(11)
    Q, shift = Rotation.random(rng=rng).as_matrix(), mechanism.characteristic_length * rng.standard_normal(3)

    def turned(vectors):
        return vectors @ Q.T

    there = dataclasses.replace(
        mechanism,
        gravity=turned(mechanism.gravity),
        base_anchors=turned(mechanism.base_anchors) + shift,
    )
    here_state, rotation = State.of(motion), Q @ motion.rotation
    state = State(
        turned(motion.position) + shift,
        Rotation.from_matrix(rotation).as_quat(scalar_first=True),
        turned(motion.velocity),
        turned(motion.angular_velocity),
    )
    both = np.kron(np.eye(2), Q)
    M = mass_matrix(mechanism, motion.position, motion.rotation)
    assert_same_matrix(mechanism, mass_matrix(there, state.position, rotation), both @ M @ both.T)
    assert_same_wrench(there, bias(there, state), bias(mechanism, here_state) @ both.T)
    forces = 100 * rng.standard_normal((len(motion), 6))
    found = forward_dynamics(there, state, forces, turned(motion.force), turned(motion.moment))
    expected = forward_dynamics(mechanism, here_state, forces, motion.force, motion.moment) @ both.T
    metric = 1 / scale_of(mechanism)
    np.testing.assert_allclose(
        metric * found, metric * expected, atol=1e-11 * np.abs(metric * expected).max()
    )
    np.testing.assert_allclose(
        kinetic_energy(there, state), kinetic_energy(mechanism, here_state), rtol=1e-12
    )
    lifted = potential_energy(there, state.position, rotation) - potential_energy(
        mechanism, motion.position, motion.rotation
    )
    expected_lift = -total_mass(mechanism) * turned(mechanism.gravity) @ shift
    np.testing.assert_allclose(lifted, expected_lift, rtol=1e-9)
