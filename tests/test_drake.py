"""Drake: its plant is the mechanism, no pose locks its balls, and what a universal joint adds is real."""

import dataclasses

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism, random_motion
from scipy.spatial.transform import Rotation

pytest.importorskip("pydrake")

import sixsps
from compare.engines import drake
from compare.engines.drake import Drake, DrakeUps
from compare.tolerances import TOLERANCES, UNIT_ROUNDOFF
from compare.traps.drake import DrakeTree
from sixsps.bodies import Leg, Platform
from sixsps.errors import EngineError
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.trajectories import bundled

ROUNDING = TOLERANCES["drake"].rounding_factor * UNIT_ROUNDOFF
LEGS = range(1, 7)


@pytest.fixture(params=[*BUNDLED, "random 0", "random 1"])
def any_mechanism(request):
    kind, _, seed = request.param.partition(" ")
    return random_mechanism(int(seed)) if seed else Mechanism.load(kind)


@pytest.fixture(params=[Drake, DrakeUps])
def tree(request, any_mechanism):
    return any_mechanism, request.param(any_mechanism)._tree


def forces_of(engine, mechanism, motion):
    return engine(mechanism).inverse_dynamics(motion, lambda done: None).forces


def errors(forces, mechanism, motion):
    """Relative errors against Kane over the condition number, sample by sample."""
    reference = sixsps.inverse_dynamics(mechanism, motion)
    error = np.abs(forces - reference).max(axis=1) / np.abs(reference).max(axis=1)
    return error / inverse_kinematics(mechanism, motion).condition


def with_axial_inertia(mechanism, factor):
    legs = (
        Leg(*(dataclasses.replace(link, axial=factor * link.axial) for link in (leg.lower, leg.upper)))
        for leg in mechanism.legs
    )
    return dataclasses.replace(mechanism, legs=tuple(legs))


def about_origin(mass, com, inertia):
    return inertia + mass * (np.dot(com, com) * np.eye(3) - np.outer(com, com))


class TestPlant:
    def test_carries_mass_inertia_and_gravity(self, tree):
        mechanism, tree = tree
        bodies = {"platform": (mechanism.platform.mass, mechanism.platform.com, mechanism.platform.inertia)}
        for i, leg in zip(LEGS, mechanism.legs, strict=True):
            for half, link, sense in (("lower", leg.lower, 1), ("upper", leg.upper, -1)):
                inertia = np.diag([link.transverse, link.transverse, link.axial])
                bodies[f"leg{i}_{half}"] = link.mass, [0, 0, sense * link.com], inertia
        for name, (mass, com, inertia) in bodies.items():
            body = tree.plant.GetBodyByName(name)
            found = body.CalcSpatialInertiaInBodyFrame(tree.context).CalcRotationalInertia()
            assert body.default_mass() == mass
            assert np.array_equal(body.default_com(), com)
            wanted = about_origin(mass, com, inertia)
            tolerance = 16 * UNIT_ROUNDOFF * np.abs(wanted).max()
            np.testing.assert_allclose(found.CopyToFullMatrix3(), wanted, rtol=0, atol=tolerance)
        assert np.array_equal(tree.plant.gravity_field().gravity_vector(), mechanism.gravity)

    def test_has_no_mass_besides_but_the_base(self, tree):
        _, tree = tree
        indices = tree.plant.GetBodyIndices(tree.platform.model_instance())
        bodies = {body.name(): body for body in map(tree.plant.get_body, indices)}
        known = {"base", "platform"} | {f"leg{i}_{half}" for i in LEGS for half in ("lower", "upper")}
        assert known < set(bodies)
        assert {bodies[name].default_mass() for name in set(bodies) - known} == {0.0}

    def test_has_the_velocities_of_its_joints_and_nothing_floating_besides(self, tree):
        _, tree = tree
        assert tree.plant.num_velocities() == 6 + 6 * len(tree.leg_columns[0])
        assert len(tree.leg_columns[0]) in (3, 4)

    def test_legs_turn_about_their_anchors(self, tree):
        """Hinges of one MJCF body would not: Drake's parser hangs the body's pose on the last of them."""
        mechanism, tree = tree
        size = np.abs(mechanism.base_anchors).max()
        q = np.array(tree.plant.GetPositions(tree.context))
        for i in LEGS:
            start = tree.plant.GetJointByName(tree.root_joint.format(i)).position_start()
            q[start : start + len(tree.leg_columns[0]) - 1] = np.random.default_rng(i).uniform(-3, 3)
        tree.plant.SetPositions(tree.context, q)
        for i, anchor in zip(LEGS, mechanism.base_anchors, strict=True):
            found = tree.plant.GetBodyByName(f"leg{i}_lower").EvalPoseInWorld(tree.context).translation()
            np.testing.assert_allclose(found, anchor, rtol=0, atol=1e-15 * size)

    def test_loses_nothing_unsaid_in_parsing(self, wu2012, monkeypatch):
        monkeypatch.setattr(drake, "_unknown_in_mjcf", lambda element: element.tag == "light")
        with pytest.raises(EngineError, match=r"Drake does not read the mechanism: .*'site'"):
            Drake(wu2012)

    @pytest.mark.parametrize("name", ["a::b", "::", " x ", "world", "<x>&\"'", "${1}", "Δ/" * 90])
    @pytest.mark.parametrize("engine", [Drake, DrakeUps])
    def test_takes_any_name(self, wu2012, engine, name):
        motion = bundled("line", wu2012, 2)
        named = dataclasses.replace(wu2012, name=name)
        assert np.array_equal(forces_of(engine, named, motion), forces_of(engine, wu2012, motion))


