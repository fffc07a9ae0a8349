"""One contract for every engine of forward dynamics, and what is special about two of them."""

import os
from dataclasses import replace

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion, scaled

import sixsps
from compare.forward import FORWARD
from compare.registry import load_entry
from sixsps.bodies import Leg, Link
from sixsps.dynamics import State, bias, kinetic_energy, mass_matrix, potential_energy
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled, fitted

UNIT_ROUNDOFF = 2.0**-53
# Error of M [a; epsilon] allowed, over the sum of the magnitudes of its terms. Measured: 2.8 and 25 unit
# roundoffs on the 200 random hexapods; Pinocchio's comes with accelerations of 30 coordinates that are
# much larger before the closures take them back. MuJoCo's softness, 1e-4 times 1e-7, gives 6e-12.
ERROR = {"closed-form": 10 * UNIT_ROUNDOFF, "pinocchio": 100 * UNIT_ROUNDOFF, "mujoco": 2e-11}
# Of `recover`, over the largest planned acceleration; MuJoCo's, which goes with the forces, in m/s^2.
RECOVERED = 1e-9
NAMES = [name for name in FORWARD if name != "exudyn"]
NOTHING = np.zeros(6), np.zeros(3), np.zeros(3)
ALL_REQUIRED = "SIXSPS_REQUIRE_ENGINES"


def load(name):
    try:
        return load_entry(name, FORWARD[name])
    except sixsps.EngineUnavailable as error:
        if os.environ.get(ALL_REQUIRED):
            raise
        pytest.skip(str(error))


@pytest.fixture(params=NAMES)
def engine(request):
    """Name and class of each engine; a skip with its reason where it is not installed."""
    return request.param, load(request.param)


@pytest.fixture(params=["pinocchio", "mujoco"])
def tree_engine(request):
    """Class of each engine that opens loops."""
    return load(request.param)


def state(motion, k=0):
    return State.of(motion[k : k + 1])


def accelerations(engine, motion, forces):
    """(n, 6) of an engine, each sample from the state that the motion has there."""
    return np.array(
        [
            engine.acceleration(
                engine.initial(state(motion, k)), forces[k], motion.force[k], motion.moment[k]
            )
            for k in range(len(motion))
        ]
    )


def planned(motion):
    return np.hstack([motion.acceleration, motion.angular_acceleration])


def scales(mechanism):
    """(6,) what makes [a; epsilon] all accelerations [m/s^2]."""
    return np.repeat([1.0, mechanism.characteristic_length], 3)


def terms(mechanism, motion, forces):
    """(n,) the largest that M [a; epsilon] = J F + W - bias can be off by a relative error of its terms.

    A motion near a singularity has forces as large as cond(J), which is how that number comes in.
    """
    jacobian = inverse_kinematics(mechanism, motion).jacobian
    arm = motion.rotation @ mechanism.platform.com
    wrench = np.hstack([motion.force, motion.moment + np.cross(arm, motion.force)])
    size = np.einsum("nij,ni->nj", np.abs(jacobian), np.abs(forces))
    size = (size + np.abs(wrench) + np.abs(bias(mechanism, State.of(motion)))) / scales(mechanism)
    M = mass_matrix(mechanism, motion.position, motion.rotation)
    scaled_matrix = M / scales(mechanism) / scales(mechanism)[:, None]
    return size.max(axis=1) / np.linalg.eigvalsh(scaled_matrix)[:, 0]


def assert_inverse_of_inverse(name, make, mechanism, motion):
    forces = sixsps.inverse_dynamics(mechanism, motion)
    error = (accelerations(make(mechanism), motion, forces) - planned(motion)) * scales(mechanism)
    growth = np.abs(error).max(axis=1) / terms(mechanism, motion, forces)
    assert np.all(growth <= ERROR[name]), (mechanism.name, growth.max())


