"""Margins to all limits, against loops that share no formula with them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion, scaled, still
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.errors import MechanismError, MotionError
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.limits import Limits
from sixsps.margins import LIMITS, angles, limit_margins, pose_margins, separate_pairs
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import bundled

UNIT = np.finfo(float).eps


def limited(seed, **others):
    """A random mechanism with limits of every kind, each leg its own, that random motions violate in part."""
    mechanism, rng = random_mechanism(seed), np.random.default_rng(seed)
    size, load = mechanism.characteristic_length, 10 * mechanism.platform.mass
    limits = {
        "force": np.sort(load * rng.uniform(-3, 3, (6, 2)), axis=1),
        "rate": size * rng.uniform(0.2, 2, 6),
        "base_cone": rng.uniform(0.1, 0.6, 6),
        "platform_cone": rng.uniform(0.1, 0.9, 6),
        "clearance": 0.3 * size,
    }
    return replace(mechanism, limits=Limits(**limits | others))


def segments_apart(a, b, c, d, steps=60):
    """The distance of two segments by sampling them ever more finely about the nearest samples."""
    s, t, width = 0.5, 0.5, 0.5
    for _ in range(60):
        first = np.clip(s + np.linspace(-width, width, 9), 0, 1)
        second = np.clip(t + np.linspace(-width, width, 9), 0, 1)
        apart = np.linalg.norm(
            (a + first[:, None] * (b - a))[:, None] - (c + second[:, None] * (d - c)), axis=2
        )
        i, j = np.unravel_index(apart.argmin(), apart.shape)
        s, t, width = first[i], second[j], 0.7 * width
    return apart.min()


def by_hand(mechanism, motion, forces):
    """Every margin by a loop over samples and legs."""
    limits, home = mechanism.limits, home_position(mechanism)
    A, b = mechanism.base_anchors, mechanism.platform_anchors
    found = {key: [] for key in LIMITS}
    for k in range(len(motion)):
        turn = Rotation.from_quat(motion.quaternion[k], scalar_first=True)
        B = motion.position[k] + turn.apply(np.array(b))
        row = {key: [] for key in LIMITS}
        for leg in range(6):
            length = math.dist(A[leg], B[leg])
            shortest, longest = mechanism.length_limits[leg]
            row["min_length"].append(length - shortest)
            row["max_length"].append(longest - length)
            row["min_force"].append(forces[k, leg] - limits.force[leg, 0])
            row["max_force"].append(limits.force[leg, 1] - forces[k, leg])
            speed = motion.velocity[k] + np.cross(motion.angular_velocity[k], turn.apply(np.array(b[leg])))
            s = (B[leg] - A[leg]) / length
            row["max_rate"].append(limits.rate[leg] - abs(speed @ s))
            start = home + b[leg] - A[leg]
            start /= np.linalg.norm(start)
            for joint, axis in (("base", start), ("platform", turn.apply(start))):
                cone = getattr(limits, f"{joint}_cone")[leg]
                row[f"{joint}_cone"].append(cone - math.acos(min(1.0, axis @ s)))
        for i in range(6):
            for j in range(i + 1, 6):
                row["clearance"].append(segments_apart(A[i], B[i], A[j], B[j]) - limits.clearance)
        for key, margins in row.items():
            found[key].append(margins)
    return {key: np.array(rows) for key, rows in found.items()}


@pytest.mark.parametrize("seed", range(4))
def test_every_limit_is_what_a_loop_finds(seed):
    mechanism = limited(seed)
    motion = random_motion(mechanism, seed, samples=4, tilt=0.3)
    forces = sixsps.inverse_dynamics(mechanism, motion)
    found, expected = limit_margins(mechanism, motion), by_hand(mechanism, motion, forces)
    assert list(found.limits) == list(LIMITS)
    assert not found.unchecked
    size = mechanism.characteristic_length
    for key, margin in found.limits.items():
        scale = {"N": np.abs(forces).max(), "rad": 1.0}.get(margin.unit, 10 * size)
        # The sampling of segments ends at 0.7^60 of their lengths; an arc cosine loses half the digits.
        limit = {"clearance": 1e-8, "base_cone": 1e-7, "platform_cone": 1e-7}.get(key, 100 * UNIT)
        np.testing.assert_allclose(margin.margins, expected[key], rtol=0, atol=limit * scale, err_msg=key)
        assert np.array_equal(margin.violated, margin.margins < 0), key
    some = np.concatenate([margin.violated.ravel() for margin in found.limits.values()])
    assert 0.05 < some.mean() < 0.95
    outside = [any(m.violated[k].any() for m in found.limits.values()) for k in range(len(motion))]
    assert found.inside.tolist() == [not one for one in outside]


def test_rates_are_those_of_the_lengths():
    mechanism = limited(7)
    motion = bundled("sinusoids", mechanism, 4001)
    margin = limit_margins(mechanism, motion, np.zeros((4001, 6))).limits["max_rate"]
    lengths = inverse_kinematics(mechanism, motion).lengths
    differences = np.abs(np.gradient(lengths, motion.time, axis=0, edge_order=2))
    np.testing.assert_allclose(margin.values, differences, atol=1e-5 * differences.max())


def test_cones_are_full_at_home_and_axes_may_be_given():
    mechanism = limited(2)
    home = at_rest(home_position(mechanism))
    found = pose_margins(mechanism, home.position, home.rotation)
    for joint in ("base", "platform"):
        cone = getattr(mechanism.limits, f"{joint}_cone")
        np.testing.assert_allclose(found.limits[f"{joint}_cone"].margins[0], cone, atol=1e-15)
    axes = np.array([[0, 0, 2.5]] * 6)
    mechanism = limited(2, base_axes=axes, platform_axes=3 * axes)
    motion = random_motion(mechanism, 2)
    found = pose_margins(mechanism, motion.position, motion.rotation)
    s = inverse_kinematics(mechanism, motion).directions
    np.testing.assert_allclose(np.cos(found.limits["base_cone"].values), s[..., 2], atol=1e-14)
    up = np.einsum("nij,j->ni", motion.rotation, [0, 0, 1])
    cosine = np.einsum("nki,ni->nk", s, up)
    np.testing.assert_allclose(np.cos(found.limits["platform_cone"].values), cosine, atol=1e-14)


@pytest.mark.parametrize("angle", [0, 1e-100, 1e-20, 1e-9, 0.5, np.pi / 2, 3, np.pi - 1e-9, np.pi])
def test_angles_keep_their_digits(angle):
    a = np.array([2.0, 0, 0])
    b = 3 * np.array([np.cos(angle), np.sin(angle), 0])
    assert angles(a, b) == pytest.approx(angle, rel=4 * UNIT, abs=1e-16 if angle > 3 else 0)
    assert np.isnan(angles(np.zeros(3), b))
    assert np.isnan(angles(a, np.zeros(3)))


class TestLimitsThatAreNotThere:
    def test_are_named_with_the_reason(self, wu2012):
        found = limit_margins(wu2012, bundled("line", wu2012, 5))
        assert list(found.limits) == ["min_length", "max_length"]
        assert set(found.unchecked) == set(LIMITS) - set(found.limits)
        assert set(found.unchecked.values()) == {"no limit is given"}

    def test_need_more_than_poses(self):
        mechanism = limited(1)
        motion = random_motion(mechanism, 1)
        found = pose_margins(mechanism, motion.position, motion.rotation)
        assert set(found.unchecked) == {"min_force", "max_force", "max_rate"}
        assert set(found.unchecked.values()) == {"poses alone do not decide it"}
        whole = limit_margins(mechanism, motion)
        for key, margin in found.limits.items():
            assert np.array_equal(margin.values, whole.limits[key].values)

    def test_need_inertia(self):
        full = limited(1)
        bare = Mechanism.geometry(
            "bare", full.base_anchors, full.platform_anchors, full.length_limits, full.limits
        )
        motion = random_motion(full, 1)
        found = limit_margins(bare, motion)
        assert "needs the inertia" in found.unchecked["min_force"]
        assert "needs the inertia" in found.unchecked["max_force"]
        assert set(found.limits) == set(LIMITS) - {"min_force", "max_force"}
        forces = sixsps.inverse_dynamics(full, motion)
        given = limit_margins(bare, motion, forces)
        assert np.array_equal(given.limits["min_force"].values, forces)
        assert not given.unchecked

    def test_of_some_legs_alone_leave_the_others_free(self):
        full = limited(3)
        lengths = np.array([[0, 1e-3], [0, np.inf], [1e6, 2e6], [0, 1e6], [0, 1e6], [0, 1e6]])
        legs = tuple(
            sixsps.Leg(length_limits=tuple(pair)) for pair in np.where(np.isinf(lengths), 1e40, lengths)
        )
        bare = Mechanism(
            name="bare", base_anchors=full.base_anchors, platform_anchors=full.platform_anchors, legs=legs
        )
        motion = random_motion(full, 1)
        found = limit_margins(bare, motion)
        assert found.limits["min_length"].violated.any(axis=0).tolist() == [leg == 2 for leg in range(6)]
        assert np.isposinf(found.limits["min_length"].margins[:, [0, 1, 3, 4, 5]]).all()
        assert found.limits["max_length"].violated.any(axis=0).tolist() == [leg == 0 for leg in range(6)]

    def test_of_a_bare_mechanism_are_none(self):
        mechanism = Mechanism.load("dietmaier1998")
        found = limit_margins(mechanism, still())
        assert not found.limits
        assert found.inside.all()


def test_no_value_is_a_violation():
    """Forces in a singular pose, and directions of a leg without length."""
    mechanism = limited(1)
    motion = random_motion(mechanism, 1)
    forces = sixsps.inverse_dynamics(mechanism, motion)
    forces[2] = np.nan
    found = limit_margins(mechanism, motion, forces)
    assert found.limits["min_force"].violated[2].all()
    assert found.limits["max_force"].violated[2].all()
    assert not found.inside[2]
    arrived = at_rest(mechanism.base_anchors[4] - mechanism.platform_anchors[4])
    found = pose_margins(mechanism, arrived.position, arrived.rotation)
    for key in ("base_cone", "platform_cone", "min_length"):
        assert found.limits[key].violated[0, 4], key
    assert np.isfinite(found.limits["clearance"].values).all()


def test_at_a_limit_is_inside_and_beyond_it_is_not():
    mechanism = limited(5)
    motion = random_motion(mechanism, 5, samples=1)
    lengths = inverse_kinematics(mechanism, motion).lengths[0]
    for change, inside in ((0, True), (1e-14, True), (1e-10, False)):
        pairs = np.column_stack([lengths * (1 + change), 2 * lengths])
        bare = Mechanism.geometry("x", mechanism.base_anchors, mechanism.platform_anchors, pairs)
        assert limit_margins(bare, motion).inside[0] == inside
        pairs = np.column_stack([lengths / 2, lengths * (1 - change)])
        bare = Mechanism.geometry("x", mechanism.base_anchors, mechanism.platform_anchors, pairs)
        assert limit_margins(bare, motion).inside[0] == inside


def test_legs_that_share_a_joint_are_no_pair():
    triangle = np.array([[1, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0]])
    base, platform = np.repeat(triangle, 2, axis=0), -0.5 * triangle[[2, 1, 2, 0, 0, 1]]
    limits = Limits(clearance=0.01)
    mechanism = Mechanism.geometry("3-3", base, platform, [0.1, 3], limits)
    pairs = separate_pairs(mechanism)
    assert len(pairs) == 15 - 3 - 3
    margin = pose_margins(mechanism, [[0, 0, 1.0]], np.eye(3)[None]).limits["clearance"]
    assert margin.legs == tuple(f"{i + 1}-{j + 1}" for i, j in pairs)
    assert (margin.values > 0.1).all()


@pytest.mark.parametrize("seed", range(3))
def test_nothing_depends_on_how_the_world_is_turned(seed):
    axes = np.random.default_rng(seed).standard_normal((6, 3))
    mechanism = limited(seed, base_axes=axes)
    motion = random_motion(mechanism, seed)
    Q, far = Rotation.random(rng=seed), np.array([3.0, -2.0, 5.0]) * mechanism.characteristic_length
    there = replace(
        mechanism,
        base_anchors=Q.apply(np.array(mechanism.base_anchors)) + far,
        gravity=Q.apply(np.array(mechanism.gravity)),
        limits=replace(mechanism.limits, base_axes=Q.apply(axes), platform_axes=-axes),
    )
    here = replace(mechanism, limits=replace(mechanism.limits, platform_axes=-axes))
    turn = (Q * Rotation.from_quat(motion.quaternion, scalar_first=True)).as_quat(scalar_first=True)
    names = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
    moved = Motion(
        time=motion.time,
        position=Q.apply(np.array(motion.position)) + far,
        quaternion=turn,
        **{name: Q.apply(np.array(getattr(motion, name))) for name in names},
    )
    one, other = limit_margins(here, motion), limit_margins(there, moved)
    for key, margin in one.limits.items():
        scale = np.abs(margin.values).max()
        np.testing.assert_allclose(other.limits[key].values, margin.values, atol=1e-10 * scale, err_msg=key)


def test_units_of_length_and_mass_do_not_matter():
    mechanism = limited(4)
    motion = random_motion(mechanism, 4)
    length, mass = 1e3, 1e-3
    limits = mechanism.limits
    there = replace(
        scaled(mechanism, length, mass),
        gravity=length * mechanism.gravity,
        limits=replace(
            limits,
            force=mass * length * limits.force,
            rate=length * limits.rate,
            clearance=length * limits.clearance,
        ),
    )
    names = {"velocity": length, "acceleration": length, "force": mass * length, "moment": mass * length**2}
    moved = replace(
        motion,
        position=length * motion.position,
        **{name: k * getattr(motion, name) for name, k in names.items()},
    )
    one, other = limit_margins(mechanism, motion), limit_margins(there, moved)
    factors = {"m": length, "m/s": length, "N": mass * length, "rad": 1.0}
    for key, margin in one.limits.items():
        expected = factors[margin.unit] * margin.margins
        np.testing.assert_allclose(other.limits[key].margins, expected, atol=1e-9 * np.abs(expected).max())
        assert np.array_equal(other.limits[key].violated, margin.violated)


def test_no_samples_have_no_violations():
    mechanism = limited(1)
    motion = random_motion(mechanism, 1)[:0]
    found = limit_margins(mechanism, motion)
    assert found.inside.shape == (0,)
    assert found.limits["clearance"].margins.shape == (0, 15)


def test_what_cannot_be_is_refused(wu2012):
    motion = bundled("line", wu2012, 5)
    with pytest.raises(MotionError, match=r"forces: shape \(5,\); allowed: shape \(5, 6\)"):
        limit_margins(replace(wu2012, limits=Limits(force=[-1, 1])), motion, np.zeros(5))
    bare = Mechanism.geometry(
        "bare", wu2012.base_anchors, wu2012.platform_anchors, limits=Limits(base_cone=0.5)
    )
    with pytest.raises(MechanismError, match=r"limits.base_axes: missing; allowed: axes of the cones, or"):
        limit_margins(bare, motion)


class TestPosesAndForcesThatAreNone:
    @pytest.mark.parametrize(
        ("position", "rotation", "says"),
        [
            (np.zeros((1, 3)), 2 * np.eye(3)[None], "rotation, index 0: .*orthogonal"),
            (np.zeros((1, 3)), -np.eye(3)[None], "rotation, index 0: .*determinant"),
            (np.full((1, 3), np.nan), np.eye(3)[None], r"position\[0, 0\]: nan"),
            (np.zeros((1, 3)), np.full((1, 3, 3), np.inf), r"rotation\[0, 0, 0\]: inf"),
            (np.zeros((3, 3)), np.eye(3)[None], "rotation: shape"),
            (np.zeros(3), np.eye(3), "position: shape"),
            ("a", "b", "position: a"),
            (np.zeros((1, 3)), "b", "rotation: b"),
            (np.zeros((1, 3)), np.zeros((1, 4)), "quaternion, index 0: .*above 0"),
        ],
    )
    def test_poses(self, position, rotation, says):
        with pytest.raises(MotionError, match=says) as caught:
            pose_margins(limited(1), position, rotation)
        assert "\n" not in str(caught.value)

    def test_quaternions_serve_as_well(self):
        mechanism = limited(1)
        motion = random_motion(mechanism, 2, samples=5)
        one = pose_margins(mechanism, motion.position, motion.rotation)
        other = pose_margins(mechanism, motion.position, 1e200**0.2 * motion.quaternion)
        for key, margin in one.limits.items():
            np.testing.assert_allclose(other.limits[key].values, margin.values, atol=1e-14)

    @pytest.mark.parametrize(
        "forces",
        ["x", [["a"] * 6] * 5, np.zeros((5, 6), complex), np.full((5, 6), np.inf), [[1.0], [1.0, 2.0]],
         np.ma.masked_array(np.zeros((5, 6)), np.eye(5, 6)), np.zeros((4, 6))],
    )  # fmt: skip
    def test_forces(self, forces):
        mechanism = limited(1)
        motion = random_motion(mechanism, 2, samples=5)
        with pytest.raises(MotionError, match="forces") as caught:
            limit_margins(mechanism, motion, forces)
        assert "\n" not in str(caught.value)

    def test_forces_may_be_unknown_or_whole_numbers(self):
        mechanism = limited(1)
        motion = random_motion(mechanism, 2, samples=5)
        forces = np.zeros((5, 6))
        forces[2] = np.nan
        found = limit_margins(mechanism, motion, forces).limits["max_force"]
        assert np.isnan(found.values).all(axis=1).tolist() == [False, False, True, False, False]
        whole = limit_margins(mechanism, motion, np.ones((5, 6), int)).limits["max_force"]
        assert (whole.values == 1.0).all()
