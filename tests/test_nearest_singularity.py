"""The nearest singular pose: it is singular, it is where it is said to be, and no draw finds a nearer one."""

from dataclasses import replace

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism, random_motion, scaled
from near_singular import near_singular
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.errors import InputError
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singular_poses.nearest import singularity_distance
from sixsps.singular_poses.surface import SingularSet, left_jacobians, rotation_vectors, turned
from sixsps.trajectories import bundled

NAMES = [*BUNDLED, *range(5)]


def drawn(name, samples=4):
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    return mechanism, random_motion(mechanism, 11, samples=samples, tilt=0.3)


def jacobians(mechanism, position, rotation):
    """By the inverse kinematics, which shares nothing with the function whose zeros are sought."""
    n = len(position)
    zero = np.zeros((n, 3))
    motion = Motion(
        time=np.arange(n),
        position=position,
        quaternion=Rotation.from_matrix(rotation).as_quat(scalar_first=True),
        velocity=zero, angular_velocity=zero, acceleration=zero, angular_acceleration=zero,
    )  # fmt: skip
    return inverse_kinematics(mechanism, motion)


def around(mechanism, position, rotation, distances, rng):
    """Poses at these distances from one, in directions drawn evenly over pose space."""
    x = rng.standard_normal((len(distances), 6))
    x *= (distances / np.linalg.norm(x, axis=1))[:, None]
    turn = Rotation.from_rotvec(x[:, 3:] / mechanism.characteristic_length).as_matrix()
    return position + x[:, :3], turn @ rotation


def signs(mechanism, position, rotation):
    return np.sign(np.linalg.det(jacobians(mechanism, position, rotation).jacobian))


@pytest.mark.parametrize("name", NAMES)
def test_is_singular_and_as_far_away_as_is_said(name):
    mechanism, motion = drawn(name)
    found = singularity_distance(mechanism, motion)
    L = found.characteristic_length
    way = found.position - motion.position
    turns = Rotation.from_matrix(found.rotation) * Rotation.from_matrix(motion.rotation).inv()
    expected = np.sqrt(np.sum(way**2, axis=1) + (L * turns.magnitude()) ** 2)
    np.testing.assert_allclose(found.distance, expected, rtol=1e-9)
    legs = jacobians(mechanism, found.position, found.rotation)
    scaled_jacobian = legs.jacobian / np.repeat([1, L], 3)
    assert (np.linalg.svd(scaled_jacobian, compute_uv=False)[:, -1] < 1e-12).all()


