"""The principle of virtual work: leg frames, link Jacobians and accelerations against differences."""

import dataclasses

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from differences import curvature, slope
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.formulations import virtual_work
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Two evaluations of the same forces differ by this many cond(J) unit roundoffs at most; 8 was seen.
FACTOR = 20


def forces_of(mechanism, motion):
    return sixsps.inverse_dynamics(mechanism, motion, formulation="virtual-work")


def assert_same_forces(mechanism, motion, forces, expected):
    bound = FACTOR * UNIT_ROUNDOFF * inverse_kinematics(mechanism, motion).condition
    assert np.all(np.abs(forces - expected).max(axis=1) <= bound * np.abs(expected).max(axis=1))


@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_kane(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed, tilt=1.0)
    expected = sixsps.inverse_dynamics(mechanism, motion)
    assert_same_forces(mechanism, motion, forces_of(mechanism, motion), expected)


@pytest.mark.parametrize("seed", range(5))
def test_world_frame_far_away_costs_no_digits(seed):
    """Beyond those that the coordinates themselves have lost, which are lost to both."""
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    far = 1e6 * mechanism.characteristic_length * np.array([1.0, -2.0, 0.5])
    mechanism = dataclasses.replace(mechanism, base_anchors=mechanism.base_anchors + far)
    motion = dataclasses.replace(motion, position=motion.position + far)
    expected = sixsps.inverse_dynamics(mechanism, motion)
    assert_same_forces(mechanism, motion, forces_of(mechanism, motion), expected)


# Horizontal parts of a unit vector, from none over what rounds away to all of it.
SLOPES = [0.0, -0.0, 5e-324, 1e-300, 1e-160, 1e-17, 1e-8, 1e-3, 0.5, 1.0]


class TestLegFrames:
    @pytest.mark.parametrize("slope", SLOPES)
    @pytest.mark.parametrize("up", [1, -1])
    @pytest.mark.parametrize("heading", [(1, 0), (0, 1), (-1, 0), (0, -1), (0.6, -0.8), (-0.0, 0.0)])
    def test_are_rotations_with_z_along_the_leg(self, slope, up, heading):
        """Upright, hanging and level legs alike, with warnings as errors."""
        vector = 0.7 * np.array([slope * heading[0], slope * heading[1], up * np.sqrt(1 - slope**2)])
        if not vector.any():
            return
        length = np.linalg.norm(vector)
        frame = virtual_work.leg_frames(vector, length)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=4e-16)
        assert np.linalg.det(frame) == pytest.approx(1, abs=1e-15)
        np.testing.assert_allclose(frame[2], vector / length, atol=3e-16)

    def test_are_turned_by_two_angles(self):
        phi, theta = 0.7, 2.1
        expected = Rotation.from_euler("ZY", [phi, theta]).as_matrix()
        np.testing.assert_allclose(virtual_work.leg_frames(2 * expected[:, 2], 2.0), expected.T, atol=1e-15)


@pytest.fixture(params=range(5))
def state(request):
    """Mechanism, motion of a few states, and its legs."""
    mechanism = random_mechanism(request.param)
    motion = random_motion(mechanism, request.param)
    return mechanism, motion, virtual_work.leg_motion(mechanism, motion)


def links(mechanism, motion):
    """Leg directions and centres of mass of the links, (n, 6, 3) in world axes: positions only."""
    joints = motion.position[:, None] + mechanism.platform_anchors @ motion.rotation.swapaxes(1, 2)
    vectors = joints - mechanism.base_anchors
    s = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    lower = mechanism.base_anchors + mechanism.lower.com[:, None] * s
    return s, lower, joints - mechanism.upper.com[:, None] * s


def in_leg_axes(legs, vectors):
    return np.einsum("nkij,nkj->nki", legs.frames, vectors)


def close(found, expected, tolerance):
    return np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def displaced(motion, shift, turn):
    """The pose shifted by (n, 3) or (3,), and turned by rotation vectors in world axes."""
    rotation = Rotation.from_rotvec(turn + np.zeros((len(motion), 3)))
    quaternion = (rotation * Rotation.from_matrix(motion.rotation)).as_quat(scalar_first=True)
    return dataclasses.replace(motion, position=motion.position + shift, quaternion=quaternion)


def test_link_jacobians_are_the_slopes_of_link_positions(state):
    mechanism, motion, legs = state
    lower, upper = virtual_work.link_jacobians(mechanism, legs)
    size = mechanism.characteristic_length
    for column, axis in enumerate(np.eye(6)):
        unit = 0.1 * size if column < 3 else 0.1

        def at(h, axis=axis, unit=unit):
            return np.stack(links(mechanism, displaced(motion, h * unit * axis[:3], h * unit * axis[3:])))

        change = slope(at) / unit
        d_lower, d_upper = (in_leg_axes(legs, vectors) for vectors in change[1:])
        turning = in_leg_axes(legs, np.cross(links(mechanism, motion)[0], change[0]))
        assert close(lower[..., :3, column], d_lower, 1e-9)
        assert close(upper[..., :3, column], d_upper, 1e-9)
        assert close(lower[..., 3:, column], turning, 1e-9)
        assert close(upper[..., 3:, column], turning, 1e-9)


