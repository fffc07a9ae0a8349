"""Forward kinematics: which pose is found, where none is, and what is said of that."""

import pickle

import numpy as np
import pytest
from cases import random_mechanism, random_motion
from hypothesis import given
from hypothesis import strategies as st
from lengths import apart, determinant, jacobian_of, lengths_of, moved
from numpy.testing import assert_array_equal
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import sixsps
from benchmarks.workspace_poses import workspace_poses
from sixsps.errors import ConvergenceError
from sixsps.home import home_position
from sixsps.kernels import poses
from sixsps.mechanism import Mechanism
from sixsps.rotation import quaternion_rates
from sixsps.trajectories import bundled

WU = Mechanism.load("wu2012")
# His lengths have forty poses, with condition numbers up to 7e4.
DIETMAIER = [1.0, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071]
SINGULAR = 1e-3
"""Share of its first value at which a determinant counts as zero for the integration below."""


def integrated(mechanism, wanted):
    """The end of the way of squared lengths from home, by integration; None where a pose is singular."""
    home = home_position(mechanism)
    size = mechanism.characteristic_length
    first = lengths_of(mechanism, home, np.eye(3))
    change = (np.square(wanted) - first**2) / 2

    def pose(state):
        return state[:3], Rotation.from_quat(state[3:], scalar_first=True).as_matrix()

    def slope(_, state):
        place, turn = pose(state)
        rows = lengths_of(mechanism, place, turn)[:, None] * jacobian_of(mechanism, place, turn)
        twist = np.linalg.solve(rows, change)
        return np.concatenate([twist[:3], quaternion_rates(state[3:], twist[3:] / size)])

    at_home = determinant(mechanism, home, np.eye(3))

    def singular(_, state):
        return determinant(mechanism, *pose(state)) / at_home - SINGULAR

    singular.terminal = True
    begin = [*home, 1.0, 0.0, 0.0, 0.0]
    done = solve_ivp(slope, (0, 1), begin, "DOP853", events=singular, rtol=1e-7, atol=1e-7 * size)
    return pose(done.y[:, -1]) if done.status == 0 else None


@pytest.mark.parametrize("seed", range(24))
def test_pose_is_that_at_the_end_of_the_way(seed):
    mechanism = random_mechanism(seed)
    spread = (0.1, 0.3, 0.6)[seed % 3]
    first = lengths_of(mechanism, home_position(mechanism), np.eye(3))
    wanted = first * np.exp(spread * np.random.default_rng(seed).uniform(-1, 1, 6))
    expected = integrated(mechanism, wanted)
    found = sixsps.forward_kinematics(mechanism, wanted, on_failure="return")
    assert found.ok == (expected is not None)
    if found.ok:
        assert apart(mechanism, found.position, found.rotation, *expected) <= 1e-3  # of the integration


def test_both_ends_occur():
    """The test above has cases of both kinds."""
    status = set()
    for seed in range(24):
        mechanism = random_mechanism(seed)
        first = lengths_of(mechanism, home_position(mechanism), np.eye(3))
        factors = np.exp((0.1, 0.3, 0.6)[seed % 3] * np.random.default_rng(seed).uniform(-1, 1, 6))
        status.add(sixsps.forward_kinematics(mechanism, first * factors, on_failure="return").status)
    assert status == {"ok", "unreachable"}


@pytest.mark.parametrize("name", ["dietmaier1998", "wu2012"])
def test_answer_is_one_of_the_assembly_modes(name):
    """Of two methods that share nothing; from anywhere, on the side of the singular poses that it is from."""
    mechanism, rng = Mechanism.load(name), np.random.default_rng(9)
    lengths = DIETMAIER if name == "dietmaier1998" else [0.7, 0.71, 0.69, 0.7, 0.72, 0.7]
    modes = sixsps.assembly_modes(mechanism, lengths)
    found = set()
    for _ in range(200):
        guess = rng.standard_normal(3), Rotation.random(rng=rng).as_matrix()
        one = sixsps.forward_kinematics(mechanism, lengths, guess, on_failure="return")
        if one.ok:
            (mode,) = np.flatnonzero(
                apart(mechanism, modes.position, modes.rotation, one.position, one.rotation) < 1e-9
            )
            assert determinant(mechanism, *guess) * determinant(mechanism, one.position, one.rotation) > 0
            found.add(mode)
    assert len(found) >= 10


