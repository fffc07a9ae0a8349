"""The equations that SymPy derives: legs and platforms of which the answer is known."""

import dataclasses
import time

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from scipy.spatial.transform import Rotation

import sixsps
from compare.tolerances import UNIT_ROUNDOFF
from sixsps.kinematics import inverse_kinematics
from sixsps.motion import Motion

pytest.importorskip("sympy")

from compare.engines import sympy as engine

REST = np.zeros(3)
LENGTH = 0.7
GRAVITY = np.array([1.5, -2.5, -9.0])
LINKS = (0.5, 0.2, 0.02, 0.3, 0.25, 0.01)


def tip_force(velocity=REST, acceleration=REST, gravity=REST, links=LINKS):
    """Force of the passive leg on the platform, in axes of which the third is the leg."""
    arguments = ([LENGTH], velocity, acceleration, gravity, links)
    passive, per_newton = engine.leg_formulas()(*map(np.asarray, arguments))
    np.testing.assert_array_equal(per_newton, [0, 0, 1])
    return passive


def test_leg_at_rest_carries_its_weight_to_both_joints():
    """About A the moments of both weights and of the tip balance; the rod slides in the cylinder."""
    force = tip_force(gravity=GRAVITY)
    m_d, e_d, _, m_u, e_u, _ = LINKS
    lever = (m_d * e_d + m_u * (LENGTH - e_u)) / LENGTH
    np.testing.assert_allclose(force, GRAVITY * [lever, lever, m_u], rtol=1e-15)


def test_point_mass_at_the_tip_obeys_newton_whatever_its_velocity():
    rng = np.random.default_rng(0)
    velocity, acceleration = rng.standard_normal((2, 3))
    force = tip_force(velocity, acceleration, GRAVITY, (0, 0.2, 0, 0.3, 0, 0))
    np.testing.assert_allclose(force, 0.3 * (GRAVITY - acceleration), rtol=1e-13)


def test_only_the_rod_feels_an_acceleration_along_the_leg():
    np.testing.assert_allclose(tip_force(acceleration=[0, 0, 2.0]), [0, 0, -2.0 * LINKS[3]], rtol=1e-15)


@pytest.mark.parametrize("across", [[1.0, 0, 0], [0, 1.0, 0], [0.6, -0.8, 0]])
def test_leg_of_constant_length_is_one_body_about_its_base_joint(across):
    """Inertia about A resists the turning, the rod alone pulls outwards."""
    across, rate, rate_of_rate = np.array(across), 3.0, -5.0
    along = np.array([0, 0, 1.0])
    acceleration = LENGTH * (rate_of_rate * across - rate**2 * along)
    m_d, e_d, I_d, m_u, e_u, I_u = LINKS
    inertia = I_d + I_u + m_d * e_d**2 + m_u * (LENGTH - e_u) ** 2
    expected = -inertia * rate_of_rate / LENGTH * across + m_u * (LENGTH - e_u) * rate**2 * along
    force = tip_force(rate * LENGTH * across, acceleration)
    np.testing.assert_allclose(force, expected, rtol=1e-14, atol=1e-15)


def test_sliding_while_turning_takes_a_coriolis_force():
    """Angular momentum about A grows with the length although the leg turns evenly."""
    rate, speed = 3.0, 0.4
    m_u, e_u = LINKS[3:5]
    acceleration = [2 * speed * rate, 0, -(rate**2) * LENGTH]
    force = tip_force([rate * LENGTH, 0, speed], acceleration)
    coriolis = 2 * m_u * (LENGTH - e_u) * speed * rate / LENGTH
    np.testing.assert_allclose(force, [-coriolis, 0, m_u * (LENGTH - e_u) * rate**2], rtol=1e-14)


