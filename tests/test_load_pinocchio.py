"""The hexapod for users of Pinocchio: maps, closures and forces against laws and other derivations."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism, random_motion
from scipy.spatial.transform import Rotation

pin = pytest.importorskip("pinocchio")

import sixsps  # noqa: E402
import urdf  # noqa: E402
from sixsps.dynamics import State, forward_dynamics, mass_matrix  # noqa: E402
from sixsps.errors import MechanismError, MotionError  # noqa: E402
from sixsps.formulations.newton_euler import joint_reactions  # noqa: E402
from sixsps.home import home_position  # noqa: E402
from sixsps.kinematics import inverse_kinematics  # noqa: E402
from sixsps.limits import Limits  # noqa: E402
from sixsps.mechanism import Mechanism  # noqa: E402

EPS = np.finfo(float).eps
LEGS = range(1, 7)
WORLD = pin.LOCAL_WORLD_ALIGNED


@pytest.fixture(params=[*BUNDLED, *(f"random {seed}" for seed in range(5))])
def case(request):
    kind, _, seed = request.param.partition(" ")
    mechanism = random_mechanism(int(seed)) if seed else Mechanism.load(kind)
    return mechanism, urdf.load_pinocchio(mechanism), random_motion(mechanism, int(seed or 9))


def coordinates(hexapod, motion, k):
    q = hexapod.configuration(motion.position[k], motion.quaternion[k])
    v = hexapod.velocity(q, np.concatenate([motion.velocity[k], motion.angular_velocity[k]]))
    acceleration = np.concatenate([motion.acceleration[k], motion.angular_acceleration[k]])
    return q, v, hexapod.acceleration(q, v, acceleration)


def frame_rates(hexapod, q, v, a):
    """Velocities and accelerations of all loop ends (2, 12, 3), tips first, by the frames alone."""
    model, data = hexapod.model, hexapod.model.createData()
    pin.forwardKinematics(model, data, q, v, a)
    names = [f"leg{i}_tip" for i in LEGS] + [f"platform_anchor{i}" for i in LEGS]
    frames = [model.getFrameId(name) for name in names]
    return np.array(
        [
            [pin.getFrameVelocity(model, data, frame, WORLD).linear for frame in frames],
            [pin.getFrameClassicalAcceleration(model, data, frame, WORLD).linear for frame in frames],
        ]
    )


class TestModel:
    def test_names_limits_and_gravity(self, wu2012):
        strong = dataclasses.replace(wu2012, limits=Limits(force=[-200, 150], rate=0.4))
        hexapod = urdf.load_pinocchio(strong)
        model, data = hexapod.model, hexapod.data
        assert (model.nq, model.nv, model.njoints, model.name) == (37, 30, 14, "wu2012")
        assert hexapod.actuators == tuple(f"leg{i}_actuator" for i in LEGS)
        pin.framesForwardKinematics(model, data, hexapod.home)
        for name, q, v in zip(hexapod.actuators, hexapod.actuator_q, hexapod.actuator_v, strict=True):
            joint = model.joints[model.getJointId(name)]
            assert (joint.idx_q, joint.idx_v, joint.shortname()) == (q, v, "JointModelPZ")
        lengths = np.linalg.norm(
            home_position(wu2012) + wu2012.platform_anchors - wu2012.base_anchors, axis=1
        )
        strokes = np.array([model.lowerPositionLimit, model.upperPositionLimit])[:, hexapod.actuator_q]
        np.testing.assert_allclose(strokes.T + lengths[:, None], wu2012.length_limits, rtol=4 * EPS)
        assert (model.lowerEffortLimit[hexapod.actuator_v] == -200).all()
        assert (model.upperEffortLimit[hexapod.actuator_v] == 150).all()
        assert np.array_equal(model.lowerVelocityLimit, -model.upperVelocityLimit)
        assert (model.upperVelocityLimit[hexapod.actuator_v] == 0.4).all()
        assert np.array_equal(model.gravity.linear, wu2012.gravity)
        assert not model.gravity.angular.any()
        for forgotten in (model.rotorInertia, model.damping, model.armature, model.upperDryFrictionLimit):
            assert not np.any(forgotten)

    def test_without_limits_there_are_none(self, wu2012):
        model = urdf.load_pinocchio(wu2012).model
        largest = np.finfo(float).max
        assert (model.upperEffortLimit == largest).all()
        assert (model.lowerEffortLimit == -largest).all()
        assert (model.upperVelocityLimit == largest).all()
        assert (model.lowerVelocityLimit == -largest).all()

    def test_only_strokes_limit_positions(self, wu2012):
        """Quaternions too have no limits, which solvers would take for those of angles."""
        hexapod = urdf.load_pinocchio(wu2012)
        largest = np.finfo(float).max
        others = np.delete(np.arange(hexapod.model.nq), hexapod.actuator_q)
        assert (hexapod.model.lowerPositionLimit[others] == -largest).all()
        assert (hexapod.model.upperPositionLimit[others] == largest).all()

    def test_pickle_and_copy_build_it_anew(self, case):
        mechanism, hexapod, motion = case
        q, v, a = coordinates(hexapod, motion, 0)
        expected = hexapod.actuator_forces(q, v, a)
        for again in (pickle.loads(pickle.dumps(hexapod)), copy.deepcopy(hexapod), copy.copy(hexapod)):
            assert again.data is not hexapod.data
            assert again.mechanism.name == mechanism.name
            assert np.array_equal(again.actuator_forces(q, v, a).forces, expected.forces)

    def test_carries_the_numbers_exactly(self, case):
        mechanism, hexapod, _ = case
        platform = mechanism.platform
        expected = {"platform_joint": (platform.mass, platform.com, platform.inertia)}
        for i, leg in zip(LEGS, mechanism.legs, strict=True):
            for joint, link, sense in (("ball", leg.lower, 1), ("actuator", leg.upper, -1)):
                moments = np.diag([link.transverse, link.transverse, link.axial])
                expected[f"leg{i}_{joint}"] = link.mass, [0, 0, sense * link.com], moments
        assert list(hexapod.model.names) == ["universe", *expected]
        for name, (mass, com, inertia) in expected.items():
            found = hexapod.model.inertias[hexapod.model.getJointId(name)]
            assert found.mass == mass
            assert np.array_equal(found.lever, com)
            assert np.array_equal(found.inertia, inertia)

    def test_home_is_neutral_and_assembled(self, case):
        mechanism, hexapod, _ = case
        home = home_position(mechanism)
        assert np.array_equal(hexapod.home, pin.neutral(hexapod.model))
        assert np.array_equal(hexapod.home, hexapod.model.referenceConfigurations["home"])
        size = np.abs(mechanism.base_anchors).max() + np.abs(home).max()
        found = hexapod.configuration(home, [1, 0, 0, 0])
        np.testing.assert_allclose(found, hexapod.home, atol=16 * EPS * max(size, 1))

    def test_mass_matrix_is_that_of_the_platform(self, case):
        mechanism, hexapod, motion = case
        expected = mass_matrix(mechanism, motion.position, motion.rotation)
        scale = np.repeat([1.0, mechanism.characteristic_length], 3)
        for k in range(len(motion)):
            q = hexapod.configuration(motion.position[k], motion.quaternion[k])
            N = np.column_stack([hexapod.velocity(q, twist) for twist in np.eye(6)])
            tree = np.triu(pin.crba(hexapod.model, hexapod.data, q))
            tree += np.triu(tree, 1).T
            error = (N.T @ tree @ N - expected[k]) / scale / scale[:, None]
            assert np.abs(error).max() <= 1e-12 * np.abs(expected[k] / scale / scale[:, None]).max()

    def test_geometry_alone_has_no_dynamics(self):
        with pytest.raises(MechanismError, match=r"^gravity: missing.*geometry alone"):
            urdf.load_pinocchio(Mechanism.load("dietmaier1998"))


class TestMaps:
    def test_bodies_stand_where_the_pose_puts_them(self, case):
        mechanism, hexapod, motion = case
        model, data = hexapod.model, hexapod.data
        legs = inverse_kinematics(mechanism, motion)
        size = np.abs(mechanism.base_anchors).max() + np.abs(motion.position).max()
        for k in range(len(motion)):
            q = hexapod.configuration(motion.position[k], motion.rotation[k])
            pin.framesForwardKinematics(model, data, q)
            for i in LEGS:
                tip, anchor, lower = (
                    data.oMf[model.getFrameId(name)]
                    for name in (f"leg{i}_tip", f"platform_anchor{i}", f"leg{i}_lower")
                )
                expected = motion.position[k] + legs.arms[k, i - 1]
                assert np.abs(tip.translation - expected).max() <= 16 * EPS * size
                assert np.abs(anchor.translation - expected).max() <= 16 * EPS * size
                assert np.array_equal(lower.translation, mechanism.base_anchors[i - 1])
                np.testing.assert_allclose(lower.rotation[:, 2], legs.directions[k, i - 1], atol=16 * EPS)

    def test_there_and_back(self, case):
        _, hexapod, motion = case
        for k in range(len(motion)):
            state = hexapod.platform_state(*coordinates(hexapod, motion, k))
            for name in ("velocity", "angular_velocity", "angular_acceleration"):
                given = getattr(motion, name)[k]
                assert np.abs(getattr(state, name) - given).max() <= 8 * EPS * np.linalg.norm(given)
            # The body-frame acceleration is the difference of terms that may be larger.
            terms = np.linalg.norm(motion.acceleration[k])
            terms += np.linalg.norm(motion.velocity[k]) * np.linalg.norm(motion.angular_velocity[k])
            assert np.abs(state.acceleration - motion.acceleration[k]).max() <= 8 * EPS * terms
            size = np.abs(motion.position[k]).max() + np.abs(hexapod.layout.home).max()
            assert np.abs(state.position - motion.position[k]).max() <= 2 * EPS * size
            np.testing.assert_allclose(state.quaternion, motion.quaternion[k], atol=2 * EPS)
            again = hexapod.configuration(state.position, state.rotation)
            q = hexapod.configuration(motion.position[k], motion.rotation[k])
            np.testing.assert_allclose(again, q, atol=32 * EPS * max(size, 1))

    def test_closures_hold_to_the_second_derivative(self, case):
        mechanism, hexapod, motion = case
        legs = inverse_kinematics(mechanism, motion)
        for k in range(len(motion)):
            q, v, a = coordinates(hexapod, motion, k)
            Jc = hexapod.closure_jacobian(q)
            (velocity, acceleration) = frame_rates(hexapod, q, v, a)
            scale = np.abs(velocity).max()
            assert np.abs(Jc @ v).max() <= 64 * EPS * scale
            assert np.abs(velocity[:6] - velocity[6:]).max() <= 64 * EPS * scale
            # Jc a + dJc v is what the ends of the loops accelerate apart by.
            rate = np.abs(legs.leg_angular_velocity[k]).max() + np.abs(motion.angular_velocity[k]).max()
            scale = np.abs(acceleration).max() + rate * scale
            assert np.abs(acceleration[:6] - acceleration[6:]).max() <= 128 * EPS * scale
            assert np.abs(v[hexapod.actuator_v] - legs.length_rates[k]).max() <= 64 * EPS * scale

    def test_closure_jacobian_times_a_plus_its_rate_times_v(self, case):
        """dJc v by differences of Jc along the motion, of order h^2."""
        _, hexapod, motion = case
        q, v, a = coordinates(hexapod, motion, 0)
        h = 1e-5 / np.abs(v).max()
        ahead, behind = (
            hexapod.closure_jacobian(pin.integrate(hexapod.model, q, s * h * v)) for s in (1, -1)
        )
        bias = (ahead - behind) @ v / (2 * h)
        found = hexapod.closure_jacobian(q) @ a
        assert np.abs(found + bias).max() <= 1e-5 * (np.abs(bias).max() + np.abs(found).max())

    def test_spins_are_idle(self, case):
        """A leg that spins keeps the loops closed, and takes its spin along when it turns."""
        _, hexapod, motion = case
        q, v, _ = coordinates(hexapod, motion, 0)
        assert not v[8::4].any() or np.abs(v[8::4]).max() <= 16 * EPS * np.abs(v).max()
        spinning = v.copy()
        spinning[8::4] = np.abs(motion.angular_velocity[0]).max() * np.arange(1, 7)
        acceleration = np.concatenate([motion.acceleration[0], motion.angular_acceleration[0]])
        a = hexapod.acceleration(q, spinning, acceleration)
        ends = frame_rates(hexapod, q, spinning, a)
        for found in ends:
            scale = (
                np.abs(found).max()
                + np.abs(spinning).max() ** 2 * np.abs(hexapod.mechanism.platform_anchors).max()
            )
            assert np.abs(found[:6] - found[6:]).max() <= 256 * EPS * scale
        assert np.abs(a[8::4]).max() <= 64 * EPS * np.abs(a).max()

    @pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, np.pi / 2, np.pi - 1e-9, np.pi])
    def test_no_direction_locks_a_leg(self, wu2012, angle):
        """A leg at right angles to its home direction, where three revolute joints lock, and turned about."""
        hexapod = urdf.load_pinocchio(wu2012)
        home = home_position(wu2012)
        arm = wu2012.platform_anchors[0]
        leg = home + arm - wu2012.base_anchors[0]
        across = np.cross(leg, [1.0, 2.0, 3.0])
        turned = Rotation.from_rotvec(angle * across / np.linalg.norm(across)).apply(leg)
        position = wu2012.base_anchors[0] + turned - arm
        motion = at_rest(
            position, velocity=[0.1, 0.2, -0.3], angular_velocity=[0.5, -0.4, 0.3], acceleration=[1, 2, 3]
        )
        condition = inverse_kinematics(wu2012, motion).condition[0]
        q, v, a = coordinates(hexapod, motion, 0)
        assert np.abs(hexapod.closure_jacobian(q) @ v).max() <= 64 * EPS
        found = hexapod.actuator_forces(q, v, a).forces
        expected = sixsps.inverse_dynamics(wu2012, motion)[0]
        assert np.abs(found - expected).max() <= 100 * EPS * condition * np.abs(expected).max()

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (([0, 0], [1, 0, 0, 0]), "position: shape"),
            (([0, 0, np.nan], [1, 0, 0, 0]), r"position\[2\]: nan"),
            (([0, 0, 0.6], [0, 0, 0, 0]), "quaternion"),
            (([0, 0, 0.6], np.diag([1.0, 1, -1])), "rotation"),
            (([0, 0, 0.6], [[1, 0], [0, 1]]), "quaternion"),
        ],
    )
    def test_what_is_no_pose(self, wu2012, arguments, message):
        with pytest.raises(MotionError, match=message):
            urdf.load_pinocchio(wu2012).configuration(*arguments)

    def test_a_leg_without_length(self, wu2012):
        hexapod = urdf.load_pinocchio(wu2012)
        position = wu2012.base_anchors[2] - wu2012.platform_anchors[2]
        with pytest.raises(MotionError, match=r"leg 3 of length .*; allowed: legs longer than 1e-13 m"):
            hexapod.configuration(position, [1, 0, 0, 0])

    def test_what_are_no_coordinates(self, wu2012):
        hexapod = urdf.load_pinocchio(wu2012)
        zero = np.zeros(30)
        open_loop, long = hexapod.home.copy(), hexapod.home.copy()
        open_loop[hexapod.actuator_q[3]] += 1e-3
        long[3:7] *= 1.01
        for call in (
            lambda q: hexapod.velocity(q, zero[:6]),
            lambda q: hexapod.acceleration(q, zero, zero[:6]),
            lambda q: hexapod.actuator_forces(q, zero, zero),
        ):
            with pytest.raises(MotionError, match=r"the loop of leg 4 is open by 0\.001 m"):
                call(open_loop)
            with pytest.raises(MotionError, match=r"a quaternion of length 1\.01, of the platform"):
                call(long)
            with pytest.raises(MotionError, match="q: shape"):
                call(hexapod.home[:-1])
        with pytest.raises(MotionError, match="twist: shape"):
            hexapod.velocity(hexapod.home, zero)
        with pytest.raises(MotionError, match="a: shape"):
            hexapod.actuator_forces(hexapod.home, zero, zero[:6])


class TestForces:
    def test_agree_with_kane_and_the_reactions_of_newton_and_euler(self, case):
        mechanism, hexapod, motion = case
        expected = joint_reactions(mechanism, motion)
        kane = sixsps.inverse_dynamics(mechanism, motion)
        condition = inverse_kinematics(mechanism, motion).condition
        for k in range(len(motion)):
            q, v, a = coordinates(hexapod, motion, k)
            external = hexapod.external_forces(q, motion.force[k], motion.moment[k])
            found = hexapod.actuator_forces(q, v, a, external)
            tolerance = 100 * EPS * condition[k] * np.abs(kane[k]).max()
            assert np.abs(found.forces - kane[k]).max() <= tolerance
            assert np.abs(found.closure_forces - expected.platform[k]).max() <= tolerance
            length = max(1.0, mechanism.characteristic_length)
            assert found.residual <= tolerance * length

    def test_samples_leave_nothing_behind(self, case):
        """One object for all samples gives, bit for bit, what a new one gives for each."""
        mechanism, hexapod, motion = case
        for k in [*range(len(motion)), 0]:
            q, v, a = coordinates(hexapod, motion, k)
            external = hexapod.external_forces(q, motion.force[k], motion.moment[k])
            fresh = urdf.load_pinocchio(mechanism).actuator_forces(q, v, a, external)
            reused = hexapod.actuator_forces(q, v, a, external)
            assert np.array_equal(fresh.forces, reused.forces)
            assert np.array_equal(fresh.closure_forces, reused.closure_forces)

    def test_singular_poses_have_no_forces(self, wu2012):
        """The platform turned by a right angle about its normal, singular on similar hexagons."""
        singular = fichter(wu2012)
        hexapod = urdf.load_pinocchio(singular)
        position, turn = home_position(singular), Rotation.from_euler("z", 90, degrees=True)
        motion = at_rest(position, turn.as_quat(scalar_first=True))
        assert inverse_kinematics(singular, motion).condition[0] > 1e12
        found = hexapod.actuator_forces(*coordinates(hexapod, motion, 0))
        assert np.isnan(found.forces).all()
        assert np.isnan(found.closure_forces).all()
        assert np.isnan(found.residual)

    def test_constraint_dynamics_gives_the_motion_back(self, case):
        mechanism, hexapod, motion = case
        model, data = hexapod.model, hexapod.data
        # With an accuracy of zero it does all its iterations, and mu leaves nothing after the second.
        settings = pin.ProximalSettings(0.0, 1e-10 / mechanism.platform.mass, 4)
        forces = sixsps.inverse_dynamics(mechanism, motion)
        recovered = forward_dynamics(mechanism, State.of(motion), forces, motion.force, motion.moment)
        condition = inverse_kinematics(mechanism, motion).condition
        for k in range(len(motion)):
            q, v, _ = coordinates(hexapod, motion, k)
            tau = np.zeros(model.nv)
            tau[hexapod.actuator_v] = forces[k]
            external = hexapod.external_forces(q, motion.force[k], motion.moment[k])
            tau[:6] = external[model.getJointId("platform_joint")].vector
            found = pin.constraintDynamics(
                model, data, q, v, tau, hexapod.constraint_models, hexapod.constraint_datas, settings
            )
            state = hexapod.platform_state(q, v, np.array(found))
            expected = np.concatenate([motion.acceleration[k], motion.angular_acceleration[k]])
            got = np.concatenate([state.acceleration, state.angular_acceleration])
            scale = np.repeat([1.0, mechanism.characteristic_length], 3)
            size = np.abs(scale * expected).max() + np.linalg.norm(mechanism.gravity)
            assert np.abs(scale * (got - expected)).max() <= 1e-9 * size
            assert np.abs(scale * (recovered[k] - expected)).max() <= 1e-11 * condition[k] * size


def fichter(mechanism):
    """Anchors of base and platform as similar hexagons turned by 60 degrees: singular at a quarter turn."""
    angles = np.deg2rad([-10, 10, 110, 130, 230, 250])
    base = 0.3 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    angles = np.deg2rad([-50, 50, 70, 170, 190, 290])
    platform = 0.15 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    return dataclasses.replace(mechanism, base_anchors=base, platform_anchors=platform)


def test_state_is_a_pose_and_a_motion(wu2012):
    hexapod = urdf.load_pinocchio(wu2012)
    state = hexapod.platform_state(hexapod.home)
    assert np.array_equal(sixsps.Pose.of(state).position, state.position)
    motion = state.motion(force=[1, 2, 3])
    assert len(motion) == 1
    assert np.array_equal(motion.force, [[1, 2, 3]])
    held = hexapod.actuator_forces(
        hexapod.home, np.zeros(30), np.zeros(30), hexapod.external_forces(hexapod.home, [1, 2, 3])
    )
    expected = sixsps.inverse_dynamics(wu2012, motion)[0]
    np.testing.assert_allclose(held.forces, expected, rtol=1e-12)