@pytest.mark.parametrize("engine", [Drake, DrakeUps])
def test_loops_close_to_rounding_on_random_mechanisms(engine):
    for seed in range(50):
        mechanism = random_mechanism(seed)
        result = engine(mechanism).inverse_dynamics(random_motion(mechanism, seed), lambda done: None)
        assert result.closure_error.max() <= 1e-14 * np.abs(mechanism.base_anchors).max()
        assert result.closure_residual.max() <= 1e-13 * np.abs(result.forces).max()


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1e3, 1e6])
def test_size_costs_no_digits(size):
    mechanism, motion = random_mechanism(5), random_motion(random_mechanism(5), 5)
    legs = [
        [dataclasses.replace(link, length=size * link.length, com=size * link.com,
                             transverse=size**2 * link.transverse, axial=size**2 * link.axial)
         for link in (leg.lower, leg.upper)]
        for leg in mechanism.legs
    ]  # fmt: skip
    platform = mechanism.platform
    scaled = dataclasses.replace(
        mechanism, gravity=size * mechanism.gravity, base_anchors=size * mechanism.base_anchors,
        platform_anchors=size * mechanism.platform_anchors, legs=tuple(Leg(*pair) for pair in legs),
        platform=Platform(platform.mass, size * platform.com, size**2 * platform.inertia),
    )  # fmt: skip
    motion = dataclasses.replace(
        motion, position=size * motion.position, velocity=size * motion.velocity,
        acceleration=size * motion.acceleration, force=size * motion.force, moment=size**2 * motion.moment,
    )  # fmt: skip
    assert errors(forces_of(Drake, scaled, motion), scaled, motion).max() <= ROUNDING


