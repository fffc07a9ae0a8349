"""Solutions that lie close together, poses that rounding hides, and anchors that are nearly special."""

import numpy as np
import pytest
from hexapods import Hexapod, dietmaier, distance, lengths
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from sixsps.assembly.continua import System
from sixsps.assembly.modes import AssemblyModes
from sixsps.assembly.partners import candidates
from sixsps.assembly.solve import Problem, findings, modes_of
from sixsps.home import home_position
from sixsps.mechanism import Mechanism

# Along this direction from Dietmaier's lengths two real poses meet at about 7.7e-6, and are complex beyond.
ALONG = np.array([1, -0.3, 0.2, 0.5, -0.7, 0.1])
MEET = 7.699798941588712e-06
# Lengths of some metres are computed with some sixteen roundings.
ROUNDING = 16 * 2.0**-53 * 10


class TestPairs:
    @pytest.mark.parametrize("beyond", [-1e-9, -1e-12, 0.0, 1e-14, 1e-12, 3e-11, 1e-10, 1e-9, 1e-7])
    def test_next_to_a_double_solution_are_both_found(self, beyond):
        base, platform, given = dietmaier()
        modes = modes_of(base, platform, given + (MEET + beyond) * ALONG)
        assert modes.certified == 40
        assert modes.proof == "proven"
        assert len(modes) in (38, 40)

    def test_both_members_are_where_the_model_says(self):
        """From either, and from their middle, the other is a step along the null direction."""
        base, platform, given = dietmaier()
        problem = Problem.of(base, platform, given + (MEET + 1e-9) * ALONG)
        x = findings(problem).x
        x = x / np.linalg.norm(x, axis=1)[:, None]
        near = np.abs(x.conj() @ x.T) - 2 * np.eye(40)
        one, other = np.unravel_index(np.argmax(near), near.shape)
        system = System.of(problem.frame.legs)
        middle = x[one] + x[other] * (x[other].conj() @ x[one])
        apart = np.sqrt(1 - near[one, other] ** 2)
        for start in (x[one], x[other], middle / np.linalg.norm(middle)):
            for _, point in zip(range(2), candidates(system, start), strict=False):
                sines = [
                    np.sqrt(max(1 - abs(y.conj() @ point / np.linalg.norm(point)) ** 2, 0))
                    for y in (x[one], x[other])
                ]
                # the model is of second order; 1e-7 is what float64 sees of a cosine next to one
                assert min(sines) < 0.1 * apart + 1e-7


def tsai_at_a_singular_pose():
    mechanism = Mechanism.load("tsai2000")
    base, platform = mechanism.base_anchors, mechanism.platform_anchors
    rng = np.random.default_rng(1)
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    position = home_position(mechanism) + 0.1 * mechanism.characteristic_length * rng.standard_normal(3)

    def determinant(angle):
        arms = platform @ Rotation.from_rotvec(angle * axis).as_matrix().T
        legs = position + arms - base
        return np.linalg.det(np.hstack([legs, np.cross(arms, legs)]))

    angles = np.linspace(0, 3.1, 200)
    k = np.flatnonzero(np.diff(np.sign([determinant(angle) for angle in angles])))[0]
    angle = brentq(determinant, angles[k], angles[k + 1], xtol=1e-16, rtol=1e-15)
    return base, platform, position, Rotation.from_rotvec(angle * axis).as_matrix()


