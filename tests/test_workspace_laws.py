"""Workspaces of known volume, their symmetries, other units and other frames."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import scaled
from scipy.spatial.transform import Rotation

from sixsps.errors import InputError
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from sixsps.workspace import constant_orientation_workspace, orientation_workspace
from sixsps.workspace.constraints import Constraints
from sixsps.workspace.ranges import ways

SEARCHES = {"translation": constant_orientation_workspace, "orientation": orientation_workspace}


def geometry(feet, limits, turned=0.4):
    """Legs that have no length where O1 is at the feet, of platforms that are not turned."""
    rng = np.random.default_rng(4)
    platform = rng.uniform(-0.3, 0.3, (6, 3))
    return Mechanism.geometry("known", np.asarray(feet) + platform, platform, limits)


class TestKnownVolumes:
    """One or two legs decide, the others are long enough for everything."""

    rest = np.array([[0.0, 50.0]] * 5)

    @pytest.mark.parametrize("shortest", [0.0, 0.5])
    def test_ball_and_shell(self, shortest):
        mechanism = geometry(np.zeros((6, 3)), np.array([[shortest, 1.0], *self.rest]))
        workspace = constant_orientation_workspace(
            mechanism, position=[0.0, 0.1, 0.7], tolerance=5e-3, singularity=False
        )
        exact = 4 / 3 * math.pi * (1 - shortest**3)
        assert workspace.converged
        assert workspace.volume[0] <= exact <= workspace.volume[1]
        room = min(1 - math.hypot(0.1, 0.7), math.hypot(0.1, 0.7) - shortest)
        assert workspace.inscribed[0] <= room <= workspace.inscribed[1] * (1 + 1e-12)
        assert workspace.inscribed[1] - workspace.inscribed[0] <= 5e-3 * room * (1 + 1e-9)
        assert (workspace.extent[:, 0] <= -1 + 1e-12).all()
        assert (workspace.extent[:, 1] >= 1 - 1e-12).all()

    def test_lens(self):
        apart = 0.8
        feet = [[0.0, 0, 0], [apart, 0, 0], *np.zeros((4, 3))]
        mechanism = geometry(feet, np.array([[0.0, 1.0], [0.0, 1.0], *self.rest[:4]]))
        workspace = constant_orientation_workspace(
            mechanism, position=[0.4, 0.0, 0.0], tolerance=5e-3, singularity=False
        )
        exact = math.pi * (4 + apart) * (2 - apart) ** 2 / 12
        assert workspace.volume[0] <= exact <= workspace.volume[1]
        assert workspace.volume[1] - workspace.volume[0] <= 5e-3 * exact
        assert workspace.ranges[0].high == pytest.approx(0.6, abs=1e-13)
        assert workspace.ranges[1].high == pytest.approx(math.sqrt(1 - 0.4**2), abs=1e-13)
        assert workspace.ranges[0].low_limit == "leg 2 longest"
        assert workspace.ranges[0].high_limit == "leg 1 longest"

    def test_turned_orientation_moves_the_feet(self):
        mechanism = geometry(np.zeros((6, 3)), np.array([[0.0, 1.0], *self.rest]))
        rotation = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
        foot = mechanism.base_anchors[0] - rotation @ mechanism.platform_anchors[0]
        workspace = constant_orientation_workspace(
            mechanism, rotation, position=foot + [0.0, 0.0, 0.2], singularity=False
        )
        assert workspace.volume[0] <= 4 / 3 * math.pi <= workspace.volume[1]
        assert [workspace.ranges[2].low, workspace.ranges[2].high] == pytest.approx([-1.2, 0.8], abs=1e-13)

    def test_all_orientations(self):
        mechanism = geometry(np.zeros((6, 3)), (0.0, 50.0))
        workspace = orientation_workspace(mechanism, [0.0, 0.0, 3.0], singularity=False)
        assert workspace.volume[0] <= 8 * math.pi**2 <= workspace.volume[1]
        assert workspace.converged
        assert all(one.high == -one.low == math.pi for one in workspace.ranges)
        assert {one.high_limit for one in workspace.ranges} == {"half turn"}

    def test_orientations_that_one_leg_allows(self):
        """R b is uniform on a sphere: the part with a small enough component along P - A."""
        mechanism = geometry(np.zeros((6, 3)), (0.0, 50.0))
        position = np.array([0.0, 0.0, 3.0])
        D, b = position - mechanism.base_anchors[0], mechanism.platform_anchors[0]
        longest = np.linalg.norm(D + b) + 0.05
        cosine = (longest**2 - D @ D - b @ b) / (2 * np.linalg.norm(D) * np.linalg.norm(b))
        legs = (replace(mechanism.legs[0], length_limits=(0.0, longest)), *mechanism.legs[1:])
        workspace = orientation_workspace(
            replace(mechanism, legs=legs), position, tolerance=0.03, singularity=False
        )
        exact = 8 * math.pi**2 * (1 + cosine) / 2
        assert -1 < cosine < 1
        assert workspace.volume[0] <= exact <= workspace.volume[1]
        assert workspace.converged


def narrow(shortest, longest):
    """The paper's mechanism with other strokes: shells too thin to be crossed in the base's plane."""
    mechanism = Mechanism.load("wu2012")
    return Mechanism.geometry(
        "narrow", mechanism.base_anchors, mechanism.platform_anchors, (shortest, longest)
    )


def test_the_mirrored_part_below_the_base_is_out_of_reach():
    workspace = constant_orientation_workspace(narrow(0.6, 0.7), tolerance=0.1, singularity=False)
    assert workspace.converged
    assert workspace.extent[2, 0] > 0
    (apart,) = workspace.apart
    # Base and platform are plane, so that the part below is the mirror image.
    assert apart[0] <= workspace.volume[1]
    assert workspace.volume[0] <= apart[1]
    above = constant_orientation_workspace(narrow(0.6, 0.7), tolerance=0.1)
    assert above.apart == ()
    assert above.volume[0] <= workspace.volume[1]
    assert workspace.volume[0] <= above.volume[1]


@pytest.mark.parametrize("room", [1e-3, 1e-7])
def test_a_reference_next_to_a_limit(wu2012, room):
    """The cells get as small there as the room is."""
    home = home_position(wu2012)
    inner = constant_orientation_workspace(wu2012, cells=3_000)
    place = home + [0.0, 0.0, inner.ranges[2].high - room]
    workspace = constant_orientation_workspace(wu2012, position=place, cells=30_000)
    lengths = np.linalg.norm(place + wu2012.platform_anchors - wu2012.base_anchors, axis=1)
    exact = 0.9 - lengths.max()
    # Rounding of lengths.
    assert workspace.inscribed[0] <= exact + 1e-14
    assert workspace.inscribed[1] >= exact - 1e-14
    assert workspace.inscribed[0] >= 0.98 * workspace.inscribed[1]
    assert 0 < workspace.volume[0] <= inner.volume[1]
    assert inner.volume[0] <= workspace.volume[1]


def test_a_third_of_a_turn_changes_nothing_of_a_mechanism_of_that_symmetry(wu2012):
    found = {kind: search(wu2012, cells=8_000) for kind, search in SEARCHES.items()}
    workspace = found["translation"]
    turn = Rotation.from_euler("z", 120, degrees=True).as_matrix()
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for kind in SEARCHES:
        constraints = Constraints(found[kind]._constraints.chart)
        way, turned = (ways(constraints, d)[0] for d in (directions, directions @ turn.T))
        # A way that only grazes a limit ends there or goes on by rounding.
        assert np.median(np.abs(way - turned)) < 1e-12
        assert np.mean(np.abs(way - turned) < 1e-9) >= 0.9
    centre, half = workspace._constraints.chart.root
    parameters = centre + half * rng.uniform(-1, 1, (20_000, 3))
    states = [workspace.cells.state[workspace.cell_of(p)] for p in (parameters, parameters @ turn.T)]
    inside = workspace.cell_of(parameters @ turn.T) >= 0
    assert not ((states[0] == 2) & (states[1] == 0) & inside).any()
    assert not ((states[0] == 0) & (states[1] == 2) & inside).any()


@pytest.mark.parametrize("kind", SEARCHES)
def test_units_of_length_scale_the_volume(kind):
    """By powers of two, so that every cell is the same to the last bit."""
    mechanism = Mechanism.load("tsai2000")
    one, other = (SEARCHES[kind](m, cells=4_000) for m in (mechanism, scaled(mechanism, 8.0, 1.0)))
    volume = 8.0**3 if kind == "translation" else 1.0
    length = 8.0 if kind == "translation" else 1.0
    assert np.array(other.volume) == pytest.approx(volume * np.array(one.volume), rel=1e-9)
    assert np.array(other.inscribed) == pytest.approx(length * np.array(one.inscribed), rel=1e-9)
    for a, b in zip(one.ranges, other.ranges, strict=True):
        assert [b.low, b.high] == pytest.approx([length * a.low, length * a.high], rel=1e-11)


def test_another_world_frame_changes_no_orientation():
    """But for home, and so for the side of the singularity: there the platform is not turned in any frame."""
    mechanism = Mechanism.load("tsai2000")
    turn = Rotation.from_rotvec([0.5, -1.0, 0.3]).as_matrix()
    position, shift = home_position(mechanism), np.array([3.0, -2.0, 5.0])
    moved = replace(
        mechanism, base_anchors=mechanism.base_anchors @ turn.T + shift, gravity=turn @ mechanism.gravity
    )
    one = orientation_workspace(mechanism, position, tolerance=0.03, singularity=False)
    other = orientation_workspace(
        moved, turn @ position + shift, rotation=turn, tolerance=0.03, singularity=False
    )
    assert one.converged
    assert other.converged
    assert max(one.volume[0], other.volume[0]) <= min(one.volume[1], other.volume[1])
    assert max(one.inscribed[0], other.inscribed[0]) <= min(one.inscribed[1], other.inscribed[1])


@pytest.mark.parametrize("search", [constant_orientation_workspace, orientation_workspace])
@pytest.mark.parametrize("room", [1e-9, 1e-6, 1e-3])
def test_ball_of_tiny_strokes(wu2012, search, room):
    """Every leg's length has `room` to both sides: the ball is that over the steepest slope of a length."""
    anchors = wu2012.base_anchors, wu2012.platform_anchors
    home = home_position(wu2012)
    legs = home + anchors[1] - anchors[0]
    lengths = np.linalg.norm(legs, axis=1)
    limits = np.column_stack([lengths - room, lengths + room])
    mechanism = Mechanism.geometry("narrow", *anchors, limits)
    lower, upper = search(mechanism, position=home, tolerance=0.1, cells=5000).inscribed
    slopes = np.eye(3) if search is constant_orientation_workspace else anchors[1]
    directions = legs / lengths[:, None]
    if search is constant_orientation_workspace:
        steepest = 1.0
    else:
        steepest = np.linalg.norm(np.cross(slopes, directions), axis=1).max()
    exact = room / steepest
    # Second order of the lengths, and their rounding.
    off = 20 * exact**2 / lengths.min() + 1e-13 / steepest
    assert 0.9 * (exact - off) <= lower <= exact + off
    assert exact - off <= upper <= 1.2 * (exact + off)
    assert lower <= upper


@pytest.mark.parametrize(
    "options",
    [
        *({"tolerance": value} for value in ("x", None, np.nan, 0, 1, True)),
        *({"cells": value} for value in (1000.5, np.nan, "x", None, True, 999)),
    ],
)
@pytest.mark.parametrize("search", [constant_orientation_workspace, orientation_workspace])
def test_options_that_are_none_are_refused(wu2012, search, options):
    with pytest.raises(InputError, match=f"{next(iter(options))}: .*; allowed: "):
        search(wu2012, **options)
    with pytest.raises(InputError, match="mechanism: wu2012"):
        search("wu2012")