@given(
    seed=st.integers(0, 20),
    lengths=st.lists(st.floats(0, 1e50) | st.floats(0, 10), min_size=6, max_size=6),
    most=st.integers(1, 200),
)
def test_any_lengths_come_to_an_end(seed, lengths, most):
    mechanism = random_mechanism(seed)
    found = sixsps.forward_kinematics(mechanism, lengths, on_failure="return", max_iterations=most)
    assert 0 < found.iterations <= most
    if found.ok:
        actual = lengths_of(mechanism, found.position, found.rotation)
        extent = np.max(lengths) + np.abs(mechanism.base_anchors).max()
        assert np.abs(actual - lengths).max() <= 1e-15 * extent
    else:
        assert np.isnan(found.position).all()
        assert found.residual > 0


def test_legs_that_do_not_fit_between_their_anchors():
    """Each kind of triangle: what its sides cannot do, no platform can."""
    for legs, words in (
        ([0.7, 0.7, 0.7, 1.2, 0.7, 0.7], "differ by more than the 0.27"),
        ([0.1, 0.1, 0.1, 0.1, 0.1, 0.1], "are together shorter than the 0.3"),
    ):
        with pytest.raises(ConvergenceError, match=words) as caught:
            sixsps.forward_kinematics(WU, legs)
        assert caught.value.status == "unreachable"


def test_way_that_is_blocked():
    """Any two legs could have these lengths at once; from home they do not come to them."""
    home = lengths_of(WU, home_position(WU), np.eye(3))
    legs = home + [0.0, 0.2, 0.0, 0.2, 0.0, 0.2]
    assert integrated(WU, legs) is None
    with pytest.raises(ConvergenceError, match=r"comes to a singular pose.*assembly_modes") as caught:
        sixsps.forward_kinematics(WU, legs)
    assert caught.value.status == "unreachable"
    found = sixsps.forward_kinematics(WU, legs, on_failure="return")
    assert 1e-3 < found.residual < 0.2
    assert not found.proven_impossible


def test_what_is_not_found_may_be_there():
    """A pose whose lengths the straight way from home does not reach; and from it, it is found."""
    home, found = home_position(WU), 0
    for seed in range(40):
        drawn = np.random.default_rng(seed)
        position = home + drawn.uniform(-0.2, 0.2, 3)
        rotation = Rotation.from_rotvec(drawn.uniform(-1.5, 1.5, 3)).as_matrix()
        legs = lengths_of(WU, position, rotation)
        lost = sixsps.forward_kinematics(WU, legs, on_failure="return")
        assert not lost.proven_impossible
        if lost.status == "unreachable":
            with pytest.raises(ConvergenceError, match="no pose was found from the guess"):
                sixsps.forward_kinematics(WU, legs)
            found += sixsps.forward_kinematics(WU, legs, (position, rotation), on_failure="return").ok
    assert found > 0


def singular_pose(mechanism, seed):
    """A pose whose determinant changes sign between neighbouring numbers, and a regular one; None without."""
    motion = random_motion(mechanism, seed, samples=2, tilt=1.5)
    turn = Rotation.from_matrix(motion.rotation)
    way = (turn[1] * turn[0].inv()).as_rotvec()

    def at(part):
        place = motion.position[0] + part * (motion.position[1] - motion.position[0])
        return place, (Rotation.from_rotvec(part * way) * turn[0]).as_matrix()

    first = determinant(mechanism, *at(0.0))
    low, high = 0.0, 1.0
    if first * determinant(mechanism, *at(1.0)) > 0:
        return None
    while low < (low + high) / 2 < high:
        middle = (low + high) / 2
        low, high = (middle, high) if determinant(mechanism, *at(middle)) * first > 0 else (low, middle)
    return at(low), at(max(low - 0.02, 0.0)), at(0.0)