class TestAccelerations:
    def test_are_the_inverse_of_inverse_dynamics_on_200_random_mechanisms(self, engine):
        for seed in range(200):
            mechanism = random_mechanism(seed)
            assert_inverse_of_inverse(*engine, mechanism, random_motion(mechanism, seed))

    @pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8])
    def test_stay_regular_where_inverse_dynamics_does_not(self, engine, distance, wu2012):
        """The hexapod folded flat but for `distance`: forces grow as 1/distance, and errors with them."""
        motion = bundled("sinusoids", wu2012, 7)
        position = np.array(motion.position)
        position[:, 2] = distance
        still = np.tile([1.0, 0, 0, 0], (7, 1))
        assert_inverse_of_inverse(*engine, wu2012, replace(motion, position=position, quaternion=still))

    @pytest.mark.parametrize("length", [1e-3, 1e3])
    def test_do_not_depend_on_the_unit_of_length(self, engine, length, wu2012):
        mechanism = scaled(wu2012, length, 1.0)
        assert_inverse_of_inverse(*engine, mechanism, random_motion(mechanism, 5))

    @pytest.mark.parametrize("motion", ["line", "sinusoids", "recorded"])
    def test_are_recovered_along_bundled_motions(self, engine, motion, mechanism, request):
        name, make = engine
        if motion == "recorded":
            given = fitted(request.getfixturevalue("recorded"), mechanism)[::20]
        else:
            given = bundled(motion, mechanism, 101)
        forces = sixsps.inverse_dynamics(mechanism, given)
        error = np.abs(accelerations(make(mechanism), given, forces) - planned(given)).max()
        assert error <= RECOVERED * (1.0 if name == "mujoco" else np.abs(planned(given)).max())

    def test_far_from_the_origin_lose_what_the_coordinates_lose(self, engine, wu2012):
        name, make = engine
        shift = np.array([3e3, -1e4, 2e3])
        motion = bundled("sinusoids", wu2012, 10)
        forces = sixsps.inverse_dynamics(wu2012, motion)
        far = replace(wu2012, base_anchors=wu2012.base_anchors + shift)
        moved = replace(motion, position=motion.position + shift)
        error = np.abs((accelerations(make(far), moved, forces) - planned(motion)) * scales(wu2012))
        coordinates = UNIT_ROUNDOFF * np.abs(shift).max() / inverse_kinematics(wu2012, motion).lengths.min()
        allowed = (ERROR[name] + 4 * coordinates) * terms(wu2012, motion, forces)
        assert np.all(error.max(axis=1) <= allowed)

    def test_are_linear_in_forces_and_wrench(self, engine):
        name, make = engine
        mechanism = random_mechanism(3)
        motion = random_motion(mechanism, 3)
        forces = sixsps.inverse_dynamics(mechanism, motion)
        engine = make(mechanism)
        y = engine.initial(state(motion))
        inputs = [(forces[k], motion.force[k], motion.moment[k]) for k in range(2)]
        first, second, none = (engine.acceleration(y, *given) for given in (*inputs, NOTHING))
        mixed = engine.acceleration(y, *(3 * a - 2 * b for a, b in zip(*inputs, strict=True)))
        largest = max(np.abs(a).max() for a in (first, second, none))
        # What softness takes off is linear, too: rounding and the closures' gaps are left.
        allowed = 1e-11 if name == "mujoco" else 1e-13
        np.testing.assert_allclose(mixed, 3 * first - 2 * second, rtol=0, atol=10 * allowed * largest)

    def test_leg_forces_are_worth_their_wrench(self, engine):
        """J F as an external wrench instead of F: the platform cannot tell them apart."""
        name, make = engine
        mechanism = random_mechanism(4)
        motion = random_motion(mechanism, 4)
        forces = sixsps.inverse_dynamics(mechanism, motion)[0]
        legs = inverse_kinematics(mechanism, motion)
        force, about_origin = np.split(legs.jacobian[0].T @ forces, 2)
        moment = about_origin - np.cross(motion.rotation[0] @ mechanism.platform.com, force)
        engine = make(mechanism)
        y = engine.initial(state(motion))
        pushed = engine.acceleration(y, np.zeros(6), force, moment)
        driven = engine.acceleration(y, forces, np.zeros(3), np.zeros(3))
        size = terms(mechanism, motion, np.tile(forces, (len(motion), 1)))[0] / scales(mechanism)
        assert np.all(np.abs(pushed - driven) <= 2 * ERROR[name] * size)

    def test_free_fall_with_legs_of_next_to_no_mass(self, engine):
        mechanism = random_mechanism(5)
        light = replace(mechanism, legs=tuple(lighter(leg, 1e-9) for leg in mechanism.legs))
        engine = engine[1](light)
        y = engine.initial(state(at_rest(home_position(light), [0.8, 0.0, -0.6, 0.0])))
        fall = engine.acceleration(y, *NOTHING)
        np.testing.assert_allclose(fall[:3], mechanism.gravity, atol=1e-7)
        np.testing.assert_allclose(fall[3:] * mechanism.characteristic_length, 0, atol=1e-7)

    def test_nothing_pushes_nothing_moves(self, engine, wu2012):
        floating = replace(wu2012, gravity=np.zeros(3))
        engine = engine[1](floating)
        y = engine.initial(state(at_rest(home_position(floating))))
        # MuJoCo pushes what rounding leaves of the gaps together.
        np.testing.assert_allclose(engine.acceleration(y, *NOTHING), 0, atol=1e-9)

    def test_do_not_depend_on_what_was_asked_before(self, engine):
        mechanism = random_mechanism(6)
        motion = random_motion(mechanism, 6)
        engine = engine[1](mechanism)
        first, second = (engine.initial(state(motion, k)) for k in range(2))
        before = engine.rates(first, *NOTHING)
        engine.rates(second, np.ones(6), np.ones(3), np.ones(3))
        assert np.array_equal(engine.rates(first, *NOTHING), before)