@pytest.mark.parametrize("name", NAMES)
def test_no_draw_finds_a_nearer_one(name):
    mechanism, motion = drawn(name)
    found, rng = singularity_distance(mechanism, motion), np.random.default_rng(5)
    for k in range(len(motion)):
        here = signs(mechanism, motion.position[k : k + 1], motion.rotation[k : k + 1])
        radii = found.distance[k] * (1 - 1e-9) * rng.uniform(0, 1, 10000) ** (1 / 6)
        poses = around(mechanism, motion.position[k], motion.rotation[k], radii, rng)
        assert (signs(mechanism, *poses) == here).all()
        # Draws about the pose that was found: of those nearer to the sample none is on the other side.
        size = found.distance[k] * 10 ** rng.uniform(-5, -0.5, 5000)
        p, R = around(mechanism, found.position[k], found.rotation[k], size, rng)
        turn = Rotation.from_matrix(R @ motion.rotation[k].T).magnitude()
        distance = np.hypot(
            np.linalg.norm(p - motion.position[k], axis=1), turn * found.characteristic_length
        )
        # Where the set is as curved as the sphere, the sign near the point that was found is all rounding.
        nearer = distance < found.distance[k] * (1 - 1e-9)
        assert nearer.sum() > 500
        assert (signs(mechanism, p[nearer], R[nearer]) == here).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_search_from_every_pose_finds_no_nearer_one(name):
    """Along a motion most poses start from what others have found."""
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    motion = bundled("sinusoids", mechanism, 25)
    few, all_ = (singularity_distance(mechanism, motion, searched=number) for number in (5, 25))
    assert len(few.searched) <= 6
    np.testing.assert_allclose(few.distance, all_.distance, rtol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_distance_changes_by_no_more_than_the_way(name):
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    motion = bundled("quintic", mechanism, 30)
    found = singularity_distance(mechanism, motion)
    turn = Rotation.from_matrix(motion.rotation[1:] @ motion.rotation[:-1].swapaxes(1, 2)).magnitude()
    way = np.hypot(
        np.linalg.norm(np.diff(motion.position, axis=0), axis=1), found.characteristic_length * turn
    )
    assert (np.abs(np.diff(found.distance)) <= way * (1 + 1e-9) + 1e-9 * found.distance[1:]).all()


class TestRadiusWithoutSingularPoses:
    @pytest.mark.parametrize("name", NAMES)
    def test_holds_none(self, name):
        mechanism, motion = drawn(name, samples=20)
        found, rng = singularity_distance(mechanism, motion, searched=1), np.random.default_rng(2)
        assert (found.none_within < found.distance).all()
        assert (found.none_within > 0.1 * found.distance).all()
        for k in range(len(motion)):
            here = signs(mechanism, motion.position[k : k + 1], motion.rotation[k : k + 1])
            radii = found.none_within[k] * rng.uniform(0.5, 1, 1000)
            poses = around(mechanism, motion.position[k], motion.rotation[k], radii, rng)
            assert (signs(mechanism, *poses) == here).all()

    @pytest.mark.parametrize("condition", [1e3, 1e6, 1e9, 1e11])
    @pytest.mark.parametrize("seed", range(3))
    def test_shrinks_with_the_distance_and_stays_below_it(self, seed, condition):
        mechanism = random_mechanism(seed)
        motion = near_singular(mechanism, condition, seed=seed, samples=1)
        found = singularity_distance(mechanism, motion)
        assert found.distance[0] < 30 * mechanism.characteristic_length / condition
        # Where the distance is some 1e-11 of the coordinates, five digits of it are left.
        assert 0.01 * found.distance[0] < found.none_within[0] < found.distance[0] * (1 + 1e-4)

    @pytest.mark.parametrize("seed", range(3))
    def test_close_by_the_distance_is_that_of_the_tangent_plane(self, seed):
        """|det J| over its slope, by differences of the inverse kinematics."""
        mechanism = random_mechanism(seed)
        motion = near_singular(mechanism, 1e6, seed=seed, samples=1)
        p, R, size = motion.position[0], motion.rotation[0], mechanism.characteristic_length
        step = 1e-4 * size
        slope = np.zeros(6)
        for k in range(6):
            both = []
            for h in (step, -step):
                x = h * np.eye(6)[k]
                turn = Rotation.from_rotvec(x[3:] / size).as_matrix()
                legs = jacobians(mechanism, (p + x[:3])[None], (turn @ R)[None])
                both.append(np.linalg.det(legs.jacobian)[0])
            slope[k] = (both[0] - both[1]) / (2 * step)
        here = np.linalg.det(jacobians(mechanism, p[None], R[None]).jacobian)[0]
        found = singularity_distance(mechanism, motion)
        assert found.distance[0] == pytest.approx(abs(here) / np.linalg.norm(slope), rel=1e-3)


@pytest.mark.parametrize("name", BUNDLED)
def test_a_quarter_turn_leads_to_a_singular_pose(name):
    """Fichter's singularity, of hexapods with threefold symmetry: the nearest one can be no further."""
    mechanism = Mechanism.load(name)
    home = home_position(mechanism)
    quarter = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    assert jacobians(mechanism, home[None], quarter[None]).condition[0] > 1e12
    found = singularity_distance(mechanism, at_rest(home))
    assert found.distance[0] <= np.pi / 2 * mechanism.characteristic_length * (1 + 1e-12)


def test_units_the_world_frame_and_the_way_of_giving_poses_do_not_matter():
    mechanism, motion = drawn(1)
    one = sixsps.singularity_distance(mechanism, motion)
    inches = singularity_distance(
        scaled(mechanism, 39.37, 1.0), replace(motion, position=39.37 * motion.position)
    )
    np.testing.assert_allclose(inches.distance, 39.37 * one.distance, rtol=1e-6)
    np.testing.assert_allclose(inches.none_within, 39.37 * one.none_within, rtol=1e-9)
    Q, far = Rotation.random(rng=3), np.array([1.0, -1.0, 2.0])
    there = replace(mechanism, base_anchors=Q.apply(np.array(mechanism.base_anchors)) + far)
    poses = Q.apply(np.array(motion.position)) + far, Q.as_matrix() @ motion.rotation
    moved = singularity_distance(there, poses)
    np.testing.assert_allclose(moved.distance, one.distance, rtol=1e-6)


def test_a_singular_pose_is_its_own_nearest():
    mechanism = Mechanism.load("wu2012")
    p = [0.01, 0.02, 0.0]
    found = singularity_distance(mechanism, at_rest(p))
    assert found.distance[0] == found.none_within[0] == 0
    assert found.position[0].tolist() == p
    lost = random_mechanism(1)
    arrived = at_rest(lost.base_anchors[2] - lost.platform_anchors[2])
    assert singularity_distance(lost, arrived).distance[0] == 0


def test_geometry_alone_will_do():
    mechanism = Mechanism.load("dietmaier1998")
    found = singularity_distance(mechanism, at_rest([0.0, 0, 1.5]))
    assert 0 < found.none_within[0] < found.distance[0] < 2


def test_no_poses_have_no_distances():
    mechanism, motion = drawn(1)
    found = singularity_distance(mechanism, motion[:0])
    assert len(found.distance) == len(found.searched) == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"length": 0}, "length: "),
        ({"length": np.nan}, "length: "),
        ({"searched": 0}, "searched: 0"),
        ({"searched": "a"}, "searched: a"),
        ({"searched": None}, "searched: None"),
        ({"searched": True}, "searched: True"),
        ({"searched": 1.5}, "searched: 1.5"),
    ],
)
def test_what_cannot_be_is_refused(options, says):
    with pytest.raises(InputError, match=says):
        singularity_distance(*drawn(1), **options)


