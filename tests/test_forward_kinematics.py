"""Forward kinematics: the pose is that of the lengths, to rounding, whatever they come from."""

import numpy as np
import pytest
from cases import BUNDLED, random_mechanism, random_motion, scaled
from hypothesis import assume, given
from hypothesis import strategies as st
from lengths import UNIT_ROUNDOFF, apart, determinant, jacobian_of, lengths_of, moved
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation

import sixsps
from benchmarks.workspace_poses import workspace_poses
from sixsps.errors import ConvergenceError, InputError, MotionError
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from sixsps.pose import Pose
from sixsps.trajectories import bundled

WU = Mechanism.load("wu2012")
BARE = Mechanism.load("dietmaier1998")
SEEDS = st.integers(0, 10_000)


def rounding(mechanism, position, lengths):
    """What some operations on coordinates cost, relative to the characteristic length."""
    extent = np.abs(position).max() + np.abs(mechanism.base_anchors).max() + np.max(lengths)
    return 8 * UNIT_ROUNDOFF * extent / mechanism.characteristic_length


def near(mechanism, position, rotation, seed, distance):
    step = np.random.default_rng(seed).standard_normal(6)
    step *= distance * mechanism.characteristic_length / np.linalg.norm(step)
    return moved(mechanism, position, rotation, step)


@given(seed=SEEDS, distance=st.sampled_from([0.0, 1e-9, 1e-4, 1e-2]))
def test_pose_of_its_own_lengths(seed, distance):
    """fk(ik) is the identity from anywhere nearer than half the way to what curvature allows, 1 / cond."""
    mechanism = random_mechanism(seed % 50)
    motion = random_motion(mechanism, seed, samples=1)
    position, rotation = motion.position[0], motion.rotation[0]
    condition = np.linalg.cond(jacobian_of(mechanism, position, rotation))
    assume(condition * distance < 0.1)
    wanted = lengths_of(mechanism, position, rotation)
    found = sixsps.forward_kinematics(mechanism, wanted, near(mechanism, position, rotation, seed, distance))
    assert found.status == "ok"
    noise = rounding(mechanism, position, wanted)
    assert apart(mechanism, found.position, found.rotation, position, rotation) <= condition * noise
    assert found.residual <= noise * mechanism.characteristic_length


@given(seed=SEEDS, spread=st.sampled_from([0.01, 0.1, 0.5, 3.0]))
def test_lengths_of_the_pose_are_those_wanted(seed, spread):
    """ik(fk) is the identity for whatever is called ok, and no determinant has changed its sign."""
    mechanism = random_mechanism(seed % 50)
    rng = np.random.default_rng(seed)
    home = home_position(mechanism)
    wanted = lengths_of(mechanism, home, np.eye(3)) * np.exp(spread * rng.uniform(-1, 1, 6))
    found = sixsps.forward_kinematics(mechanism, wanted, on_failure="return")
    assert found.ok == (found.status == "ok") == bool(np.isfinite(found.position).all())
    if not found.ok:
        assert found.residual > 0
        return
    actual = lengths_of(mechanism, found.position, found.rotation)
    noise = rounding(mechanism, found.position, wanted) * mechanism.characteristic_length
    assert np.abs(actual - wanted).max() <= noise
    assert abs(np.abs(actual - wanted).max() - found.residual) <= noise
    assert abs(np.linalg.norm(found.quaternion) - 1) <= 4 * UNIT_ROUNDOFF
    signs = determinant(mechanism, home, np.eye(3)), determinant(mechanism, found.position, found.rotation)
    assert signs[0] * signs[1] > 0


@pytest.mark.parametrize("name", BUNDLED)
def test_poses_of_the_workspace_from_home_and_from_each_other(name):
    """A sample of what `python -m benchmarks` shows for 10^5."""
    mechanism = Mechanism.load(name)
    position, rotation, _ = workspace_poses(mechanism, 1000, np.random.default_rng(5))
    lengths = lengths_of(mechanism, position, rotation)
    home = (np.tile(home_position(mechanism), (1000, 1)), np.tile([1.0, 0, 0, 0], (1000, 1)))
    for guess in (home, None):
        found = sixsps.forward_kinematics(mechanism, lengths, guess)
        assert (found.status == "ok").all()
        assert apart(mechanism, found.position, found.rotation, position, rotation).max() <= 1e-12


def test_trajectory_is_followed(mechanism):
    motion = bundled("sinusoids", mechanism, 500)
    found = sixsps.forward_kinematics(mechanism, lengths_of(mechanism, motion.position, motion.rotation))
    distance = apart(mechanism, found.position, found.rotation, motion.position, motion.rotation)
    assert distance.max() <= 1e-13  # condition numbers below 50
    assert (np.sum(found.quaternion[1:] * found.quaternion[:-1], axis=1) > 0).all()  # no jump of sign
    assert np.median(found.iterations) <= 2