def test_platform_equations_are_newton_and_euler():
    """For any twist: the momentum of a body with an off-centre mass and all six products of inertia."""
    rng = np.random.default_rng(1)
    v, omega, a, epsilon, com, gravity, force, moment = rng.standard_normal((8, 3))
    inertia = np.diag([2.0, 3.0, 4.0]) + 0.3 * (np.ones((3, 3)) - np.eye(3)) * [
        [1, 2, 3],
        [2, 1, 4],
        [3, 4, 1],
    ]
    entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    (wrench,) = engine.platform_formulas().wrench(
        np.hstack([v, omega]),
        np.hstack([a, epsilon]),
        np.array([1.7, *com, *entries]),
        gravity,
        np.hstack([force, moment]),
    )
    acceleration = a + np.cross(epsilon, com) + np.cross(omega, np.cross(omega, com))
    linear = 1.7 * (acceleration - gravity) - force
    angular = inertia @ epsilon + np.cross(omega, inertia @ omega) - moment + np.cross(com, linear)
    np.testing.assert_allclose(wrench, np.hstack([linear, angular]), rtol=1e-13)


def test_force_on_a_platform_joint_is_a_wrench_about_the_platform_origin():
    joint, force = np.random.default_rng(2).standard_normal((2, 3))
    (wrench,) = engine.platform_formulas().tip_wrench(joint, force)
    np.testing.assert_allclose(wrench, np.hstack([force, np.cross(joint, force)]), rtol=1e-15)


def test_axial_inertia_is_given_to_sympy_and_drops_out():
    leg = engine._Leg()
    for body in leg._bodies:
        assert "axial" in names_in([body.central_inertia.to_matrix(leg.frame)])
    assert "axial" not in names_in(engine.leg_formulas().vectors)


def names_in(matrices):
    return {symbol.name for matrix in matrices for symbol in matrix.free_symbols}


def test_a_process_derives_once_and_in_little_time(wu2012, monkeypatch):
    start = time.process_time()
    engine.leg_formulas.__wrapped__()
    engine.platform_formulas.__wrapped__()
    assert time.process_time() - start < 5  # it takes 1 s; the whole mechanism at once takes minutes
    engine.Sympy(wu2012)
    monkeypatch.setattr(engine.me, "KanesMethod", None)
    engine.Sympy(random_mechanism(0))


def test_home_frames_are_rotations_for_every_direction_of_a_leg():
    directions = np.random.default_rng(3).standard_normal((1000, 3))
    directions[:7] = [*np.eye(3), *-np.eye(3), [1.0, 0.0, -1e-17]]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    frames = engine._frames_along(directions)
    np.testing.assert_array_equal(frames[..., 2], directions)
    np.testing.assert_allclose(np.swapaxes(frames, 1, 2) @ frames - np.eye(3), 0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=1e-15)


def turned(mechanism, motion, turn):
    """The same mechanism and motion, seen from world axes that are turned."""
    to_new = turn.as_matrix().T
    base = {"gravity": mechanism.gravity @ to_new, "base_anchors": mechanism.base_anchors @ to_new}
    names = ("position", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
    vectors = {name: getattr(motion, name) @ to_new for name in (*names, "force", "moment")}
    orientation = turn * Rotation.from_quat(motion.quaternion, scalar_first=True)
    there = dataclasses.replace(mechanism, **base)
    return there, Motion(time=motion.time, quaternion=orientation.as_quat(scalar_first=True), **vectors)


@pytest.mark.parametrize("turn", [[np.pi, 0, 0], [0, np.pi / 2, 0], [np.pi / 2, 0, 0], [0.5, -1.9, 0.8]])
def test_no_orientation_of_a_leg_is_special(turn):
    """A hexapod that hangs, or stands out from a wall, has the forces of one that stands."""
    mechanism = random_mechanism(4)
    motion = random_motion(mechanism, 4)
    there = turned(mechanism, motion, Rotation.from_rotvec(turn))
    standing, other = (
        engine.Sympy(given).inverse_dynamics(states, lambda done: None).forces
        for given, states in ((mechanism, motion), there)
    )
    bound = 20 * inverse_kinematics(mechanism, motion).condition.max() * UNIT_ROUNDOFF
    np.testing.assert_allclose(other, standing, rtol=0, atol=bound * np.abs(standing).max())


def test_singular_pose_is_refused(wu2012):
    with pytest.raises(sixsps.errors.EngineError, match="singular"):
        engine.Sympy(wu2012).inverse_dynamics(at_rest([0.0, 0.0, 0.0]), lambda done: None)
