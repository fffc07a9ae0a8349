"""Exudyn: redundant coordinates, their algebraic equations, and the multipliers as forces."""

from dataclasses import replace

import numpy as np
import pytest
from cases import FIELDS, at_rest, random_mechanism, random_motion, wobble
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.bodies import Leg
from sixsps.kinematics import inverse_kinematics
from sixsps.motion import Motion

exudyn = pytest.importorskip("exudyn")
engines = pytest.importorskip("compare.engines.exudyn")

UNIT_ROUNDOFF = np.finfo(float).eps / 2
FACTOR = 20


class Solved:
    """One sample of a motion: coordinates of the thirteen bodies, their rates, and the multipliers."""

    def __init__(self, mechanism, motion, sample=0):
        self.bodies = bodies = engines.Bodies(mechanism)
        self.q = engines.coordinates(mechanism, motion)[sample]
        rates = engines.platform_rates(mechanism, motion, self.q[None, 3:7])
        self.v, self.a = np.zeros(91), np.zeros(91)
        self.v[:7], self.a[:7] = rates[0][sample], rates[1][sample]
        self.jacobian = bodies.move_legs(self.q, self.v, self.a)
        wrench = motion.force[sample], motion.moment[sample]
        required = bodies.required(self.q, self.v, self.a, *wrench)
        self.multipliers, self.residual = engines.multipliers_for(self.jacobian.T, required)
        self.joints = np.concatenate([bodies.balls.ravel(), bodies.slides.ravel(), bodies.norms])

    def spin(self, body):
        """Rotation matrix, angular velocity and acceleration of a body, world axes."""
        e, de, dde = (array.reshape(13, 7)[body, 3:] for array in (self.q, self.v, self.a))
        w, u = e[0], e[1:]
        rotation = Rotation.from_quat(e, scalar_first=True).as_matrix()
        # omega = 2 e' e* and, because e' e'* is a number, epsilon = 2 e'' e*.
        return rotation, *(2 * (w * d[1:] - d[0] * u - np.cross(d[1:], u)) for d in (de, dde))

    def place(self, body):
        """Position and acceleration of a body's centre of mass."""
        return self.q.reshape(13, 7)[body, :3], self.a.reshape(13, 7)[body, :3]


def one_sample(seed):
    return random_mechanism(seed), random_motion(random_mechanism(seed), seed, samples=1)


def forces_of(mechanism, motion):
    return engines.Exudyn(mechanism).inverse_dynamics(motion, lambda done: None)


def assert_right(mechanism, motion):
    reference = sixsps.inverse_dynamics(mechanism, motion)
    error = np.abs(forces_of(mechanism, motion).forces - reference).max(axis=1)
    bound = FACTOR * UNIT_ROUNDOFF * inverse_kinematics(mechanism, motion).condition
    assert np.all(error <= bound * np.abs(reference).max(axis=1))


@pytest.mark.parametrize("seed", range(20))
def test_joints_stay_closed_in_position_velocity_and_acceleration(seed):
    state = Solved(*one_sample(seed))
    bodies, q, v, a, joints = state.bodies, state.q, state.v, state.a, state.joints
    assert np.abs(bodies.gaps(q)[joints]).max() <= 1e-15 * (1 + np.abs(q).max())
    terms = np.abs(state.jacobian) @ np.abs(v)
    assert np.all(np.abs(bodies.gap_rates(q, v)[joints]) <= 1e-14 * terms.max())
    assert np.all(np.abs(state.jacobian @ v)[joints] <= 1e-14 * terms.max())
    left = state.jacobian @ a + bodies.drift(q, v)
    assert np.abs(left[joints]).max() <= 1e-14 * (np.abs(state.jacobian) @ np.abs(a)).max()


def test_lengths_change_as_inverse_kinematics_says():
    mechanism, motion = one_sample(1)
    state = Solved(mechanism, motion)
    rates = state.bodies.gap_rates(state.q, state.v)[state.bodies.lengths]
    expected = inverse_kinematics(mechanism, motion).length_rates[0]
    np.testing.assert_allclose(rates, expected, rtol=0, atol=1e-14 * np.abs(state.v).max())


@pytest.mark.parametrize("seed", range(10))
def test_joints_stay_closed_a_little_later(seed):
    """Along q + h v + h^2 a / 2 they open with h^3 only, found from positions alone."""
    state = Solved(*one_sample(seed))
    slow = 1 / np.abs(state.v.reshape(13, 7)[:, 3:]).max()

    def opening(h, a):
        later = state.q + h * state.v + h**2 / 2 * a
        return np.abs(state.bodies.gaps(later)[state.joints]).max()

    wide, narrow = (opening(h * slow, state.a) for h in (1e-2, 1e-3))
    assert narrow == pytest.approx(1e-3 * wide, rel=0.1)
    assert narrow < 1e-2 * opening(1e-3 * slow, 0 * state.a)


