"""All assembly modes: none is missed, each has the lengths that were asked for, and none depends on names."""

import numpy as np
import pytest
from cases import BUNDLED
from hexapods import DIETMAIER, Hexapod, dietmaier, distance, lengths, newton_poses, published, same_poses
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.assembly.solve import modes_of
from sixsps.assembly.start_systems import start_systems
from sixsps.home import home_position
from sixsps.mechanism import Mechanism

# Poses are right to their condition number, some 1e4 at the worst of these, times unit roundoff; so is the
# one that the lengths were made from.
NEAR = 1e-9
# Of lengths of order one: some ten roundings.
ROUNDING = 1e-14


class TestDietmaier:
    def test_has_forty_real_poses_and_that_is_a_theorem(self):
        modes = modes_of(*dietmaier())
        assert len(modes) == modes.certified == 40
        assert modes.proof == "proven"
        assert modes.complete
        assert modes.unresolved == modes.at_infinity == 0

    def test_is_bundled(self):
        base, platform, given = dietmaier()
        mechanism = Mechanism.load("dietmaier1998")
        assert np.array_equal(mechanism.base_anchors, base)
        assert np.array_equal(mechanism.platform_anchors, platform)
        modes = sixsps.assembly_modes(mechanism, given)
        assert np.array_equal(modes.position, modes_of(base, platform, given).position)

    def test_residuals_are_rounding(self):
        base, platform, given = dietmaier()
        modes = modes_of(base, platform, given)
        legs = modes.position[:, None] + np.einsum("nij,kj->nki", modes.rotation, platform) - base
        residual = np.abs(np.linalg.norm(legs, axis=-1) - given).max(axis=1)
        assert residual.max() < ROUNDING
        assert np.abs(residual - modes.residual).max() < ROUNDING

    def test_every_pose_is_known_to_rounding(self):
        modes = modes_of(*dietmaier())
        assert modes.position_radius.max() < 1e-12
        assert modes.rotation_radius.max() < 1e-12

    @pytest.mark.skipif(not DIETMAIER.exists(), reason="the data lie beside the checkout, and are not here")
    def test_is_the_published_mechanism(self):
        for ours, theirs in zip(dietmaier(), published(), strict=True):
            assert np.array_equal(ours, theirs)


class TestNoneIsMissed:
    @pytest.mark.parametrize("flat", ["", "base", "both"])
    @pytest.mark.parametrize("seed", range(12))
    def test_of_general_and_planar_platforms(self, flat, seed):
        hexapod = Hexapod(np.random.default_rng(seed), flat=flat)
        modes = hexapod.modes()
        assert distance(modes, hexapod.position, hexapod.rotation) < NEAR
        assert modes.proof == "proven"
        # what is not real comes in conjugate pairs
        assert len(modes) % 2 == 0
        assert modes.residual.max() < ROUNDING

    @pytest.mark.parametrize(
        "pattern", start_systems(), ids=lambda one: f"{one.name}:{one.base}{one.platform}"
    )
    def test_of_shared_anchors(self, pattern):
        rng = np.random.default_rng(5)
        for _ in range(3):
            order = rng.permutation(6)
            sides = [np.array(side)[order] for side in (pattern.base, pattern.platform)]
            hexapod = Hexapod(rng, *sides[:: rng.choice([1, -1])])
            modes = hexapod.modes()
            assert distance(modes, hexapod.position, hexapod.rotation) < NEAR
            assert modes.certified == modes.expected == len(start_systems()[pattern].solutions)
            assert modes.proof == ("proven" if modes.expected == 40 else "counted")
            assert modes.pattern == pattern.name

    @pytest.mark.parametrize("name", BUNDLED)
    def test_of_bundled_mechanisms(self, name):
        mechanism = Mechanism.load(name)
        rng = np.random.default_rng(3)
        home = home_position(mechanism)
        for _ in range(6):
            position = home + mechanism.characteristic_length * rng.uniform(-0.5, 0.5, 3)
            rotation = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)).as_matrix()
            given = lengths(mechanism.base_anchors, mechanism.platform_anchors, position, rotation)
            modes = sixsps.assembly_modes(mechanism, given)
            assert distance(modes, position, rotation) < NEAR
            assert modes.complete
            assert not modes.singular

    @pytest.mark.parametrize("name", [*BUNDLED, "random"])
    def test_that_newtons_method_finds(self, name):
        rng = np.random.default_rng(8)
        if name == "random":
            hexapod = Hexapod(rng)
            base, platform, given = hexapod.base, hexapod.platform, hexapod.lengths
        else:
            mechanism = Mechanism.load(name)
            base, platform = mechanism.base_anchors, mechanism.platform_anchors
            turn = Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()
            given = lengths(base, platform, home_position(mechanism) * 1.02, turn)
        modes = modes_of(base, platform, given)
        position, rotation = newton_poses(base, platform, given, 1500, rng)
        assert len(position) > 100
        hit = set()
        for p, R in zip(position, rotation, strict=True):
            assert distance(modes, p, R) < 1e-6
            apart = np.linalg.norm(modes.position - p, axis=1) + np.abs(modes.rotation - R).max(axis=(1, 2))
            hit.add(int(np.argmin(apart)))
        assert len(hit) == len(modes)