def lighter(leg, factor):
    def link(half):
        inertia = factor * half.transverse, factor * half.axial
        return Link(factor * half.mass, half.length, half.com, *inertia)

    return Leg(link(leg.lower), link(leg.upper), leg.length_limits)


class TestState:
    def test_is_the_one_that_was_set(self, engine):
        for seed in range(20):
            mechanism = random_mechanism(seed)
            motion = random_motion(mechanism, seed)
            engine_of_it = engine[1](mechanism)
            for k in range(len(motion)):
                found = engine_of_it.platform(engine_of_it.initial(state(motion, k)))
                assert len(found) == 1
                for name in ("position", "quaternion", "velocity", "angular_velocity"):
                    expected = getattr(motion, name)[k]
                    size = np.abs(mechanism.base_anchors).max() if name == "position" else 0
                    size += np.abs(expected).max()
                    np.testing.assert_allclose(getattr(found, name)[0], expected, atol=4e-16 * size)

    def test_closes_the_loops(self, engine, mechanism):
        motion = bundled("sinusoids", mechanism, 10)
        engine = engine[1](mechanism)
        size = np.abs(mechanism.base_anchors).max()
        for k in range(len(motion)):
            assert engine.closure_error(engine.initial(state(motion, k))) <= 1e-14 * size

    def test_closure_error_is_the_gap_of_a_loop(self, tree_engine, wu2012):
        engine = tree_engine(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        y[engine._positions[2]] += 1e-3
        assert engine.closure_error(y) == pytest.approx(1e-3, rel=1e-9)

    def test_quaternions_of_any_length_mean_the_same(self, engine):
        name, make = engine
        mechanism = random_mechanism(8)
        motion = random_motion(mechanism, 8)
        engine = make(mechanism)
        y = engine.initial(state(motion))
        quaternions = np.arange(3, 7) if name == "closed-form" else engine._quaternions
        longer = y.copy()
        longer[quaternions] *= 3
        np.testing.assert_allclose(engine.platform(longer).rotation, engine.platform(y).rotation, atol=1e-15)
        pushed = engine.acceleration(y, np.ones(6), np.ones(3), np.ones(3))
        again = engine.acceleration(longer, np.ones(6), np.ones(3), np.ones(3))
        # MuJoCo pushes against gaps, and turning a leg by a rounding opens one.
        np.testing.assert_allclose(again, pushed, rtol=1e-9 if name == "mujoco" else 1e-12)
        turning = engine.rates(longer, *NOTHING)[quaternions] / 3
        np.testing.assert_allclose(turning, engine.rates(y, *NOTHING)[quaternions], rtol=1e-12, atol=1e-15)


def difference(function, h):
    """Central difference at 0, error of order h^4."""
    near, far = (function(h) - function(-h)) / (2 * h), (function(2 * h) - function(-2 * h)) / (4 * h)
    return (4 * near - far) / 3


class TestRates:
    @pytest.fixture
    def moving(self, engine):
        mechanism = random_mechanism(9)
        motion = random_motion(mechanism, 9)
        engine = engine[1](mechanism)
        y = engine.initial(state(motion))
        inputs = sixsps.inverse_dynamics(mechanism, motion)[0], motion.force[0], motion.moment[0]
        rates = engine.rates(y, *inputs)
        step = 1e-3 / np.abs(rates).max()
        return mechanism, motion, engine, inputs, lambda h: engine.platform(y + h * rates), y, rates, step

    def test_move_the_platform_at_its_velocity(self, moving):
        _, motion, _, _, at, _, _, h = moving
        velocity = difference(lambda h: at(h).position[0], h)
        np.testing.assert_allclose(velocity, motion.velocity[0], rtol=1e-8)
        rotation = difference(lambda h: at(h).rotation[0], h)
        spin = rotation @ motion.rotation[0].T
        omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        np.testing.assert_allclose(omega, motion.angular_velocity[0], rtol=1e-8)

    def test_change_its_velocity_by_the_acceleration(self, moving):
        _, _, engine, inputs, at, y, _, h = moving
        change = difference(lambda h: np.hstack([at(h).velocity[0], at(h).angular_velocity[0]]), h)
        expected = engine.acceleration(y, *inputs)
        np.testing.assert_allclose(change, expected, atol=1e-8 * np.abs(expected).max())

    def test_change_the_energy_by_the_power(self, moving):
        """Of actuators, force and moment; measured on the thirteen bodies, legs included."""
        mechanism, motion, _, (forces, force, moment), at, _, _, h = moving

        def energy(h):
            there = at(h)
            potential = potential_energy(mechanism, there.position, there.rotation)
            return kinetic_energy(mechanism, there)[0] + potential[0]

        arm = motion.rotation[0] @ mechanism.platform.com
        velocity = motion.velocity[0] + np.cross(motion.angular_velocity[0], arm)
        powers = forces * inverse_kinematics(mechanism, motion).length_rates[0]
        power = powers.sum() + force @ velocity + moment @ motion.angular_velocity[0]
        assert difference(energy, h) == pytest.approx(power, abs=1e-8 * np.abs(powers).max())

    def test_keep_the_loops_closed_and_the_quaternions_long(self, moving):
        mechanism, _, engine, _, _, y, rates, h = moving
        size = np.abs(mechanism.base_anchors).max()
        # A straight step in y is off the closures by its square.
        gaps = [engine.closure_error(y + step * rates) for step in (h, h / 2)]
        assert max(gaps) <= 1e-15 * size or gaps[1] == pytest.approx(gaps[0] / 4, rel=0.1)
        for quaternion in getattr(engine, "_quaternions", [np.arange(3, 7)]):
            assert abs(y[quaternion] @ rates[quaternion]) <= 1e-14 * np.abs(rates[quaternion]).max()

    def test_do_not_spin_the_legs(self, tree_engine):
        mechanism = random_mechanism(10)
        motion = random_motion(mechanism, 10)
        engine = tree_engine(mechanism)
        y = engine.initial(state(motion))
        v, dv = y[37:], engine.rates(y, np.ones(6), np.ones(3), np.ones(3))[37:]
        turning = engine._turning[:6]
        assert np.abs(v[turning[:, 2]]).max() <= 1e-14 * np.abs(v[turning]).max()
        assert np.abs(dv[turning[:, 2]]).max() <= 1e-10 * np.abs(dv[turning]).max()


class TestErrors:
    def test_leg_without_length(self, tree_engine, wu2012):
        position = wu2012.base_anchors[3] - wu2012.platform_anchors[3]
        with pytest.raises(sixsps.EngineError, match=r"^a leg has no length, and its ball no direction$"):
            tree_engine(wu2012).initial(state(at_rest(position)))

    @pytest.mark.parametrize("place", [0, 5, 66])
    def test_state_that_is_no_number(self, tree_engine, place, wu2012):
        engine = tree_engine(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        y[place] = np.nan
        for function in (engine.rates, engine.acceleration):
            with pytest.raises(sixsps.EngineError, match="accelerations that are no finite numbers"):
                function(y, *NOTHING)


def test_says_what_it_is(engine):
    _, make = engine
    for text in (make.formulation, make.loops, make.settings, make.version()):
        assert isinstance(text, str)
        assert text.strip()
    assert make.steps_itself is hasattr(make, "run")