SINGULAR_POSES = [
    (mechanism, *found)
    for mechanism, found in (
        (random_mechanism(seed), singular_pose(random_mechanism(seed), seed)) for seed in range(40)
    )
    if found
]


def test_singular_poses_are_told():
    """Where two solutions meet there is none to be had: from the singular pose itself, nor towards it."""
    assert len(SINGULAR_POSES) >= 15
    seen = []
    for mechanism, singular, close, _ in SINGULAR_POSES:
        for wanted in (lengths_of(mechanism, *close), lengths_of(mechanism, *singular)):
            with pytest.raises(ConvergenceError, match="the guess is a singular pose") as caught:
                sixsps.forward_kinematics(mechanism, wanted, singular)
            assert caught.value.status == "singular"
        found = sixsps.forward_kinematics(
            mechanism, lengths_of(mechanism, *singular), close, on_failure="return"
        )
        seen.append(found.status)
        if found.status == "singular":
            assert found.residual <= 1e-8 * mechanism.characteristic_length
    # A few ways meet another singular pose first.
    assert seen.count("singular") >= 0.8 * len(seen)
    assert set(seen) <= {"singular", "unreachable", "limit"}


def test_on_this_side_of_a_singular_pose_the_answer_stays_on_this_side():
    """Near a fold the same lengths have a pose on either side; never that of the other one."""
    for mechanism, singular, close, _ in SINGULAR_POSES:
        first = determinant(mechanism, *close)
        for size in (1e-2, 1e-3, 1e-4):
            step = np.random.default_rng(1).standard_normal(6)
            beyond = moved(mechanism, *singular, size * mechanism.characteristic_length * step)
            wanted = lengths_of(mechanism, *beyond)
            found = sixsps.forward_kinematics(mechanism, wanted, close, on_failure="return")
            if found.ok:
                assert determinant(mechanism, found.position, found.rotation) * first > 0


def test_prediction_across_a_singular_pose_is_not_taken():
    """Three poses in line that head for the twin of the next one: the way to that turns back before it."""
    turned_back = 0
    for mechanism, singular, close, _ in SINGULAR_POSES:
        middle, this = _coordinates(singular, close), _coordinates(close, close)
        wanted = lengths_of(mechanism, *close)
        twin = sixsps.forward_kinematics(mechanism, wanted, _pose(2 * middle - this), on_failure="return")
        if (
            not twin.ok
            or determinant(mechanism, twin.position, twin.rotation) * determinant(mechanism, *close) > 0
        ):
            continue
        other = _coordinates((twin.position, twin.rotation), close)
        second = (middle + this) / 2
        first = 2 * second - other
        three = np.array(
            [lengths_of(mechanism, *_pose(first)), lengths_of(mechanism, *_pose(second)), wanted]
        )
        found = sixsps.forward_kinematics(mechanism, three, _pose(2 * first - second), on_failure="return")
        if found.ok.all():
            turned_back += 1
            assert apart(mechanism, found.position[2], found.rotation[2], *close) < 1e-6
    assert turned_back >= 5


def _coordinates(pose, beside):
    """Position and quaternion, of the sign that is nearer to another pose's."""
    quaternion, other = (Rotation.from_matrix(one[1]).as_quat(scalar_first=True) for one in (pose, beside))
    return np.concatenate([pose[0], quaternion * np.sign(quaternion @ other)])


def _pose(coordinates):
    return coordinates[:3], Rotation.from_quat(coordinates[3:], scalar_first=True).as_matrix()


def test_iterations_run_out():
    legs = lengths_of(WU, [0.1, 0.1, 0.6], Rotation.from_rotvec([0.2, 0.3, 0.1]).as_matrix())
    full = sixsps.forward_kinematics(WU, legs)
    assert full.iterations > 5
    with pytest.raises(ConvergenceError, match="5 iterations lead no nearer than") as caught:
        sixsps.forward_kinematics(WU, legs, max_iterations=5)
    assert caught.value.status == "limit"
    for most in range(1, full.iterations + 3):
        found = sixsps.forward_kinematics(WU, legs, max_iterations=most, on_failure="return")
        assert found.ok == (most >= full.iterations)
        if found.ok:
            assert_array_equal(found.position, full.position)