class TestPosesHiddenByRounding:
    def test_singular_pose_of_tsai2000_is_told(self):
        base, platform, position, rotation = tsai_at_a_singular_pose()
        given = lengths(base, platform, position, rotation)
        modes = modes_of(base, platform, given)
        here = [mode for mode in modes.singular if np.abs(mode.position - position).max() < 1e-6]
        assert len(here) == 1
        assert np.abs(here[0].rotation - rotation).max() < 1e-6
        assert here[0].multiplicity == here[0].split == 2
        assert here[0].residual < ROUNDING
        assert distance(modes, position, rotation) > 1e-3

    def test_is_not_told_where_lengths_differ_by_more_than_rounding(self):
        base, platform, position, rotation = tsai_at_a_singular_pose()
        given = lengths(base, platform, position, rotation)
        arms = platform @ rotation.T
        legs = position + arms - base
        wrenches = (np.hstack([legs, np.cross(arms, legs)]) / given[:, None]).T
        counts = []
        for shift in (1e-11, -1e-11):
            modes = modes_of(base, platform, given + shift * np.linalg.svd(wrenches)[2][-1])
            assert not modes.singular
            counts.append(int(np.sum(np.linalg.norm(modes.position - position, axis=1) < 1e-2)))
        assert sorted(counts) == [0, 2]

    @pytest.mark.parametrize("flat", [False, True])
    @pytest.mark.parametrize("seed", range(3))
    def test_half_turn_of_congruent_platforms_is_among_the_poses(self, seed, flat):
        """The legs then meet one line: singular whatever the anchors."""
        rng = np.random.default_rng(seed)
        base = rng.standard_normal((6, 3)) * [1, 1, not flat]
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        rotation = 2 * np.outer(axis, axis) - np.eye(3)
        foot = rng.standard_normal(3)
        position = 2 * (foot - foot @ axis * axis)
        modes = modes_of(base, base, lengths(base, base, position, rotation))
        told = [*modes, *modes.singular]
        far = [np.abs(one.position - position).max() + np.abs(one.rotation - rotation).max() for one in told]
        # a fourfold solution: the fourth root of unit roundoff
        assert min(far) < 1e-3
        for mode in modes.singular:
            assert mode.residual < ROUNDING

    @pytest.mark.parametrize("count", [1, 2, 3])
    @pytest.mark.parametrize("seed", range(2))
    def test_zero_length_legs_make_one_pose(self, seed, count):
        """A leg without length is a double solution, two are a fourfold one and three an eightfold one."""
        hexapod = Hexapod(np.random.default_rng(seed))
        hexapod.platform[:count] = (hexapod.base[:count] - hexapod.position) @ hexapod.rotation
        given = hexapod.lengths
        given[:count] = 0
        modes = modes_of(hexapod.base, hexapod.platform, given)
        here = [mode for mode in modes.singular if np.abs(mode.position - hexapod.position).max() < 1e-4]
        assert [mode.multiplicity for mode in here] == [2**count]
        assert modes.certified + here[0].multiplicity - here[0].split == modes.expected == 40


def nearly_paired(gap, seed):
    """A 6-3 whose platform joints are twins that lie a gap apart, and its lengths at some pose."""
    hexapod = Hexapod(np.random.default_rng(seed), platform=(0, 0, 1, 1, 2, 2))
    hexapod.platform += gap * np.random.default_rng(seed + 100).standard_normal((6, 3))
    return hexapod


class TestNearlySpecialAnchors:
    @pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-7])
    @pytest.mark.parametrize("seed", range(2))
    def test_no_more_is_expected_than_there_can_be(self, gap, seed):
        hexapod = nearly_paired(gap, seed)
        modes = hexapod.modes()
        assert modes.certified <= modes.expected == 40
        assert modes.proof == ("proven" if modes.certified == 40 else "open")
        assert distance(modes, hexapod.position, hexapod.rotation) < 1e-6

    @pytest.mark.parametrize("gap", [1e-4, 1e-6, 1e-8])
    def test_nothing_is_called_counted_that_was_followed_to_infinity(self, gap):
        rng = np.random.default_rng(7)
        hexapod = Hexapod(rng)
        hexapod.platform = 0.7 * hexapod.base + gap * rng.standard_normal((6, 3))
        modes = hexapod.modes()
        assert modes.certified <= modes.expected <= 40
        assert modes.proof != "counted"
        assert modes.certified + modes.always_at_infinity + modes.unresolved >= 40
        assert distance(modes, hexapod.position, hexapod.rotation) < 1e-6

    def test_what_special_anchors_send_to_infinity_is_told(self):
        mechanism = Mechanism.load("wu2012")
        given = lengths(
            mechanism.base_anchors, mechanism.platform_anchors, home_position(mechanism), np.eye(3)
        )
        modes = modes_of(mechanism.base_anchors, mechanism.platform_anchors, given)
        assert isinstance(modes, AssemblyModes)
        assert modes.certified + modes.always_at_infinity == 40
        assert modes.proof == "followed"
        assert modes.complete