class TestParts:
    @pytest.mark.parametrize("angle", [0, 1e-12, 1e-5, 1e-4, 1.1e-4, 0.3, 3.0])
    def test_rotations_are_those_of_scipy(self, angle):
        vectors = angle * np.array([[0.6, 0, 0.8], [0, 1, 0], [-1 / 3, 2 / 3, 2 / 3]])
        start = Rotation.random(3, rng=1)
        expected = (Rotation.from_rotvec(vectors) * start).as_matrix()
        np.testing.assert_allclose(turned(vectors, start.as_matrix()), expected, atol=1e-15)
        np.testing.assert_allclose(rotation_vectors(start.as_matrix(), expected), vectors, atol=1e-14)

    @pytest.mark.parametrize("angle", [0, 1e-9, 0.9e-4, 1.1e-4, 0.3, 3.0])
    def test_rates_of_rotation_vectors_become_angular_velocities(self, angle):
        vector, rate = angle * np.array([0.6, 0, 0.8]), np.array([0.3, -1.0, 0.5])
        h = 1e-6
        after, before = Rotation.from_rotvec(vector + h * rate), Rotation.from_rotvec(vector - h * rate)
        expected = (after * before.inv()).as_rotvec() / (2 * h)
        np.testing.assert_allclose(left_jacobians(vector[None])[0] @ rate, expected, atol=1e-9)

    @pytest.mark.parametrize("rank", ["regular", "singular", "doubly singular"])
    def test_slopes_are_those_of_differences(self, rank):
        mechanism = random_mechanism(4) if rank != "doubly singular" else Mechanism.load("wu2012")
        size = mechanism.characteristic_length
        singular_set = SingularSet(mechanism, size)
        if rank == "doubly singular":  # all in one plane: the platform can move out of it in three ways
            p, R = np.array([[0.1, 0.2, 0.0]]), np.eye(3)[None]
        else:
            motion = random_motion(mechanism, 4, samples=1)
            found = singularity_distance(mechanism, motion)
            where = motion if rank == "regular" else found
            p, R = where.position / size, where.rotation
        value, slope = singular_set.gradients(p, R)
        np.testing.assert_allclose(value, singular_set.values(p, R), atol=1e-12 * np.abs(slope).max() + 1e-15)
        for k in range(6):
            h = 1e-5 * np.eye(6)[k][None]
            after, before = (singular_set.values(p + x[:, :3], turned(x[:, 3:], R)) for x in (h, -h))
            expected = (after - before) / 2e-5
            np.testing.assert_allclose(slope[:, k], expected, atol=1e-7 * max(np.abs(slope).max(), 1.0))

    @pytest.mark.parametrize("seed", range(4))
    def test_rows_change_by_first_order_and_a_bounded_rest(self, seed):
        mechanism, motion = drawn(seed, samples=1)
        size, rng = mechanism.characteristic_length, np.random.default_rng(seed)
        singular_set = SingularSet(mechanism, size)
        p, R = motion.position / size, motion.rotation
        x = rng.standard_normal((4000, 6))
        length = 10 ** rng.uniform(-3, 0.49, 4000)  # up to half a turn
        x *= (length / np.linalg.norm(x, axis=1))[:, None]
        x[::2, :3] = 0
        x[:, :3] *= rng.uniform(0, 1, (4000, 1))
        change = singular_set.matrices(p + x[:, :3], turned(x[:, 3:], R)) - singular_set.matrices(p, R)
        rest = change - np.einsum("kij,nk->nij", singular_set.derivatives(p, R)[0], x)
        ratio = np.linalg.norm(rest, axis=2) / np.sum(x**2, axis=1)[:, None] / singular_set.remainders(p)
        assert ratio.max() < 1
        assert (ratio.max(axis=0) > 0.7).all()  # and no bound is much too large


def test_blocks_change_nothing(monkeypatch):
    mechanism, motion = drawn(2, samples=7)
    whole = singularity_distance(mechanism, motion)
    monkeypatch.setattr("sixsps.singular_poses.nearest._BLOCK", 3)
    parts = singularity_distance(mechanism, motion)
    for name in ("distance", "none_within", "position", "rotation"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-9, atol=1e-12)