@pytest.mark.parametrize("seed", range(10))
def test_jacobian_turns_as_the_accelerations_need(seed):
    """d(Jc)/dt q' + Jc q'' = 0, the first by differences of Exudyn's Jacobian."""
    state = Solved(*one_sample(seed))
    h = 1e-5 / np.abs(state.v.reshape(13, 7)[:, 3:]).max()
    later, earlier = (state.bodies.jacobian(state.q + step * state.v) for step in (h, -h))
    turning = (later - earlier) / (2 * h) @ state.v
    left = (turning + state.jacobian @ state.a)[state.joints]
    assert np.abs(left).max() <= 1e-8 * np.abs(turning).max()


@pytest.mark.parametrize("time", [0.3, 1.1, 2.6])
def test_centres_of_mass_move_as_their_rates_say(wu2012, time):
    h = 1e-4
    before, now, after = (Solved(wu2012, wobble(np.array([t]))) for t in (time - h, time, time + h))
    for change, rate in (((before.q, after.q), now.v), ((before.v, after.v), now.a)):
        slope = np.diff(change, axis=0).reshape(13, 7)[:, :3] / (2 * h)
        np.testing.assert_allclose(slope, rate.reshape(13, 7)[:, :3], rtol=0, atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_legs_do_not_spin(seed):
    state = Solved(*one_sample(seed))
    for body in range(1, 13):
        rotation, omega, epsilon = state.spin(body)
        assert abs(rotation[:, 0] @ omega) <= 1e-14 * np.linalg.norm(omega)
        assert abs(rotation[:, 0] @ epsilon) <= 1e-13 * np.linalg.norm(epsilon)


def slide_reaction(state, leg):
    """Force and moment of a sliding joint on the upper link, at its tip, world axes."""
    rotation, _, _ = state.spin(1 + 2 * leg)
    y, z, about_x, about_y, about_z = state.multipliers[state.bodies.slides[leg]]
    return rotation @ [0, y, z], rotation @ [about_x, -about_y, -about_z]


def assert_balance(state, body, mass, inertia, gravity, loads):
    """Newton's and Euler's equations of one body; `loads` are (point, force, moment)."""
    rotation, omega, epsilon = state.spin(body)
    centre, acceleration = state.place(body)
    inertia = rotation @ inertia @ rotation.T
    force = [f for _, f, _ in loads]
    moment = [np.cross(point - centre, f) + m for point, f, m in loads]
    change = inertia @ epsilon + np.cross(omega, inertia @ omega)
    weight = mass * (acceleration - gravity)
    reach = max(np.linalg.norm(point - centre) for point, _, _ in loads)
    scale = 1e-13 * np.abs(state.multipliers).max()
    np.testing.assert_allclose(np.sum(force, axis=0), weight, rtol=0, atol=scale)
    np.testing.assert_allclose(np.sum(moment, axis=0), change, rtol=0, atol=scale * reach)


@pytest.mark.parametrize("seed", range(10))
def test_multipliers_are_forces_that_balance_each_body(seed):
    mechanism, motion = one_sample(seed)
    state = Solved(mechanism, motion)
    gravity, zero = mechanism.gravity, np.zeros(3)
    arms = mechanism.platform_anchors @ motion.rotation[0].T
    anchors = motion.position[0] + arms
    p = state.multipliers
    on_platform = [(state.place(0)[0], motion.force[0], motion.moment[0])]
    for leg, (foot, tip) in enumerate(zip(mechanism.base_anchors, anchors, strict=True)):
        at_foot, at_tip = p[state.bodies.balls[2 * leg : 2 * leg + 2]]
        push = p[state.bodies.lengths[leg]] * (tip - foot) / np.linalg.norm(tip - foot)
        side, turn = slide_reaction(state, leg)
        on_lower = [(foot, at_foot - push, zero), (tip, -side, -turn)]
        on_upper = [(tip, at_tip + push + side, turn)]
        halves = (mechanism.legs[leg].lower, on_lower), (mechanism.legs[leg].upper, on_upper)
        for half, (link, loads) in enumerate(halves, start=1):
            inertia = np.diag([link.axial, link.transverse, link.transverse])
            assert_balance(state, 2 * leg + half, link.mass, inertia, gravity, loads)
        on_platform.append((tip, -at_tip, zero))
    assert_balance(state, 0, mechanism.platform.mass, mechanism.platform.inertia, gravity, on_platform)


def test_idle_spins_are_all_that_the_equations_leave_free():
    state = Solved(*one_sample(2))
    assert state.jacobian.shape == (85, 91)
    assert np.linalg.matrix_rank(state.jacobian) == 85
    assert np.abs(state.residual).max() <= 1e-13 * np.abs(state.multipliers).max()


def test_a_spinning_leg_leaves_a_residual():
    """What a motion that the model does not have would look like."""
    state = Solved(*one_sample(2))
    e = state.q.reshape(13, 7)[1, 3:]
    about_x = np.array([-e[1], e[0], e[3], -e[2]])
    state.a.reshape(13, 7)[1:3, 3:] += about_x
    required = state.bodies.required(state.q, state.v, state.a, np.zeros(3), np.zeros(3))
    _, residual = engines.multipliers_for(state.jacobian.T, required)
    assert np.abs(residual).max() > 1e-6 * np.abs(required).max()


def test_jacobian_adds_to_what_the_solver_holds():
    """Why `Bodies.jacobian` resets it: a second call without that gives twice the Jacobian."""
    state = Solved(*one_sample(3))
    bodies = state.bodies
    once = bodies.jacobian(state.q)
    bodies._solver.ComputeJacobianAE(bodies._system)
    twice = bodies._solver.GetSystemJacobian()[91:, :91]
    np.testing.assert_array_equal(twice, 2 * once)
    np.testing.assert_array_equal(bodies.jacobian(state.q), once)


@pytest.mark.parametrize("y", [0.0, -0.0, 1e-300, 1e-9, -1e-9])
@pytest.mark.parametrize("x", [1.0, -1.0])
def test_legs_may_point_either_way_along_x(x, y):
    """Links are turned from their x axis, which has no shortest turn to -x."""
    mechanism = random_mechanism(4)
    motion = random_motion(mechanism, 4, samples=1)
    tip = motion.position[0] + motion.rotation[0] @ mechanism.platform_anchors[0]
    base = np.array(mechanism.base_anchors)
    base[0] = tip - [x, y, 0]
    mechanism = replace(mechanism, base_anchors=base)
    state = Solved(mechanism, motion)
    assert np.abs(state.bodies.gaps(state.q)[state.joints]).max() <= 1e-15 * (1 + np.abs(state.q).max())
    assert_right(mechanism, motion)


def with_motion_scaled(motion, factor):
    """The same poses, passed through faster by a factor, without load."""
    given = {name: getattr(motion, name) for name in FIELDS} | {"force": None, "moment": None}
    for name, power in (("velocity", 1), ("acceleration", 2)):
        for key in (name, f"angular_{name}"):
            given[key] = given[key] * factor**power
    return Motion(**given)


@pytest.mark.parametrize("factor", [1e-40, 1e-6, 1e6])
def test_no_speed_is_too_slow_or_too_fast(factor):
    """Velocities are differentiated by steps along them, which must follow the speed."""
    mechanism = replace(random_mechanism(5), gravity=[0, 0, 0])
    assert_right(mechanism, with_motion_scaled(random_motion(mechanism, 5), factor))


def test_nothing_drifts_at_rest_or_in_translation(wu2012):
    still = Solved(wu2012, at_rest([0.0, 0.1, 0.5]))
    assert not still.v.any()
    assert not still.bodies.drift(still.q, still.v).any()
    assert_right(wu2012, at_rest([0.0, 0.1, 0.5]))
    assert_right(wu2012, at_rest([0.0, 0.1, 0.5], velocity=[0.3, -0.2, 0.1]))


def test_centres_of_mass_may_coincide_with_the_joints():
    """All bodies start in one place, where driven lengths of such links are zero."""
    mechanism = random_mechanism(6)
    legs = tuple(Leg(replace(leg.lower, com=0.0), replace(leg.upper, com=0.0)) for leg in mechanism.legs)
    assert_right(replace(mechanism, legs=legs), random_motion(mechanism, 6))


def test_writes_no_files_and_prints_nothing(wu2012, tmp_path, monkeypatch, capfd):
    """Exudyn's solvers do both unless they are told."""
    monkeypatch.chdir(tmp_path)
    forces_of(wu2012, at_rest([0.0, 0.1, 0.5]))
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


def test_what_exudyn_refuses_is_an_engine_error_of_one_line(wu2012, monkeypatch):
    monkeypatch.setattr(engines, "_REFERENCE", np.zeros(91))
    with pytest.raises(sixsps.EngineError, match="exudyn does not accept the mechanism") as caught:
        engines.Exudyn(wu2012)
    assert "\n" not in str(caught.value)


def test_a_sample_that_exudyn_refuses_is_named(wu2012, monkeypatch):
    def refuse(*_):
        raise exudyn.SolverError("no\nway")

    monkeypatch.setattr(engines.Bodies, "required", refuse)
    with pytest.raises(sixsps.EngineError, match="exudyn fails at given sample 1: no way"):
        forces_of(wu2012, at_rest([0.0, 0.1, 0.5]))
