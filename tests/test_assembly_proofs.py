"""What is said to be proven holds, as other equations in ball arithmetic show; nothing false is proven."""

import numpy as np
import pytest
from hexapods import Hexapod, dietmaier
from scipy.spatial.transform import Rotation

flint = pytest.importorskip("flint")

from pose_enclosures import BITS, enclosure  # noqa: E402

from sixsps.assembly import exact  # noqa: E402
from sixsps.assembly.certificate import NOT_REAL, REAL, UNPROVEN, all_distinct, certified  # noqa: E402
from sixsps.assembly.frame import Frame  # noqa: E402
from sixsps.assembly.solve import Problem, findings, modes_of  # noqa: E402


@pytest.fixture
def precise():
    before, flint.ctx.prec = flint.ctx.prec, BITS
    yield
    flint.ctx.prec = before


def assert_within_stated_radii(base, platform, given, modes):
    for mode in modes:
        balls = enclosure(base, platform, given, mode.position, mode.quaternion)
        assert balls is not None
        moved = [abs(ball - flint.arb(x)) for ball, x in zip(balls[:3], mode.position.tolist(), strict=True)]
        away = sum((x * x for x in moved), flint.arb(0)).sqrt()
        assert away < flint.arb(mode.position_radius)
        stated = [flint.arb(x) for x in mode.quaternion.tolist()]
        length = sum((x * x for x in stated), flint.arb(0)).sqrt()
        apart = [ball - x / length for ball, x in zip(balls[3:], stated, strict=True)]
        angle = 4 * (sum((x * x for x in apart), flint.arb(0)).sqrt() / 2).asin()
        assert angle < flint.arb(mode.rotation_radius)


@pytest.mark.usefixtures("precise")
class TestPosesAreWhereTheyAreSaidToBe:
    def test_of_dietmaier(self):
        data = dietmaier()
        modes = modes_of(*data)
        assert_within_stated_radii(*data, modes)

    @pytest.mark.parametrize("flat", ["", "base", "both"])
    @pytest.mark.parametrize("seed", range(3))
    def test_of_random_platforms(self, flat, seed):
        hexapod = Hexapod(np.random.default_rng(seed + 40), flat=flat)
        assert_within_stated_radii(hexapod.base, hexapod.platform, hexapod.lengths, hexapod.modes())

    def test_far_from_the_origin_and_in_millimetres(self):
        hexapod = Hexapod(np.random.default_rng(6))
        base, platform = 1e3 * hexapod.base + 7e4, 1e3 * hexapod.platform - 3e3
        given = 1e3 * hexapod.lengths
        modes = modes_of(base, platform, given)
        assert len(modes) > 0
        assert_within_stated_radii(base, platform, given, modes)


def solutions(hexapod):
    problem = Problem.of(hexapod.base, hexapod.platform, hexapod.lengths)
    return problem, findings(problem)


@pytest.mark.parametrize("seed", range(3))
def test_ball_arithmetic_agrees_about_every_complex_solution(seed):
    problem, found = solutions(Hexapod(np.random.default_rng(seed)))
    assert len(found.x) == 40
    for x, radius, kind in zip(found.x, found.radius, found.kinds, strict=True):
        rough = x + 1e-7 * np.random.default_rng(0).standard_normal(8)
        proof = exact.prove(problem.base, problem.platform, problem.lengths, problem.frame, rough)
        assert proof is not None
        assert proof.finite
        assert kind == (REAL if proof.real else NOT_REAL)
        # in the gauge of the one ball, what the other holds lies in it
        gauge = x.conj() / np.linalg.norm(x) ** 2
        there = proof.x / (gauge @ proof.x)
        assert np.abs(there - x).max() <= radius + 2 * proof.radius + 1e-15


def test_radii_of_a_pose_hold_what_a_ball_of_coordinates_holds():
    rng = np.random.default_rng(3)
    hexapod = Hexapod(rng)
    _, found = solutions(hexapod)
    frame = Frame.of(hexapod.base + 3, hexapod.platform - 5, hexapod.lengths)
    radius = 1e-4
    for x in found.x[found.kinds == REAL].real:
        position, _, rotation = frame.poses(x[None])
        reach, angle = (bound[0] for bound in frame.radii(x[None], np.array([radius])))
        moved = frame.poses(x + radius * rng.choice([-1, 1], (500, 8)))
        apart = np.linalg.norm(moved[0] - position, axis=1)
        turned = Rotation.from_matrix(moved[2] @ rotation[0].T).magnitude()
        assert 0.05 * reach < apart.max() < reach
        assert 0.2 * angle < turned.max() < angle


def test_what_is_not_real_comes_in_pairs():
    _, found = solutions(Hexapod(np.random.default_rng(1)))
    unreal = found.x[found.kinds == NOT_REAL]
    overlap = np.abs(unreal @ unreal.T)  # of one with the conjugate of another
    assert np.all(np.sum(overlap > 1 - 1e-12, axis=1) == 1)
    assert not np.any(np.diag(overlap) > 1 - 1e-12)


class TestNothingFalseIsProven:
    def test_of_one_solution_twice(self):
        _, found = solutions(Hexapod(np.random.default_rng(2)))
        twice = np.concatenate([found.x, found.x[:1] * 1j])
        radius = np.append(found.radius, found.radius[0])
        doubles = np.zeros(41, np.bool_)
        assert not all_distinct(twice, radius, doubles)
        assert np.flatnonzero(doubles).tolist() == [40]

    def test_of_two_balls_that_may_touch(self):
        _, found = solutions(Hexapod(np.random.default_rng(2)))
        doubles = np.zeros(40, np.bool_)
        assert all_distinct(found.x, found.radius, doubles)
        assert not all_distinct(found.x, np.full(40, 1.0), doubles)

    def test_of_a_double_solution(self):
        # planar platforms in one plane, Pythagorean lengths: the pose is its own mirror image
        legs = np.array([[3, 4], [5, 12], [8, 15], [20, -21], [-3, 4], [12, -5]], float)
        platform = np.array([[1, 5, 0], [-4, 2, 0], [0, -3, 0], [6, 1, 0], [-2, -6, 0], [3, -1, 0]], float)
        base = platform - np.column_stack([legs, np.zeros(6)])
        problem = Problem.of(base, platform, np.linalg.norm(legs, axis=1))
        centre = problem.frame.platform_centre - problem.frame.base_centre
        x = np.array([[1, 0, 0, 0, 0, *(centre / problem.frame.scale)]], np.complex128)
        assert certified(problem.frame, problem.frame.legs, x.copy())[0][0] == UNPROVEN
        assert exact.prove(base, platform, problem.lengths, problem.frame, x[0]) is None

    def test_of_what_is_no_solution(self):
        hexapod = Hexapod(np.random.default_rng(2))
        problem = Problem.of(hexapod.base, hexapod.platform, hexapod.lengths)
        x = np.full((3, 8), np.nan, np.complex128)
        x[1] = 0
        x[2, 4] = 1  # at infinity: e = 0
        assert np.all(certified(problem.frame, problem.frame.legs, x)[0] == UNPROVEN)
