"""MuJoCo: the state that the legs are put in, legs on universal joints, and what it must not be asked."""

from dataclasses import replace

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion, scaled
from scipy.spatial.transform import Rotation

import sixsps
from compare.tolerances import TOLERANCES, UNIT_ROUNDOFF
from sixsps.bodies import Leg, Platform
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.legs import Legs
from sixsps.trajectories import bundled
from urdf import render_mjcf
from urdf.layout import Layout

mujoco = pytest.importorskip("mujoco")

from compare.engines.mujoco import Mujoco, MujocoUps, Tree, _ball, platform_rates  # noqa: E402
from compare.traps.mujoco import MujocoEquality  # noqa: E402

LEGS = range(1, 7)
SITE = mujoco.mjtObj.mjOBJ_SITE


def forces_of(engine, mechanism, motion):
    return engine(mechanism).inverse_dynamics(motion, lambda done: None).forces


@pytest.fixture(params=Legs)
def states(request):
    """A tree with the legs of a random mechanism, and a call that puts it in each state of a motion."""
    mechanism = random_mechanism(5)
    motion = random_motion(mechanism, 5, tilt=0.3)
    tree = Tree(mechanism, request.param)
    rates, accelerations = platform_rates(motion)
    positions = tree.positions(motion)

    def put():
        for k, state in enumerate(zip(positions, rates, accelerations, strict=True)):
            tree.set_state(*state)
            yield k

    return mechanism, motion, tree, put


class TestState:
    def test_bodies_stand_where_the_motion_puts_them(self, states):
        mechanism, motion, tree, put = states
        legs = inverse_kinematics(mechanism, motion)
        tolerance = 1e-14 * np.abs(mechanism.base_anchors).max()
        for k in put():
            platform = tree.data.body("platform")
            np.testing.assert_allclose(platform.xpos, motion.position[k], atol=tolerance)
            np.testing.assert_allclose(platform.xmat.reshape(3, 3), motion.rotation[k], atol=1e-14)
            for i in LEGS:
                lower = tree.data.body(f"leg{i}_lower")
                np.testing.assert_allclose(lower.xpos, mechanism.base_anchors[i - 1], atol=tolerance)
                axis = lower.xmat.reshape(3, 3)[:, 2]
                np.testing.assert_allclose(axis, legs.directions[k, i - 1], atol=1e-14)
            assert tree.closure_error() <= tolerance

    def test_loops_stay_closed_to_the_second_derivative(self, states):
        """By functions of MuJoCo that the engine does not use."""
        mechanism, motion, tree, put = states
        legs = inverse_kinematics(mechanism, motion)
        for k in put():
            mujoco.mj_rnePostConstraint(tree.model, tree.data)
            for i in LEGS:
                velocity, acceleration = site_motion(tree, f"leg{i}_tip")
                expected = legs.anchor_velocity[k, i - 1]
                np.testing.assert_allclose(velocity[3:], expected, atol=1e-14 * np.abs(expected).max())
                expected = legs.anchor_acceleration[k, i - 1]
                scale = np.abs(legs.anchor_acceleration[k]).max() + np.abs(mechanism.gravity).max()
                np.testing.assert_allclose(acceleration[3:], expected, atol=1e-14 * scale)

    def test_legs_on_balls_do_not_spin_and_legs_on_universal_joints_do(self, states):
        mechanism, motion, tree, put = states
        legs = inverse_kinematics(mechanism, motion)
        spins = []
        for k in put():
            mujoco.mj_rnePostConstraint(tree.model, tree.data)
            for i in LEGS:
                velocity, acceleration = site_motion(tree, f"leg{i}_tip")
                s = legs.directions[k, i - 1]
                expected = legs.leg_angular_velocity[k, i - 1]
                scale = np.abs(legs.leg_angular_velocity[k]).max()
                across = velocity[:3] - s * (s @ velocity[:3])
                np.testing.assert_allclose(across, expected, atol=1e-13 * scale)
                spins.append(abs(s @ velocity[:3]) / scale)
                if tree.legs is Legs.sps:
                    scale = np.abs(legs.leg_angular_acceleration[k]).max()
                    expected = legs.leg_angular_acceleration[k, i - 1]
                    np.testing.assert_allclose(acceleration[:3], expected, atol=1e-13 * scale)
        assert max(spins) <= 1e-14 if tree.legs is Legs.sps else max(spins) > 1e-2

    def test_mj_inverse_does_not_look_at_applied_forces(self, states):
        """Why the engine takes the external wrench off itself."""
        _, _, tree, put = states
        next(put())
        before = tree.inverse(np.zeros(3), np.zeros(3))
        tree.data.xfrc_applied[:] = 1e3
        assert np.array_equal(tree.inverse(np.zeros(3), np.zeros(3)), before)

    @pytest.mark.parametrize("across", [0.0, 1e-200, 1e-12, 1e-6, 1e-3, 1.0])
    @pytest.mark.parametrize("along", [-1.0, 1.0])
    def test_a_ball_turns_a_leg_to_any_direction(self, along, across):
        direction = np.array([0.6 * across, -0.8 * across, along])
        quaternion = _ball(direction[None])[0]
        turned = Rotation.from_quat(quaternion, scalar_first=True).apply([0, 0, 1])
        expected = direction / np.linalg.norm(direction)
        np.testing.assert_allclose(turned, expected, rtol=1e-12, atol=3e-16)


