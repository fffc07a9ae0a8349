"""A robot on the platform: its wrench against the whole tree, its own momentum and a rigid body."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import BUNDLED, random_mechanism, random_motion
from differences import curvature
from urdf_bodies import Bodies, composite

import sixsps
from compare.metrics import loads, scales
from compare.payload.cargo import RobotCargo
from compare.payload.catalogue import find_robot
from compare.payload.mount import Mount
from compare.payload.ride import Carrier, JointMotion, Ride
from compare.tolerances import tolerance_of
from sixsps.payload import Payload, attached, shifted_wrench
from sixsps.trajectories import bundled, sinusoids

pytest.importorskip("pinocchio", reason="pin has no wheel for this platform")

from compare.payload.robot import RobotModel, base_wrench
from compare.payload.whole_tree import PinocchioPayload

# Two arms, two humanoids, joints without limits and sliding ones, and a robot without any joint.
ROBOTS = ("panda", "ur5", "talos", "romeo", "kinova", "iris_simple")
MOUNT = Mount.at(0.05, -0.1, 0.2, 0.3, -0.2, 1.0)
EPS = np.finfo(float).eps


@cache
def model(name):
    return RobotModel(find_robot(name))


@cache
def bodies(name):
    return Bodies(find_robot(name).urdf)


def ride(name, mechanism, motion, joints=None, mount=MOUNT):
    """The ride of a robot that moves as `joints` says, or as nothing that moves does."""
    if joints is None:
        rng = np.random.default_rng(7)
        joints = JointMotion(*rng.uniform(-2, 2, (3, len(motion), len(model(name).names))))
    return Ride(Carrier(mechanism, find_robot(name), mount), motion, joints)


def loaded(riding):
    wrench = base_wrench(riding, model(riding.carrier.robot.name))
    motion = riding.platform
    return replace(motion, force=motion.force + wrench.force, moment=motion.moment + wrench.moment)


def check_agreement(name, mechanism, riding):
    """The forces of the Kane model under the robot's wrench are those of the whole tree; so are torques."""
    tree = PinocchioPayload(riding.carrier).tree_forces(riding)
    motion = loaded(riding)
    forces = sixsps.inverse_dynamics(mechanism, motion)
    growth = sixsps.inverse_kinematics(mechanism, motion).error_growth
    allowed = tolerance_of("kane").relative(growth) + tolerance_of("pinocchio-payload").relative(growth)
    error = np.abs(tree.legs.forces - forces).max(axis=1)
    assert (error <= allowed * scales(forces, loads(mechanism, motion))).all()
    assert error.max() <= 1e-10 * np.abs(forces).max()
    torques = base_wrench(riding, model(name)).torques
    assert np.abs(tree.torques - torques).max(initial=0) <= 100 * EPS * np.abs(torques).max(initial=0)
    assert tree.legs.closure_error.max() <= 100 * EPS * mechanism.length_limits.max()
    return forces


class TestWholeTree:
    @pytest.mark.parametrize("name", ROBOTS)
    def test_of_bundled_mechanisms_with_a_moving_robot(self, name, mechanism):
        check_agreement(name, mechanism, ride(name, mechanism, bundled("sinusoids", mechanism, 7)))

    @pytest.mark.parametrize("name", ROBOTS)
    @pytest.mark.parametrize("bundle", BUNDLED)
    def test_of_bundled_mechanisms_with_a_standing_robot(self, name, bundle):
        mechanism = sixsps.Mechanism.load(bundle)
        motion = bundled("line", mechanism, 5)
        riding = RobotCargo(model(name), MOUNT).aboard(mechanism, motion).ride
        check_agreement(name, mechanism, riding)

    @pytest.mark.parametrize("seed", range(len(ROBOTS)))
    def test_of_random_mechanisms_whose_platforms_are_off_centre(self, seed):
        mechanism, name = random_mechanism(seed), ROBOTS[seed]
        size = mechanism.characteristic_length
        place = Mount.at(*size * np.random.default_rng(seed).standard_normal(3), 1.0, 2.0, 3.0)
        motion = random_motion(mechanism, seed)
        check_agreement(name, mechanism, ride(name, mechanism, motion, mount=place))

    def test_on_a_platform_at_rest(self, wu2012):
        motion = bundled("line", wu2012, 3)
        zero = np.zeros((3, 3))
        names = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
        resting = replace(motion, **dict.fromkeys(names, zero))
        still = JointMotion(np.ones((3, 6)), np.zeros((3, 6)), np.zeros((3, 6)))
        riding = ride("ur5", wu2012, resting, still)
        check_agreement("ur5", wu2012, riding)
        wrench = base_wrench(riding, model("ur5"))
        weight = model("ur5").mass * wu2012.gravity
        np.testing.assert_allclose(wrench.force, np.tile(weight, (3, 1)), rtol=0, atol=1e-13 * 206)

    @pytest.mark.parametrize("part", ["force", "moment"])
    def test_tells_a_wrench_that_is_slightly_wrong(self, wu2012, part):
        riding = ride("panda", wu2012, bundled("sinusoids", wu2012, 3))
        motion = loaded(riding)
        wrong = replace(motion, **{part: getattr(motion, part) * (1 + 1e-9)})
        tree = PinocchioPayload(riding.carrier).inverse_dynamics(riding, lambda done: None)
        difference = np.abs(tree.forces - sixsps.inverse_dynamics(wu2012, wrong)).max()
        assert difference > 1e-10 * np.abs(tree.forces).max()