def test_accelerations_are_the_curvatures_of_link_positions(state):
    mechanism, motion, legs = state
    scale = 0.01 * mechanism.characteristic_length / np.abs(motion.velocity).max()

    def at(h):
        t = h * scale
        shift = motion.velocity * t + motion.acceleration * t**2 / 2
        turn = motion.angular_velocity * t + motion.angular_acceleration * t**2 / 2
        return np.stack(links(mechanism, displaced(motion, shift, turn)))

    second = curvature(at) / scale**2
    accelerations = virtual_work.link_accelerations(mechanism, legs)
    assert close(accelerations.lower, in_leg_axes(legs, second[1]), 1e-6)
    assert close(accelerations.upper, in_leg_axes(legs, second[2]), 1e-6)
    turning = np.cross(links(mechanism, motion)[0], second[0])
    assert close(accelerations.angular, in_leg_axes(legs, turning), 1e-6)


def test_last_rows_of_the_joint_jacobians_give_length_rates(state):
    mechanism, motion, legs = state
    expected = inverse_kinematics(mechanism, motion).jacobian
    assert close(legs.joint_jacobian[:, :, 2], expected, 1e-13)


def with_leg_along_z(seed):
    """A mechanism whose first leg is the platform's position, to the last bit."""
    mechanism = random_mechanism(seed)
    base, platform = np.array(mechanism.base_anchors), np.array(mechanism.platform_anchors)
    base[0] = platform[0] = 0.0
    return dataclasses.replace(mechanism, base_anchors=base, platform_anchors=platform)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize("offset", [0.0, -0.0, 1e-300, -1e-160, 1e-17, -1e-8, 1e-3])
def test_vertical_legs_standing_and_hanging(seed, up, offset):
    mechanism = with_leg_along_z(seed)
    motion = random_motion(mechanism, seed)
    height = np.abs(motion.position[:, 2])
    position = np.column_stack([np.full(5, offset), np.full(5, -offset), up * height])
    motion = dataclasses.replace(motion, position=position)
    s = inverse_kinematics(mechanism, motion).directions[:, 0]
    assert np.abs(s[:, 2] - up).max() <= 1e-4
    expected = sixsps.inverse_dynamics(mechanism, motion)
    assert_same_forces(mechanism, motion, forces_of(mechanism, motion), expected)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0.6, 0.8, 0]])
@pytest.mark.parametrize("seed", [1, 2, 3])  # their legs all stand
def test_hanging_upside_down_takes_the_same_forces(seed, axis):
    """The world turned over, so that all legs point down."""
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    over = Rotation.from_rotvec(np.pi * np.array(axis))

    def turned(vectors):
        return vectors @ over.as_matrix().T

    hanging = dataclasses.replace(
        mechanism, gravity=turned(mechanism.gravity), base_anchors=turned(mechanism.base_anchors)
    )
    vectors = ("position", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
    moved = dataclasses.replace(
        motion,
        quaternion=(over * Rotation.from_matrix(motion.rotation)).as_quat(scalar_first=True),
        **{name: turned(getattr(motion, name)) for name in (*vectors, "force", "moment")},
    )
    assert inverse_kinematics(hanging, moved).directions[..., 2].max() < 0
    assert_same_forces(mechanism, motion, forces_of(hanging, moved), forces_of(mechanism, motion))


@pytest.mark.parametrize("seed", range(10))
def test_at_rest_and_unloaded_the_legs_lift_the_weights(seed):
    """Work of the legs in small displacements is weight times height, both differenced."""
    mechanism = random_mechanism(seed)
    state = random_motion(mechanism, seed, samples=1)
    still = at_rest(state.position[0], state.quaternion[0])
    forces = forces_of(mechanism, still)[0]
    size = mechanism.characteristic_length
    lower, upper, platform = mechanism.lower, mechanism.upper, mechanism.platform
    for axis in np.eye(6):

        def moved(h, axis=axis):
            return displaced(still, 0.1 * h * size * axis[:3], 0.1 * h * axis[3:])

        def potential(h):
            _, d, u = links(mechanism, moved(h))
            com = moved(h).position[0] + moved(h).rotation[0] @ platform.com
            moment = platform.mass * com + lower.mass @ d[0] + upper.mass @ u[0]
            return -moment @ mechanism.gravity

        def lengths(h):
            return inverse_kinematics(mechanism, moved(h)).lengths[0]

        work = forces * slope(lengths)
        assert abs(work.sum() - slope(potential)) <= 1e-9 * np.abs(work).sum()


class TestSingularPoses:
    """With warnings as errors: what a lost sample divides by zero is nobody's business."""

    def test_give_nan_and_the_others_forces(self, wu2012):
        motion = bundled("line", wu2012, 5)
        position = np.array(motion.position)
        position[1] = [0.01, 0.02, 0.0]  # flat: no leg can push out of the plane
        position[3] = wu2012.base_anchors[0] - wu2012.platform_anchors[0]  # a leg of no length
        forces = forces_of(wu2012, dataclasses.replace(motion, position=position))
        assert np.isnan(forces[[1, 3]]).all()
        assert np.isfinite(forces[[0, 2, 4]]).all()
        single = forces_of(wu2012, dataclasses.replace(motion, position=position)[1:2])
        assert np.isnan(single).all()

    @pytest.mark.parametrize("length", [0.0, 5e-324, 1e-300, 1e-160, 1e-20])
    def test_leg_of_hardly_any_length_gives_nan(self, length):
        mechanism = with_leg_along_z(0)
        position = np.full((5, 3), length)
        motion = dataclasses.replace(random_motion(mechanism, 0), position=position)
        assert np.isnan(forces_of(mechanism, motion)).all()


def test_no_samples_give_no_forces(wu2012):
    empty = bundled("line", wu2012, 5)[:0]
    assert virtual_work.inverse_dynamics(wu2012, empty).shape == (0, 6)
