"""Workspaces against poses drawn at random and searches along axes."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import BUNDLED, random_mechanism
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.errors import InputError, MechanismError, MotionError
from sixsps.home import home_position
from sixsps.limits import Limits
from sixsps.margins import pose_margins
from sixsps.mechanism import Mechanism
from sixsps.workspace import EmptyWorkspaceError, constant_orientation_workspace, orientation_workspace

SEARCHES = {"translation": constant_orientation_workspace, "orientation": orientation_workspace}
DRAWN = 40_000


@cache
def found(name, kind, limited=False, cells=8_000):
    mechanism = Mechanism.load(name) if isinstance(name, str) else random_mechanism(name)
    if limited:
        cones = Limits(base_cone=math.radians(35), platform_cone=math.radians(40), clearance=1.0)
        home = home_position(mechanism)[None], np.eye(3)[None]
        at_home = pose_margins(replace(mechanism, limits=cones), *home).limits["clearance"].values.min()
        mechanism = replace(mechanism, limits=replace(cones, clearance=0.9 * at_home))
    return SEARCHES[kind](mechanism, cells=cells)


def determinant(mechanism, position, rotation):
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    legs = position[:, None] + arms - mechanism.base_anchors
    return np.linalg.det(np.concatenate([legs, np.cross(arms, legs)], axis=2))


def allowed(mechanism, position, rotation):
    """Whether poses keep all limits on the side of home, by margins that know no cells."""
    home = home_position(mechanism)[None], np.eye(3)[None]
    side = np.sign(determinant(mechanism, *home)) * determinant(mechanism, position, rotation) > 0
    return pose_margins(mechanism, position, rotation).inside & side


def drawn(workspace, n=DRAWN):
    """Parameters in the cube of all cells, with the weight of each in the volume."""
    centre, half = workspace.cells.centre, workspace.cells.half[:, None]
    low, high = (centre - half).min(axis=0), (centre + half).max(axis=0)
    parameters = np.random.default_rng(7).uniform(low, high, (n, 3))
    weights = np.full(n, np.prod(high - low) / n)
    if workspace.kind == "orientation":
        angle = np.linalg.norm(parameters, axis=1)
        weights *= np.where(angle < math.pi, (np.sin(angle / 2) / (angle / 2)) ** 2, 0)
    return parameters[weights > 0], weights[weights > 0]


CASES = [
    *((name, kind, False) for name in BUNDLED for kind in SEARCHES),
    *((name, kind, True) for name in ("wu2012", "taghirad2013", 5) for kind in SEARCHES),
]


@cache
def compared(name, kind, limited):
    """A workspace, drawn parameters and weights, which of them are allowed, and their cells."""
    workspace = found(name, kind, limited)
    parameters, weights = drawn(workspace)
    truth = allowed(workspace.mechanism, *workspace.poses(parameters))
    return workspace, parameters, weights, truth, workspace.cell_of(parameters)


@pytest.mark.parametrize(("name", "kind", "limited"), CASES)
class TestAgainstRandomPoses:
    def test_no_cell_claims_a_pose_that_is_not_so(self, name, kind, limited):
        workspace, parameters, _, truth, cell = compared(name, kind, limited)
        assert (cell >= 0).all()
        states = workspace.cells.state[cell]
        assert truth[states == 2].all()
        assert not truth[states == 0].any()
        margins = (workspace.margins(parameters[:5000]) >= 0).all(axis=1)
        # A pose at its limit is allowed up to rounding.
        assert np.mean(margins != truth[:5000]) < 1e-3

    def test_volume_is_between_its_bounds(self, name, kind, limited):
        workspace, _, weights, truth, cell = compared(name, kind, limited)
        cells, lower, upper = workspace.cells, *workspace.volume
        for chosen, bound, sign in ((cells.part == 0, upper, 1), (cells.proven, lower, -1)):
            counted = weights * (truth & chosen[cell])
            error = math.sqrt(max(counted @ counted - counted.sum() ** 2 / DRAWN, 0.0))
            assert sign * (bound - counted.sum()) >= -4 * error


@pytest.mark.parametrize("kind", SEARCHES)
def test_each_round_closes_in(kind):
    rounds = []
    mechanism = Mechanism.load("taghirad2013")
    workspace = SEARCHES[kind](mechanism, tolerance=0.04, watch=lambda *told: rounds.append(told))
    judged, lower, upper = np.array(rounds).T
    assert (np.diff(judged) > 0).all()
    assert (np.diff(lower) >= 0).all()
    assert (np.diff(upper) <= 0).all()
    assert (lower[-1], upper[-1]) == workspace.volume
    assert judged[-1] == workspace.judged <= 300_000
    assert workspace.converged
    assert workspace.gap <= workspace.tolerance == 0.04


def test_a_budget_that_ends_the_search_is_told():
    workspace = found("wu2012", "orientation")
    assert not workspace.converged
    assert workspace.gap > workspace.tolerance
    assert 0.9 * 8_000 < workspace.judged <= 8_000


@pytest.mark.parametrize(("name", "kind", "limited"), CASES)
def test_ranges_end_where_a_search_along_the_axis_does(name, kind, limited):
    workspace = found(name, kind, limited)

    def kept(t, axis):
        return allowed(workspace.mechanism, *workspace.poses(np.atleast_1d(t)[:, None] * axis))

    for axis, one in zip(np.eye(3), workspace.ranges, strict=True):
        for sign, end, limit in ((1, one.high, one.high_limit), (-1, -one.low, one.low_limit)):
            if limit == "half turn":
                assert kept(np.linspace(0, math.pi, 2001), sign * axis).all()
                continue
            t = np.linspace(0, 1.5 * end, 1001)
            first = int(np.argmin(kept(t, sign * axis)))
            low, high = t[first - 1], t[first]
            for _ in range(60):
                middle = (low + high) / 2
                low, high = (middle, high) if kept(middle, sign * axis)[0] else (low, middle)
            # Margins leave 1e-12 of the limit for rounding; at a singularity the determinant is all rounding.
            assert end == pytest.approx(low, rel=1e-9), (one, limit)


def test_tilts_lean_to_their_azimuth_and_end_at_a_limit():
    workspace = found("tsai2000", "orientation")
    assert len(workspace.tilts) == 36
    for one in workspace.tilts:
        lean = np.array([math.cos(one.azimuth), math.sin(one.azimuth), 0.0])
        axis = np.cross([0.0, 0.0, 1.0], lean)
        for part, expected in ((1 - 1e-9, True), (1 + 1e-9, False)):
            rotation = Rotation.from_rotvec(part * one.tilt * axis).as_matrix()
            up = rotation @ [0.0, 0.0, 1.0]
            assert up[:2] == pytest.approx(math.sin(part * one.tilt) * lean[:2], abs=1e-12)
            kept = allowed(workspace.mechanism, workspace.position[None], rotation[None])
            assert bool(kept[0]) is expected


class TestRefusals:
    def test_no_length_limits(self):
        for search in SEARCHES.values():
            with pytest.raises(
                MechanismError, match=r"length_limits: missing; allowed: shortest and longest"
            ):
                search(Mechanism.load("dietmaier1998"))

    def test_a_reference_beyond_a_limit(self, wu2012):
        with pytest.raises(EmptyWorkspaceError, match=r"longest length of leg 1 is 2\.0\d* m, limit 0\.9 "):
            constant_orientation_workspace(wu2012, position=[0, 0, 2.0])
        tight = replace(wu2012, limits=Limits(clearance=0.2))
        with pytest.raises(
            EmptyWorkspaceError, match=r"leg-leg distance of leg \d-\d is 0\.\d+ m, limit 0\.2"
        ):
            orientation_workspace(tight)

    def test_a_reference_beyond_the_singularity(self, wu2012):
        with pytest.raises(EmptyWorkspaceError, match="beyond a singularity"):
            orientation_workspace(wu2012, -home_position(wu2012))
        below = constant_orientation_workspace(
            wu2012, position=-home_position(wu2012), singularity=False, cells=2000
        )
        assert below.volume[1] > 0

    @pytest.mark.parametrize("given", [{"tolerance": 0.0}, {"tolerance": 1.0}, {"cells": 10}])
    def test_settings_out_of_range(self, wu2012, given):
        with pytest.raises(InputError, match=next(iter(given))):
            constant_orientation_workspace(wu2012, **given)

    def test_what_is_no_pose(self, wu2012):
        with pytest.raises(MotionError):
            constant_orientation_workspace(wu2012, np.eye(3) * 2)
        with pytest.raises(MotionError):
            orientation_workspace(wu2012, [0.0, 0.0])


def test_names_are_public():
    assert sixsps.constant_orientation_workspace is constant_orientation_workspace
    assert sixsps.orientation_workspace is orientation_workspace