def site_motion(tree, name):
    """Velocity and acceleration of a site, each angular then linear; MuJoCo's has -gravity in it."""
    site, velocity, acceleration = tree.model.site(name).id, np.zeros(6), np.zeros(6)
    mujoco.mj_objectVelocity(tree.model, tree.data, SITE, site, velocity, 0)
    mujoco.mj_objectAcceleration(tree.model, tree.data, SITE, site, acceleration, 0)
    acceleration[3:] += tree.model.opt.gravity
    return velocity, acceleration


class TestUniversalJoints:
    def test_mjcf_has_them_in_place_of_the_balls(self, mechanism):
        model = mujoco.MjModel.from_xml_string(render_mjcf(mechanism, Legs.ups))
        assert (model.nq, model.nv) == (25, 24)
        balls = mujoco.MjModel.from_xml_string(render_mjcf(mechanism))
        assert (balls.nq, balls.nv) == (37, 30)
        layout = Layout.of(mechanism)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for i, place in zip(LEGS, layout.legs, strict=True):
            home = Rotation.from_euler("ZY", [place.yaw, place.pitch]).as_matrix()
            first, second = (model.joint(f"leg{i}_universal_{axis}") for axis in "xy")
            assert first.type == second.type == mujoco.mjtJoint.mjJNT_HINGE
            assert first.bodyid == second.bodyid == model.body(f"leg{i}_lower").id
            assert second.dofadr == first.dofadr + 1
            np.testing.assert_allclose(data.xaxis[first.id], home[:, 0], atol=1e-15)
            np.testing.assert_allclose(data.xaxis[second.id], home[:, 1], atol=1e-15)
        for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat", "body_pos", "body_quat"):
            assert np.array_equal(getattr(model, name), getattr(balls, name))

    def test_difference_is_proportional_to_the_axial_inertia(self, wu2012):
        motion = bundled("sinusoids", wu2012, 50)
        slim = replace(wu2012, legs=tuple(slimmer(leg, 100) for leg in wu2012.legs))
        reference = sixsps.inverse_dynamics(wu2012, motion)
        difference, small = (forces_of(MujocoUps, each, motion) - reference for each in (wu2012, slim))
        rounding = 1e-13 * np.abs(reference).max()
        assert np.abs(difference).max() > 1e5 * rounding
        assert np.abs(difference / 100 - small).max() <= rounding

    def test_gimbal_lock_is_named_with_its_sample(self, wu2012):
        place = Layout.of(wu2012).legs[2]
        first_axis = Rotation.from_euler("ZY", [place.yaw, place.pitch]).as_matrix()[:, 0]
        position = wu2012.base_anchors[2] + 0.5 * first_axis - wu2012.platform_anchors[2]
        motion = at_rest(position)
        with pytest.raises(sixsps.EngineError, match=r"^gimbal lock of a universal joint at given sample 1"):
            forces_of(MujocoUps, wu2012, motion)
        reference = sixsps.inverse_dynamics(wu2012, motion)
        np.testing.assert_allclose(forces_of(Mujoco, wu2012, motion), reference, rtol=1e-11)