def smooth(time):
    """Platform and joints at one time, in slow sinusoids whose derivatives are known."""
    return sinusoids(
        np.array([time, time + 1]), [0.1, -0.2, 0.5, 0.2, -0.3, 0.4], [0.1, 0.2, 0.05, 0.4, 0.3, 0.5],
        [0.1, 0.2, 0.3, 0.15, 0.12, 0.08], [0, 1, 2, 3, 4, 5],
    )[:1]  # fmt: skip


def joint_curve(number, time, order=0):
    """Position of joints 0, 1, ... at a time, or a derivative of it."""
    rate = 1 + 0.1 * np.arange(number)
    return rate**order * np.sin(rate * time + np.arange(number) + order * np.pi / 2)


def homogeneous(rotation, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


@pytest.mark.parametrize("name", ["panda", "ur5", "talos", "kinova"])
def test_wrench_is_what_the_momentum_of_the_urdf_says(name, wu2012):
    """Second differences of where the file's text puts the bodies: no velocity, no library for robots.

    Over all particles of a body, sum(m r x r'') is the axial vector of R J R''^T with J the second
    moments of mass, plus that of the centre of mass.
    """
    robot, time = model(name), 0.3
    mechanism = replace(wu2012, gravity=[1.0, -2.0, -9.0])
    mass = [body[0] for body in bodies(name).placed(np.eye(4), {})]
    second = [np.trace(i) / 2 * np.eye(3) - i for _, _, i in bodies(name).placed(np.eye(4), {})]

    def placed(moment):
        platform = smooth(time + moment)
        base = homogeneous(platform.rotation[0], platform.position[0]) @ homogeneous(
            MOUNT.rotation, MOUNT.position
        )
        positions = dict(zip(robot.names, joint_curve(len(robot.names), time + moment), strict=True))
        return np.array([pose for _, pose, _ in bodies(name).placed(base, positions)])

    here, change = placed(0.0), curvature(placed)
    platform = smooth(time)
    com = platform.position[0] + platform.rotation[0] @ mechanism.platform.com
    force, moment = np.zeros(3), np.zeros(3)
    for m, J, pose, rate in zip(mass, second, here, change, strict=True):
        pull = m * (mechanism.gravity - rate[:3, 3])
        B = pose[:3, :3] @ J @ rate[:3, :3].T
        spin = np.array([B[1, 2] - B[2, 1], B[2, 0] - B[0, 2], B[0, 1] - B[1, 0]])
        force += pull
        moment += np.cross(pose[:3, 3] - com, pull) - spin
    joints = JointMotion(*(joint_curve(len(robot.names), time, order)[None] for order in range(3)))
    wrench = base_wrench(ride(name, mechanism, platform, joints), robot)
    # Unit roundoff over the step squared, 1e-12, times terms that cancel, and the differences' eighth order.
    np.testing.assert_allclose(wrench.force[0], force, rtol=0, atol=1e-9 * np.abs(force).max())
    np.testing.assert_allclose(wrench.moment[0], moment, rtol=0, atol=1e-9 * np.abs(force).max())


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", [3, 4])
def test_robot_that_stands_still_is_a_rigid_payload(name, seed):
    """Of the composite mass, centre and inertia that the file's text gives where the robot stands."""
    robot, mechanism = model(name), random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    _, angles = robot.standing
    riding = RobotCargo(robot, MOUNT).aboard(mechanism, motion).ride
    base = homogeneous(MOUNT.rotation, MOUNT.position)
    standing = bodies(name).placed(base, dict(zip(robot.names, angles, strict=True)))
    carrying = attached(mechanism, Payload(*composite(standing)))
    assert abs(robot.mass - composite(standing)[0]) <= 100 * EPS * robot.mass
    rigid = sixsps.inverse_dynamics(
        carrying, shifted_wrench(motion, mechanism.platform.com, carrying.platform.com)
    )
    forces = check_agreement(name, mechanism, riding)
    growth = sixsps.inverse_kinematics(mechanism, motion).error_growth
    scale = scales(forces, loads(mechanism, loaded(riding)))
    assert (np.abs(rigid - forces).max(axis=1) <= 2 * tolerance_of("kane").relative(growth) * scale).all()
    assert np.abs(rigid - forces).max() <= 1e-10 * np.abs(forces).max()


def test_mount_is_an_origin_of_urdf():
    """A base that is turned and moved by the mount is one that a fixed joint with this origin holds."""
    turned = Mount.at(1, 2, 3, 0.1, -0.2, 0.3)
    text = '<r><origin xyz="1 2 3" rpy="0.1 -0.2 0.3"/></r>'
    from xml.etree import ElementTree

    from urdf_bodies import _origin

    wanted = _origin(ElementTree.fromstring(text))
    np.testing.assert_allclose(homogeneous(turned.rotation, turned.position), wanted, rtol=0, atol=4 * EPS)