class TestArrays:
    MOTION = bundled("sinusoids", WU, 10_000)
    LENGTHS = lengths_of(WU, MOTION.position, MOTION.rotation)

    def test_no_bit_depends_on_the_threads(self):
        one, *others = (sixsps.forward_kinematics(WU, self.LENGTHS, threads=n) for n in (1, 2, 5))
        assert apart(WU, one.position, one.rotation, self.MOTION.position, self.MOTION.rotation).max() < 1e-13
        for other in others:
            for name in ("position", "quaternion", "iterations", "residual", "status"):
                assert_array_equal(getattr(other, name), getattr(one, name))

    def test_compiled_mechanism_says_the_same(self):
        plain = sixsps.forward_kinematics(WU, self.LENGTHS)
        model = pickle.loads(pickle.dumps(sixsps.compile(WU)))
        assert_array_equal(model.forward_kinematics(self.LENGTHS).position, plain.position)
        one = model.forward_kinematics(self.LENGTHS[7], (plain.position[6], plain.quaternion[6]))
        assert apart(WU, one.position, one.rotation, plain.position[7], plain.rotation[7]) < 1e-14

    def test_single_calls_leave_home_where_it_is(self):
        model = sixsps.compile(WU)
        first = model.forward_kinematics(self.LENGTHS[0])
        model.forward_kinematics(self.LENGTHS[5000])
        assert_array_equal(model.forward_kinematics(self.LENGTHS[0]).position, first.position)
        assert model.forward_kinematics(self.LENGTHS[0]).iterations == first.iterations

    def test_failed_samples_do_not_stop_those_after_them(self, monkeypatch):
        """Whole chunks without a pose among them."""
        monkeypatch.setattr(poses, "_CHUNK", 50)
        lengths = self.LENGTHS[:1000].copy()
        missing = np.zeros(1000, bool)
        for start, stop in ((0, 3), (40, 60), (149, 251), (300, 301), (480, 700), (990, 1000)):
            missing[start:stop] = True
        lengths[missing, 0] += 2
        found = sixsps.forward_kinematics(WU, lengths, on_failure="return")
        assert_array_equal(found.status, np.where(missing, "unreachable", "ok"))
        there = ~missing
        expected = self.MOTION.position[:1000][there], self.MOTION.rotation[:1000][there]
        assert apart(WU, found.position[there], found.rotation[there], *expected).max() < 1e-13

    def test_chunks_go_on_where_those_before_end(self, monkeypatch):
        """From pose to pose by way of home, where no chunk's first pose is to be had from that before it."""
        monkeypatch.setattr(poses, "_CHUNK", 100)
        ends, turns, _ = workspace_poses(WU, 300, np.random.default_rng(8), tilt=2.0)
        ends, turns = ends[20:110], turns[20:110]
        home, vectors = home_position(WU), Rotation.from_matrix(turns).as_rotvec()
        down, up = np.split(np.abs(np.linspace(-1, 1, 100, endpoint=False))[:, None], 2)

        def way(start, end):
            return [*(down * start), *(up * end)]

        pairs = range(len(ends) - 1)
        places = home + np.concatenate([way(ends[k] - home, ends[k + 1] - home) for k in pairs])
        rotation = Rotation.from_rotvec(
            np.concatenate([way(vectors[k], vectors[k + 1]) for k in pairs])
        ).as_matrix()
        lengths = lengths_of(WU, places, rotation)
        first = places[0], rotation[0]
        heads = sixsps.forward_kinematics(WU, lengths[::100], first, on_failure="return")
        assert not heads.ok.all()
        assert (apart(WU, heads.position, heads.rotation, places[::100], rotation[::100]) > 0.1).any()
        found = sixsps.forward_kinematics(WU, lengths, first)
        assert apart(WU, found.position, found.rotation, places, rotation).max() < 1e-11