class TestInvariance:
    @pytest.fixture
    def hexapod(self):
        return Hexapod(np.random.default_rng(11), flat="base")

    @pytest.mark.parametrize("seed", range(3))
    def test_of_the_frames(self, hexapod, seed):
        rng = np.random.default_rng(seed)
        Q, S = Rotation.random(2, rng=rng).as_matrix()
        s, t = rng.uniform(-3, 3, (2, 3))
        modes = hexapod.modes()
        moved = modes_of(hexapod.base @ Q.T + s, hexapod.platform @ S.T + t, hexapod.lengths)
        # x -> Q x + s in the base, y -> S y + t in the platform
        rotation = Q @ modes.rotation @ S.T
        position = modes.position @ Q.T + s - rotation @ t
        assert same_poses((position, rotation), (moved.position, moved.rotation)) < NEAR

    def test_of_the_order_of_legs(self, hexapod):
        order = np.random.default_rng(1).permutation(6)
        modes = hexapod.modes()
        other = modes_of(hexapod.base[order], hexapod.platform[order], hexapod.lengths[order])
        assert same_poses((modes.position, modes.rotation), (other.position, other.rotation)) < NEAR

    def test_of_the_exchange_of_base_and_platform(self, hexapod):
        modes = hexapod.modes()
        other = modes_of(hexapod.platform, hexapod.base, hexapod.lengths)
        turned = other.rotation.transpose(0, 2, 1)
        position = -np.einsum("nij,nj->ni", turned, other.position)
        assert same_poses((modes.position, modes.rotation), (position, turned)) < NEAR

    @pytest.mark.parametrize("unit", [1e-3, 25.4, 1e6])
    def test_of_the_unit_of_length(self, hexapod, unit):
        modes = hexapod.modes()
        other = modes_of(unit * hexapod.base, unit * hexapod.platform, unit * hexapod.lengths)
        assert same_poses((modes.position, modes.rotation), (other.position / unit, other.rotation)) < NEAR

    def test_of_repetition(self, hexapod):
        first, second = hexapod.modes(), hexapod.modes()
        for name in ("position", "quaternion", "position_radius", "rotation_radius"):
            assert np.array_equal(getattr(first, name), getattr(second, name))

    def test_under_the_mirror_of_planar_platforms(self):
        hexapod = Hexapod(np.random.default_rng(4), flat="both")
        modes = hexapod.modes()
        mirror = np.diag([1.0, 1.0, -1.0])
        mirrored = modes.position @ mirror, mirror @ modes.rotation @ mirror
        assert same_poses(mirrored, (modes.position, modes.rotation)) < NEAR


class TestWhatItReturns:
    @pytest.fixture
    def modes(self, wu2012):
        return sixsps.assembly_modes(wu2012, np.full(6, 0.675))

    def test_is_a_sequence_of_poses(self, modes):
        assert len(modes) > 0
        assert len(list(modes)) == len(modes[:]) == len(modes)
        for k, mode in enumerate(modes):
            assert np.array_equal(mode.position, modes.position[k])
            assert np.allclose(mode.rotation, modes.rotation[k], rtol=0, atol=ROUNDING)
            assert np.allclose(sixsps.Pose.of(mode).quaternion, modes.quaternion[k], rtol=0, atol=ROUNDING)
        assert np.array_equal(modes[-1].position, modes.position[-1])
        with pytest.raises(IndexError):
            modes[len(modes)]

    def test_holds_rotations(self, modes):
        product = modes.rotation @ modes.rotation.transpose(0, 2, 1)
        assert np.abs(product - np.eye(3)).max() < ROUNDING
        assert np.all(np.linalg.det(modes.rotation) > 0)
        assert np.all(modes.quaternion[:, 0] >= 0)

    def test_cannot_be_changed(self, modes):
        with pytest.raises(ValueError, match="read-only"):
            modes.position[0] = 0

    def test_holds_the_home_pose(self, modes, wu2012):
        assert distance(modes, home_position(wu2012), np.eye(3)) < NEAR

    @pytest.mark.parametrize("far", [20.0, 0.0])
    def test_is_empty_where_no_pose_has_the_lengths(self, far):
        hexapod = Hexapod(np.random.default_rng(2))
        modes = modes_of(hexapod.base, hexapod.platform, np.array([1, 1, 1, 1, 1, far]))
        assert len(modes) == 0
        assert list(modes) == []
        assert modes.position.shape == (0, 3)
        assert modes.rotation.shape == (0, 3, 3)
        assert modes.proof == "proven"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (np.ones(5), "lengths: 'shape (5,)'|lengths: shape"),
        (np.ones((1, 6)), "allowed: shape"),
        ([1, 1, 1, 1, 1, np.nan], "lengths"),
        ([1, 1, 1, 1, 1, np.inf], "lengths"),
        ([1, 1, -0.5, 1, 1, 1], r"lengths\[2\]: -0.5; allowed: at least 0 m"),
        ("long", "lengths"),
        (None, "lengths"),
        (np.ones(6) * 1j, "lengths"),
    ],
)
def test_refuses_what_are_no_lengths(wu2012, given, said):
    with pytest.raises(sixsps.InputError, match=said) as caught:
        sixsps.assembly_modes(wu2012, given)
    assert "\n" not in str(caught.value)