class TestLock:
    """The angles of a BallRpyJoint lock at a pitch of 90 degrees, its angular velocity does not."""

    @pytest.mark.parametrize("away", [0, 1e-16, 1e-12, 1e-8, 1e-4, 1e-2])
    def test_platform_may_stand_upright(self, wu2012, away):
        for seed in range(10):
            rng = np.random.default_rng(seed)
            roll, yaw = rng.uniform(-np.pi, np.pi, 2)
            pitch = (-1) ** seed * np.pi / 2 - away
            quaternion = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_quat(scalar_first=True)
            motion = at_rest([0.1, 0.05, 0.4], quaternion, **self.rates(rng))
            assert errors(forces_of(Drake, wu2012, motion), wu2012, motion).max() <= ROUNDING

    @pytest.mark.parametrize("away", [0, 1e-12, 1e-8, 1e-4, 1e-2])
    @pytest.mark.parametrize("home", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [-1, 0, 0]])
    def test_leg_may_stand_across_its_home_direction(self, wu2012, home, away):
        for seed in range(5):
            motion = self.with_leg_along(wu2012, np.add(home, [away, -away, 2 * away]), seed)
            assert errors(forces_of(Drake, wu2012, motion), wu2012, motion).max() <= ROUNDING

    @pytest.mark.parametrize("away", [0, 1e-9, 5e-3])
    def test_universal_joint_is_singular_along_its_first_axis(self, wu2012, away):
        motion = self.with_leg_along(wu2012, [1, away, 0], 0)
        with pytest.raises(EngineError, match="singular universal joint at given sample 1: leg 1 ") as caught:
            DrakeUps(wu2012).inverse_dynamics(motion, lambda done: None)
        assert "\n" not in str(caught.value)

    @staticmethod
    def rates(rng):
        names = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
        return {name: rng.standard_normal(3) for name in names}

    def with_leg_along(self, mechanism, direction, seed):
        """A state in which leg 1 has this direction in its own home frame."""
        rng = np.random.default_rng(seed)
        turn = Rotation.from_rotvec(0.3 * rng.standard_normal(3))
        tree = Drake(mechanism)._tree
        home = tree.plant.GetJointByName("leg1_ball").frame_on_parent().CalcPoseInWorld(tree.context)
        leg = home.rotation().matrix() @ (direction / np.linalg.norm(direction))
        arm = turn.as_matrix() @ mechanism.platform_anchors[0]
        position = mechanism.base_anchors[0] + 0.6 * leg - arm
        return at_rest(position, turn.as_quat(scalar_first=True), **self.rates(rng))


class TestUps:
    def test_difference_is_the_axial_inertia_and_nothing_else(self, mechanism):
        motion = bundled("sinusoids", mechanism, 50)
        reference = sixsps.inverse_dynamics(mechanism, motion)
        whole, half = (
            forces_of(DrakeUps, with_axial_inertia(mechanism, factor), motion) - reference
            for factor in (1.0, 0.5)
        )
        largest = np.abs(reference).max()
        assert 1e-9 * largest < np.abs(whole).max() < 1e-6 * largest
        np.testing.assert_allclose(half, whole / 2, rtol=0, atol=1e-13 * largest)

    def test_without_axial_inertia_it_is_sps_to_rounding(self):
        for seed in range(50):
            mechanism = with_axial_inertia(random_mechanism(seed), 1e-15)
            motion = random_motion(mechanism, seed)
            assert errors(forces_of(DrakeUps, mechanism, motion), mechanism, motion).max() <= ROUNDING

    def test_says_in_one_line_that_drake_wants_another_inertia(self, wu2012):
        """What this package still takes for a rounded thin plate."""
        inertia = np.diag([0.0025, 0.0025, 0.0050000000045])
        plate = dataclasses.replace(wu2012, platform=Platform(1.0, [0, 0, 0], inertia))
        with pytest.raises(EngineError, match="do not satisfy the triangle inequality") as caught:
            DrakeUps(plate)
        assert "\n" not in str(caught.value)


class TestTrap:
    def test_is_wrong_by_nearly_all_of_the_force(self, wu2012):
        motion = bundled("line", wu2012, 50)
        reference = sixsps.inverse_dynamics(wu2012, motion)
        error = np.abs(forces_of(DrakeTree, wu2012, motion) - reference).max()
        assert error > 0.9 * np.abs(reference).max()

    def test_carries_each_leg_alone(self, wu2012):
        """Its actuators feel nothing of the platform's load."""
        motion = bundled("line", wu2012, 50)
        unloaded = dataclasses.replace(motion, force=np.zeros((50, 3)))
        light = dataclasses.replace(wu2012, platform=Platform(1e-3, [0, 0, 0], 1e-6 * np.eye(3)))
        trapped = forces_of(DrakeTree, wu2012, motion)
        assert np.array_equal(forces_of(DrakeTree, light, unloaded), trapped)

    def test_has_the_constraints_that_drake_ignores(self, wu2012):
        motion = bundled("line", wu2012, 50)
        trees = [engine(wu2012)._tree for engine in (DrakeTree, Drake)]
        assert [tree.plant.num_constraints() for tree in trees] == [6, 0]
        closed, opened = ([tau for tau, _ in drake.tree_forces(tree, motion)] for tree in trees)
        assert np.array_equal(closed, opened)