@given(seed=SEEDS)
def test_frames_and_units_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    mechanism = random_mechanism(seed % 50)
    motion = random_motion(mechanism, seed, samples=1, tilt=0.3)
    lengths = lengths_of(mechanism, motion.position[0], motion.rotation[0])
    home = home_position(mechanism)
    plain = sixsps.forward_kinematics(mechanism, lengths, (home, np.eye(3)), on_failure="return")
    assume(plain.ok)
    turn, shift = Rotation.random(rng=rng).as_matrix(), 3 * rng.standard_normal(3)
    turned = Mechanism.geometry("turned", mechanism.base_anchors @ turn.T + shift, mechanism.platform_anchors)
    found = sixsps.forward_kinematics(turned, lengths, (turn @ home + shift, turn))
    condition = np.linalg.cond(jacobian_of(mechanism, plain.position, plain.rotation))
    noise = rounding(turned, found.position, lengths) + rounding(mechanism, plain.position, lengths)
    expected = turn @ plain.position + shift, turn @ plain.rotation
    assert apart(turned, found.position, found.rotation, *expected) <= condition * noise
    large = scaled(mechanism, 1024.0, 1.0)  # a power of two: not one bit is another
    found = sixsps.forward_kinematics(large, 1024 * lengths, (1024 * home, np.eye(3)))
    assert_array_equal(found.position, 1024 * plain.position)


def test_world_frame_far_away_costs_its_own_digits_only():
    far = np.array([1e6, -2e6, 3e6])
    moved_away = Mechanism.geometry("far", WU.base_anchors + far, WU.platform_anchors)
    motion = bundled("sinusoids", WU, 20)
    lengths = lengths_of(WU, motion.position, motion.rotation)
    found = sixsps.forward_kinematics(moved_away, lengths, (motion.position[0] + far, motion.quaternion[0]))
    error = apart(WU, found.position - far, found.rotation, motion.position, motion.rotation)
    assert error.max() <= 50 * 4e6 * UNIT_ROUNDOFF / WU.characteristic_length  # cond x rounding of anchors


class TestGuess:
    LENGTHS = lengths_of(WU, [0.05, 0.02, 0.6], Rotation.from_rotvec([0.1, 0.2, -0.1]).as_matrix())
    PLACE, TURN = np.array([0.0, 0.0, 0.65]), Rotation.from_rotvec([0.0, 0.1, 0.0])

    def test_takes_whatever_is_a_pose(self):
        quaternion = self.TURN.as_quat(scalar_first=True)
        pose = Pose.of((self.PLACE, quaternion))
        motion = sixsps.forward_kinematics(WU, [self.LENGTHS, self.LENGTHS]).motion
        expected = sixsps.forward_kinematics(WU, self.LENGTHS, pose)
        still = motion([0, 1], np.zeros((2, 6)), np.zeros((2, 6)))[:1]
        for guess in (
            pose,
            (self.PLACE, 3 * quaternion),
            [self.PLACE, self.TURN.as_matrix()],
            expected,
            still,
        ):
            found = sixsps.forward_kinematics(WU, self.LENGTHS, guess)
            assert apart(WU, found.position, found.rotation, expected.position, expected.rotation) <= 1e-14

    def test_of_each_sample(self):
        motion = bundled("sinusoids", WU, 9)
        lengths = lengths_of(WU, motion.position, motion.rotation)
        backwards = motion.position[::-1], motion.quaternion[::-1]
        for guess, samples in ((motion, slice(None)), (backwards, slice(None, None, -1))):
            found = sixsps.forward_kinematics(WU, lengths[samples], guess)
            expected = motion.position[samples], motion.rotation[samples]
            assert apart(WU, found.position, found.rotation, *expected).max() < 1e-14
            assert found.iterations.max() == 1

    def test_keeps_its_sign_of_the_quaternion(self):
        for sign in (1, -1):
            guess = (self.PLACE, sign * self.TURN.as_quat(scalar_first=True))
            found = sixsps.forward_kinematics(WU, self.LENGTHS, guess)
            assert sign * found.quaternion[0] > 0

    @pytest.mark.parametrize(
        "guess",
        [
            (np.zeros(3), np.zeros(4)), (np.zeros(2), np.eye(3)), "home", (np.zeros(3), 2 * np.eye(3)),
            (np.full(3, np.nan), np.eye(3)), (np.zeros((3, 3)), np.ones((3, 4))),
            (np.zeros((2, 3)), np.zeros((2, 4))), (np.zeros((2, 3)), np.ones((2, 3))),
        ],
    )  # fmt: skip
    def test_that_is_none_is_refused(self, guess):
        with pytest.raises((InputError, MotionError)):
            sixsps.forward_kinematics(WU, [self.LENGTHS, self.LENGTHS], guess)

    @pytest.mark.parametrize(
        "bad", [(3 * [np.nan], [1, 0, 0, 0]), (3 * [0.0], 4 * [0.0]), (3 * [1e60], 4 * [1])]
    )
    def test_is_not_taken_unseen(self, bad):
        """A pose of the caller's own making goes to the kernel as it is."""
        with pytest.raises(MotionError):
            sixsps.forward_kinematics(WU, self.LENGTHS, Pose(*map(np.array, bad)))

    def test_that_was_not_found_is_none(self):
        lost = sixsps.forward_kinematics(WU, np.full(6, 0.01), on_failure="return")
        for lengths in (self.LENGTHS, list(self.LENGTHS), [self.LENGTHS]):
            with pytest.raises(MotionError):
                sixsps.forward_kinematics(WU, lengths, lost)

    def test_is_needed_without_home(self):
        with pytest.raises(InputError, match="guess: missing"):
            sixsps.forward_kinematics(BARE, np.ones(6))


