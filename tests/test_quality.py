"""Quality of poses, against differences of leg lengths and against draws of loads and errors."""

from dataclasses import replace

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism, random_motion, scaled
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.errors import InputError, MotionError
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.pose import Pose
from sixsps.pose_quality import quality

NAMES = [*BUNDLED, *range(4)]


def drawn(name, samples=5):
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    return mechanism, random_motion(mechanism, 3, samples=samples, tilt=0.3)


def jacobian_by_differences(mechanism, position, rotation):
    """Leg lengths differentiated by displacement [m] and rotation [rad] in world axes."""
    size = mechanism.characteristic_length
    columns = []
    for k in range(6):
        step = 1e-5 * (size if k < 3 else 1)

        def lengths(h, k=k):
            moved = position + (h * np.eye(3)[k] if k < 3 else 0)
            turn = Rotation.from_rotvec(h * np.eye(3)[k - 3]).as_matrix() if k >= 3 else np.eye(3)
            joints = moved + (turn @ rotation @ mechanism.platform_anchors.T).T
            return np.linalg.norm(joints - mechanism.base_anchors, axis=1)

        columns.append((lengths(step) - lengths(-step)) / (2 * step))
    return np.column_stack(columns)


@pytest.mark.parametrize("name", NAMES)
def test_figures_are_those_of_differentiated_lengths(name):
    mechanism, motion = drawn(name)
    found, size = quality(mechanism, motion), mechanism.characteristic_length
    assert found.characteristic_length == size
    for k in range(len(motion)):
        J = jacobian_by_differences(mechanism, motion.position[k], motion.rotation[k]) / np.repeat(
            [1, size], 3
        )
        gram = np.sort(np.linalg.eigvalsh(J.T @ J))[::-1]
        # Differences are good to the step squared, 1e-10; the least singular value suffers most.
        error = 1e-8 * found.condition[k]
        np.testing.assert_allclose(found.singular_values[k] ** 2, gram, rtol=error, atol=error)
        assert found.manipulability[k] == pytest.approx(abs(np.linalg.det(J)), rel=error)
        assert found.determinant_sign[k] == np.sign(np.linalg.det(J))
    legs = inverse_kinematics(mechanism, motion)
    np.testing.assert_allclose(found.condition, legs.condition, rtol=1e-13)
    np.testing.assert_allclose(found.dexterity * found.condition, 1, rtol=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_no_load_and_no_error_of_the_legs_does_more(name):
    mechanism, motion = drawn(name)
    found, rng = quality(mechanism, motion), np.random.default_rng(1)
    jacobians = inverse_kinematics(mechanism, motion).jacobian
    for k, J in enumerate(jacobians):
        for part, most in ((slice(0, 3), found.force_per_force), (slice(3, 6), found.force_per_moment)):
            wrenches = np.zeros((6, 20000))
            loads = rng.standard_normal((3, 20000))
            wrenches[part] = loads / np.linalg.norm(loads, axis=0)
            forces = np.abs(np.linalg.solve(J.T, wrenches)).max(axis=1)
            assert (forces <= most[k] * (1 + 1e-9)).all()
            assert (forces >= most[k] * 0.99).all()  # the nearest of 20000 directions is 1 % off at most
        errors = rng.uniform(-1, 1, (6, 20000))
        corners = np.array(np.meshgrid(*[[-1, 1]] * 6)).reshape(6, -1)
        for part, most in ((slice(0, 3), found.position_error), (slice(3, 6), found.orientation_error)):
            inner = np.linalg.norm(np.linalg.solve(J, errors)[part], axis=0).max()
            assert inner <= most[k]
            attained = np.linalg.norm(np.linalg.solve(J, corners)[part], axis=0).max()
            assert attained == pytest.approx(most[k], rel=1e-9)


def test_sign_of_the_determinant_changes_with_the_assembly():
    """The platform below its base is the mirror image of that above it."""
    mechanism = Mechanism.load("wu2012")
    above, below = (at_rest([0.01, 0.02, height]) for height in (0.5, -0.5))
    assert (
        quality(mechanism, above).determinant_sign[0] == -quality(mechanism, below).determinant_sign[0] != 0
    )


@pytest.mark.parametrize("height", [0.0, 1e-14])
def test_a_singular_pose_has_no_inverse(height):
    mechanism = Mechanism.load("wu2012")
    found = quality(mechanism, at_rest([0.01, 0.02, height]))
    assert np.isposinf(found.condition[0])
    assert found.dexterity[0] == 0
    assert found.determinant_sign[0] == 0
    assert found.manipulability[0] < 1e-12
    assert found.singular_values[0, -1] < 1e-12
    for values in (found.force_per_force, found.force_per_moment, found.position_error):
        assert np.isnan(values).all()


def test_a_leg_without_length_has_no_direction():
    mechanism = random_mechanism(1)
    found = quality(mechanism, at_rest(mechanism.base_anchors[2] - mechanism.platform_anchors[2]))
    assert np.isposinf(found.condition[0])
    assert np.isnan(found.singular_values).all()
    assert found.determinant_sign[0] == 0


def test_another_characteristic_length_changes_what_depends_on_it_alone():
    mechanism, motion = drawn(2)
    one, other = quality(mechanism, motion), quality(mechanism, motion, length=0.01)
    assert other.characteristic_length == 0.01
    for name in ("force_per_force", "force_per_moment", "position_error", "orientation_error"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=1e-9)
    ratio = (mechanism.characteristic_length / 0.01) ** 3
    np.testing.assert_allclose(other.manipulability, ratio * one.manipulability, rtol=1e-9)
    assert (other.condition > 2 * one.condition).all()


def test_units_and_the_world_frame_do_not_matter():
    mechanism, motion = drawn(3)
    one = quality(mechanism, motion)
    inches = quality(scaled(mechanism, 39.37, 1.0), replace(motion, position=39.37 * motion.position))
    Q, far = Rotation.random(rng=1), np.array([1.0, 2.0, -1.0])
    turned = replace(
        mechanism,
        base_anchors=Q.apply(np.array(mechanism.base_anchors)) + far,
        gravity=Q.apply(np.array(mechanism.gravity)),
    )
    there = quality(turned, (Q.apply(np.array(motion.position)) + far, Q.as_matrix() @ motion.rotation))
    for name in ("singular_values", "condition", "manipulability", "determinant_sign", "force_per_force"):
        np.testing.assert_allclose(getattr(inches, name), getattr(one, name), rtol=1e-9)
        np.testing.assert_allclose(getattr(there, name), getattr(one, name), rtol=1e-9)
    np.testing.assert_allclose(inches.force_per_moment, one.force_per_moment / 39.37, rtol=1e-9)
    np.testing.assert_allclose(there.position_error, one.position_error, rtol=1e-9)


def test_poses_may_be_given_in_all_ways():
    mechanism, motion = drawn(1, samples=2)
    expected = sixsps.quality(mechanism, motion)
    poses = [Pose.of((motion.position[k], motion.quaternion[k])) for k in range(2)]
    pairs = [(motion.position[k], motion.rotation[k]) for k in range(2)]
    for given in (poses, tuple(poses), pairs, (motion.position, motion.rotation)):
        np.testing.assert_allclose(quality(mechanism, given).condition, expected.condition, rtol=1e-12)
    for given in (poses[0], pairs[0], [poses[0]], motion[:1], list(pairs[0])):
        found = quality(mechanism, given)
        assert len(found) == 1
        np.testing.assert_allclose(found.condition, expected.condition[:1], rtol=1e-12)
    assert len(quality(mechanism, motion[:0])) == 0


@pytest.mark.parametrize(
    ("poses", "says"),
    [
        ("home", "pose: home; allowed: a pose, one sample"),
        ([], r"pose: \[\]; allowed"),
        ([[0, 0, 1], "up"], "numbers of shape"),
        ((np.zeros((2, 3)), np.zeros((1, 3, 3))), r"rotation: shape \(1, 3, 3\); allowed: shape \(2, 3, 3\)"),
        ((np.zeros((1, 3)), 2 * np.eye(3)[None]), "rotation, index 0: .* orthogonal matrices"),
        ((np.zeros((1, 3)), -np.eye(3)[None]), "rotation, index 0: .* orthogonal matrices"),
        ((np.full((1, 3), np.nan), np.eye(3)[None]), r"position\[0, 0\]: nan"),
    ],
)
def test_what_is_no_pose_is_refused(poses, says):
    with pytest.raises(MotionError, match=says):
        quality(random_mechanism(1), poses)


@pytest.mark.parametrize("length", [0, -1, np.nan, [1, 2], "long"])
def test_a_length_that_cannot_be_is_refused(length):
    mechanism, motion = drawn(1)
    with pytest.raises(InputError, match="length: "):
        quality(mechanism, motion, length=length)


def test_what_forward_kinematics_and_assembly_modes_return_are_poses():
    mechanism = Mechanism.load("wu2012")
    lengths = [[0.7, 0.72, 0.68, 0.7, 0.71, 0.69], [0.7] * 6, [0.71] * 6]
    found = sixsps.forward_kinematics(mechanism, lengths)
    expected = quality(mechanism, (found.position, found.rotation))
    np.testing.assert_allclose(quality(mechanism, found).condition, expected.condition, rtol=1e-12)
    turned = quality(mechanism, (found.position, -3e-200 * found.quaternion))
    np.testing.assert_allclose(turned.condition, expected.condition, rtol=1e-12)
    distance = sixsps.singularity_distance(mechanism, found)
    assert distance.distance.shape == (3,)
    single = sixsps.forward_kinematics(mechanism, lengths[0])
    assert quality(mechanism, single).condition[0] == pytest.approx(expected.condition[0], rel=1e-12)
    modes = sixsps.assembly_modes(mechanism, lengths[0])
    assert len(modes) > 1
    one_by_one = [quality(mechanism, mode).condition[0] for mode in modes]
    np.testing.assert_allclose(quality(mechanism, modes).condition, one_by_one, rtol=1e-9)
    assert len(quality(mechanism, sixsps.assembly_modes(mechanism, [0.7] * 5 + [2.0]))) == 0
    state = sixsps.State(found.position, found.quaternion, np.zeros((3, 3)), np.zeros((3, 3)))
    np.testing.assert_allclose(quality(mechanism, state).condition, expected.condition, rtol=1e-12)
    lost = sixsps.forward_kinematics(mechanism, [[0.7] * 6, [0.7] * 5 + [2.0]], on_failure="return")
    with pytest.raises(MotionError, match=r"position\[1, 0\]: nan"):
        quality(mechanism, lost)


@pytest.mark.parametrize("length", [1e-300, 1e-22, 1e22, 1e60, True])
def test_lengths_whose_cubes_are_no_numbers_are_refused(length):
    mechanism, motion = drawn(1)
    for function in (quality, sixsps.singularity_distance):
        with pytest.raises(InputError, match="length: "):
            function(mechanism, motion, length=length)


@pytest.mark.parametrize("factor", [1e-19, 1e19])
def test_lengths_far_from_the_mechanism_give_numbers(factor):
    """All poses are singular by their condition number; nothing overflows on the way."""
    mechanism, motion = drawn(1)
    length = factor * mechanism.characteristic_length
    assert np.isposinf(quality(mechanism, motion, length=length).condition).all()
    distance = sixsps.singularity_distance(mechanism, motion, length=length)
    assert (distance.distance == 0).all()
    assert (distance.none_within == 0).all()


def test_name_of_a_mechanism_is_none():
    for function in (quality, sixsps.singularity_distance):
        with pytest.raises(InputError, match="mechanism: wu2012"):
            function("wu2012", drawn(1)[1])