def slimmer(leg, factor):
    halves = (replace(link, axial=link.axial / factor) for link in (leg.lower, leg.upper))
    return Leg(*halves, leg.length_limits)


class TestModel:
    @pytest.mark.parametrize("length", [1e-3, 1e3])
    def test_small_and_large_hexapods_lose_no_digits(self, wu2012, length):
        mechanism = scaled(wu2012, length, mass=max(length, 1.0))
        assert_within_rounding(mechanism, random_motion(mechanism, 0))

    def test_base_draws_no_digits_away_from_a_hexapod_far_from_the_origin(self, wu2012):
        """MuJoCo computes about the common centre of mass, of which the base is part."""
        away = np.array([1e4, -2e4, 5e3])
        motion = random_motion(wu2012, 0)
        moved = replace(motion, position=motion.position + away)
        assert_within_rounding(replace(wu2012, base_anchors=wu2012.base_anchors + away), moved)

    def test_inertia_below_what_mujoco_takes_is_one_clear_line(self, wu2012):
        slim = replace(wu2012, legs=tuple(slimmer(leg, 1e12) for leg in wu2012.legs))
        with pytest.raises(sixsps.EngineError, match=r"^MuJoCo refuses the mechanism: mass and inertia.*$"):
            Mujoco(slim)

    def test_warns_into_no_file(self, wu2012, tmp_path, monkeypatch, capfd):
        monkeypatch.chdir(tmp_path)
        light = replace(wu2012, platform=Platform(1.0, [0, 0, 0], 1e-15 * np.eye(3)))
        before = mujoco.get_mju_user_warning()
        forces_of(Mujoco, light, bundled("line", light, 3))
        assert mujoco.get_mju_user_warning() is before
        assert list(tmp_path.iterdir()) == []
        assert capfd.readouterr() == ("", "")

    def test_a_link_that_is_a_disc_but_for_rounding_loads(self, wu2012):
        link = wu2012.legs[0].lower
        disc = replace(link, axial=2 * link.transverse * (1 + 1e-10))
        mechanism = replace(wu2012, legs=(Leg(disc, wu2012.legs[0].upper),) * 6)
        motion = bundled("line", mechanism, 5)
        reference = sixsps.inverse_dynamics(mechanism, motion)
        np.testing.assert_allclose(forces_of(Mujoco, mechanism, motion), reference, rtol=1e-11)


def assert_within_rounding(mechanism, motion):
    reference = sixsps.inverse_dynamics(mechanism, motion)
    error = np.abs(forces_of(Mujoco, mechanism, motion) - reference).max(axis=1)
    growth = inverse_kinematics(mechanism, motion).error_growth
    bound = TOLERANCES["mujoco"].rounding_factor * growth * UNIT_ROUNDOFF
    assert np.all(error <= bound * np.abs(reference).max(axis=1))


class TestTrap:
    """Soft closures left on: the error that the registry's `why` explains."""

    @pytest.mark.parametrize("name", ["line", "sinusoids"])
    def test_is_wrong_by_nearly_everything(self, wu2012, name):
        motion = bundled(name, wu2012, 50)
        reference = sixsps.inverse_dynamics(wu2012, motion)
        result = MujocoEquality(wu2012).inverse_dynamics(motion, lambda done: None)
        assert np.abs(result.forces - reference).max() > 0.9 * np.abs(reference).max()
        assert result.closure_error.max() < 1e-14

    def test_leaves_weight_and_load_on_the_platform(self, wu2012):
        """At rest: the upper link's weight along the leg, and all else on the platform."""
        motion = at_rest(home_position(wu2012), force=[80.0, -50, -100])
        result = MujocoEquality(wu2012).inverse_dynamics(motion, lambda done: None)
        upward = inverse_kinematics(wu2012, motion).directions[..., 2]
        upper = wu2012.upper.mass * 9.81 * upward
        np.testing.assert_allclose(result.forces, upper, rtol=1e-11)
        assert result.closure_residual[0] == pytest.approx(100 + 9.81 * wu2012.platform.mass, rel=1e-11)