@pytest.mark.parametrize(
    "lengths",
    [
        np.ones(5), np.ones((2, 5)), 1.0, [[np.ones(6)]], "long", [[1.0], [1.0, 2.0]], np.ones(6, complex),
        [1, 1, 1, 1, 1, np.nan], [1, 1, 1, np.inf, 1, 1], [1, -1e-9, 1, 1, 1, 1],
        [[1] * 6, [1, 1, 1, 1, 1, -1]],
    ],
)  # fmt: skip
def test_lengths_that_are_none_are_refused(lengths):
    for given_lengths in (lengths, np.array(lengths, object) if isinstance(lengths, str) else lengths):
        with pytest.raises(InputError, match="lengths"):
            sixsps.forward_kinematics(WU, given_lengths)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 1e60])
def test_array_of_one_sample_is_not_taken_unseen(value):
    """Float64 arrays (6,) go to the kernel as they are."""
    lengths = np.full(6, 0.7)
    lengths[3] = value
    with pytest.raises(InputError, match=r"lengths\[3\]"):
        sixsps.forward_kinematics(WU, lengths)


@pytest.mark.parametrize(
    "options",
    [
        {"on_failure": "ignore"}, {"max_iterations": 0}, {"max_iterations": 1.5}, {"max_iterations": True},
        {"max_iterations": 2**63}, {"max_iterations": "3"}, {"threads": 0},
    ],
)  # fmt: skip
def test_options_that_are_none_are_refused(options):
    with pytest.raises(InputError, match=next(iter(options))):
        sixsps.forward_kinematics(WU, np.full(6, 0.7), **options)


def test_iterations_may_be_counted_by_numpy():
    lengths = np.full(6, 0.7)
    found = sixsps.forward_kinematics(WU, lengths, max_iterations=np.int64(50))
    assert_array_equal(found.position, sixsps.forward_kinematics(WU, lengths).position)


def test_name_of_a_mechanism_is_none():
    with pytest.raises(InputError, match=r"mechanism: wu2012; allowed: a Mechanism, as Mechanism\.load"):
        sixsps.forward_kinematics("wu2012", np.full(6, 0.7))


def test_masked_lengths_are_not_taken_for_known():
    lengths = np.ma.masked_array(np.full(6, 0.7), [1, 0, 0, 0, 0, 0])
    with pytest.raises(InputError, match="lengths: entries that are masked"):
        sixsps.forward_kinematics(WU, lengths)
    none = np.ma.masked_array(np.full(6, 0.7))
    assert sixsps.forward_kinematics(WU, none).ok


def test_no_samples():
    found = sixsps.forward_kinematics(WU, np.empty((0, 6)))
    assert found.position.shape == (0, 3)
    assert found.status.shape == found.ok.shape == (0,)
    assert found.rotation.shape == (0, 3, 3)


def test_rotation_is_that_of_the_quaternion():
    found = sixsps.forward_kinematics(WU, [[0.7, 0.72, 0.68, 0.7, 0.71, 0.69]] * 2)
    expected = Rotation.from_quat(found.quaternion, scalar_first=True).as_matrix()
    assert np.abs(found.rotation - expected).max() <= 4 * UNIT_ROUNDOFF
    assert_array_equal(sixsps.forward_kinematics(WU, found.lengths[0]).rotation, found.rotation[0])


def test_failures_raise_unless_they_are_asked_for():
    good, bad = [0.7] * 6, [0.7, 0.7, 0.7, 0.1, 0.7, 0.7]
    with pytest.raises(
        ConvergenceError, match="sample 1: no pose has such lengths: legs 3 and 4 of"
    ) as caught:
        sixsps.forward_kinematics(WU, [good, bad, good, bad])
    assert caught.value.status == "unreachable"
    assert "none found for 2 of 4 samples" in str(caught.value)
    found = sixsps.forward_kinematics(WU, [good, bad, good, bad], on_failure="return")
    assert list(found.status) == ["ok", "unreachable", "ok", "unreachable"]
    assert list(found.proven_impossible) == [False, True, False, True]
    assert_array_equal(np.isnan(found.position).all(axis=1), ~found.ok)
    assert_array_equal(np.isnan(found.quaternion).all(axis=1), ~found.ok)
    assert apart(WU, found.position[2], found.rotation[2], found.position[0], found.rotation[0]) < 1e-14
