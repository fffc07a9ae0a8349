"""Lengths whose poses are singular, isolated or not: told as what they are, and nothing dropped."""

import numpy as np
import pytest
from hexapods import Hexapod, distance, lengths
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from sixsps.assembly.solve import modes_of

# Ends of singular paths are known to about the root of unit roundoff.
NEAR = 1e-7


def residual(mode, base, platform, given):
    return np.abs(lengths(base, platform, mode.position, mode.rotation) - given).max()


def accounted(modes):
    """Solutions that something is known of."""
    singular = sum(mode.multiplicity for mode in (*modes.singular, *modes.non_isolated))
    return (
        modes.certified + modes.at_infinity + singular + modes.complex_singular + modes.complex_non_isolated
    )


class TestIsolated:
    def test_pose_in_its_own_mirror_is_told_with_its_multiplicity(self):
        # integer anchors and Pythagorean legs: the lengths are exact, and so is the singularity
        legs = np.array([[3, 4], [5, 12], [8, 15], [20, -21], [-3, 4], [12, -5]], float)
        platform = np.array([[1, 5, 0], [-4, 2, 0], [0, -3, 0], [6, 1, 0], [-2, -6, 0], [3, -1, 0]], float)
        base = platform - np.column_stack([legs, np.zeros(6)])
        given = np.linalg.norm(legs, axis=1)
        modes = modes_of(base, platform, given)
        flat = [mode for mode in modes.singular if np.abs(mode.position).max() < 1e-4]
        assert len(flat) == 1
        # three motions out of the plane, in each of which the lengths are quadratic
        assert flat[0].multiplicity == 8
        assert flat[0].dimension == 0
        assert residual(flat[0], base, platform, given) == pytest.approx(flat[0].residual, abs=1e-12)
        assert flat[0].residual < 1e-10
        assert accounted(modes) == modes.expected == 40
        assert modes.proof == "followed"
        assert distance(modes, flat[0].position, flat[0].rotation) > 1e-3

    @pytest.mark.parametrize("seed", range(4))
    def test_two_poses_that_rounding_sets_apart_are_both_proven(self, seed):
        """Lengths of a singular pose, rounded: two poses some 1e-8 apart, or none but a conjugate pair."""
        hexapod = Hexapod(np.random.default_rng(seed + 10))
        along = np.random.default_rng(seed).uniform(-1, 1, 3)

        def determinant(t):
            arms = hexapod.platform @ hexapod.rotation.T
            legs = hexapod.position + t * along + arms - hexapod.base
            return np.linalg.det(np.hstack([legs, np.cross(arms, legs)]))

        places = np.linspace(-4, 4, 401)
        signs = np.sign([determinant(t) for t in places])
        k = np.flatnonzero(signs[:-1] * signs[1:] < 0)[0]
        t = brentq(determinant, places[k], places[k + 1], xtol=1e-15)
        position = hexapod.position + t * along
        given = lengths(hexapod.base, hexapod.platform, position, hexapod.rotation)
        modes = modes_of(hexapod.base, hexapod.platform, given)
        assert modes.proof == "proven"
        apart = np.linalg.norm(modes.position - position, axis=1)
        assert np.sum(apart < 1e-5) in (0, 2)
        # longer and shorter legs: two poses on one side, none on the other
        arms = hexapod.platform @ hexapod.rotation.T
        legs = position + arms - hexapod.base
        _, _, rows = np.linalg.svd((np.hstack([legs, np.cross(arms, legs)]) / given[:, None]).T)
        counts = []
        for shift in (1e-7, -1e-7):
            moved = modes_of(hexapod.base, hexapod.platform, given + shift * rows[-1])
            assert moved.proof == "proven"
            counts.append(int(np.sum(np.linalg.norm(moved.position - position, axis=1) < 1e-2)))
        assert sorted(counts) == [0, 2]


class TestNotIsolated:
    def test_congruent_platforms_with_equal_legs_translate(self):
        rng = np.random.default_rng(3)
        base = rng.integers(-5, 6, (6, 3)).astype(float)
        given = np.full(6, 4.0)
        modes = modes_of(base, base, given)
        assert modes.non_isolated
        assert {mode.dimension for mode in modes.non_isolated} == {2}
        for mode in modes.non_isolated:
            assert residual(mode, base, base, given) < 1e-10
        # on the sphere of translations
        far = [np.linalg.norm(mode.position) for mode in modes.non_isolated]
        assert np.min(np.abs(np.array(far) - 4)) < NEAR
        assert accounted(modes) == modes.expected
        assert not modes.unresolved

    @pytest.mark.parametrize("height", ["level", "tilted"])
    def test_similar_hexagons_move_with_every_lengths(self, height):
        angles = np.array([0, 0.5, 2, 2.6, 4.2, 4.9])
        base = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
        platform = 0.5 * base
        turn = np.eye(3) if height == "level" else Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
        given = lengths(base, platform, np.array([0.1, 0.2, 1.5]) * (height == "tilted") + [0, 0, 1], turn)
        modes = modes_of(base, platform, given)
        assert modes.non_isolated
        assert len(modes) == 0
        for mode in modes.non_isolated:
            assert mode.dimension >= 1
            assert residual(mode, base, platform, given) < 1e-10

    def test_griffis_and_duffys_platform_moves(self):
        """Corners of a triangle joined to the middles of another's sides, and the other way about."""
        angles = 2 * np.pi * np.arange(3) / 3 + np.pi / 2
        corners = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
        middles = (np.roll(corners, 1, axis=0) + np.roll(corners, 2, axis=0)) / 2
        base, platform = np.vstack([corners, middles]), np.vstack([middles, corners])
        given = np.full(6, 1.7)
        modes = modes_of(base, platform, given)
        assert modes.non_isolated
        assert {mode.dimension for mode in modes.non_isolated} == {1}
        for mode in modes.non_isolated:
            assert residual(mode, base, platform, given) < 1e-10


def test_what_is_lost_on_the_way_is_told(monkeypatch):
    """Paths that are cut short are no poses fewer without a word."""
    from sixsps.assembly import solve
    from sixsps.assembly.paths import Settings

    hexapod = Hexapod(np.random.default_rng(0))
    hexapod.modes()  # its start is there
    short = Settings(most_steps=4)
    monkeypatch.setattr(solve, "Settings", lambda: short)
    assert hexapod.modes().proof == "proven"  # followed again with care
    monkeypatch.setattr(solve, "CAREFUL", short)
    monkeypatch.setattr(solve, "ends", lambda start, end, solutions: [None] * len(solutions))
    modes = hexapod.modes()
    assert modes.unresolved == 40 - modes.certified > 0
    assert modes.proof == "open"
    assert not modes.complete
