"""What cells claim of all their poses, against poses drawn in them and computed without the cells."""

import math

import numpy as np
import pytest
from cases import random_mechanism

from sixsps.home import home_position
from sixsps.limits import Limits
from sixsps.margins import pose_margins, segment_distances
from sixsps.mechanism import Mechanism
from sixsps.workspace.charts import Translation, Turning, exponential, left_jacobian
from sixsps.workspace.clearance import nearest
from sixsps.workspace.constraints import HALF_TURN, SINGULARITY, Constraints
from sixsps.workspace.fractions import fraction_bounds
from sixsps.workspace.octree import CORNERS, DEEPEST, Leaves, morton

CHARTS = (Translation, Turning)


def limited(seed, clearance=0.15):
    """A random geometry with six different strokes, cones and a clearance."""
    drawn = random_mechanism(seed)
    rng = np.random.default_rng(seed)
    limits = Limits(
        base_cone=rng.uniform(0.2, 2.5, 6),
        platform_cone=rng.uniform(0.2, 2.5, 6),
        platform_axes=rng.standard_normal((6, 3)),
        clearance=clearance * drawn.characteristic_length,
    )
    lengths = drawn.length_limits * rng.uniform(0.9, 1.1, (6, 1))
    return Mechanism.geometry("limited", drawn.base_anchors, drawn.platform_anchors, lengths, limits)


def cells(chart, rng, n=150):
    """Cells of many sizes around the reference pose, some of them flat."""
    size = chart.root[1]
    centre = rng.uniform(-0.6, 0.6, (n, 3)) * size
    half = size * 10 ** rng.uniform(-6, -0.5, (n, 1)) * (rng.random((n, 3)) < 0.9)
    return centre, half


def drawn_in(centre, half, rng, k=40):
    """(n, k, 3) parameters in cells, one in three of each coordinate at an end."""
    u = rng.uniform(-1, 1, (len(centre), k, 3))
    u = np.where(rng.random(u.shape) < 1 / 3, np.sign(u), u)
    return u, centre[:, None] + half[:, None] * u


def jacobian(mechanism, position, rotation):
    """(n, 6, 6) rows [s, c x s], each times the length."""
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    legs = position[:, None] + arms - mechanism.base_anchors
    return np.concatenate([legs, np.cross(arms, legs)], axis=2)


def truth(chart, names, parameters):
    """Margins of all limits by formulas that share nothing with the cells' but the geometry."""
    mechanism, n = chart.mechanism, len(parameters)
    position, rotation = chart.poses(parameters)
    found = pose_margins(mechanism, position, rotation).limits
    lengths = found["max_length"].values
    columns = [found[key].margins for key in ("min_length", "max_length")]
    for key in ("base_cone", "platform_cone"):
        cosines = np.cos(found[key].values) - np.cos(found[key].limit)
        columns.append(lengths * cosines)
    columns.append(found["clearance"].margins)
    if chart.kind == "orientation":
        r = np.linalg.norm(parameters, axis=1)
        columns.append(((math.pi**2 - r**2) / (2 * math.pi))[:, None])
    home = jacobian(mechanism, home_position(mechanism)[None], np.eye(3)[None])
    J = jacobian(mechanism, position, rotation)
    columns.append((np.sign(np.linalg.det(home)) * np.sign(np.linalg.det(J)))[:, None])
    values = np.concatenate(columns, axis=1)
    assert values.shape == (n, len(names))
    return values


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("make", CHARTS)
def test_no_pose_of_a_cell_is_outside_the_bounds_of_the_cell(make, seed):
    """Between both bounds where it is enclosed; of clearance and singularity the bounds' sign counts."""
    mechanism, rng = limited(seed), np.random.default_rng(seed)
    chart = make(mechanism, home_position(mechanism), exponential(rng.normal(0, 0.3, (1, 3)))[0])
    constraints = Constraints(chart)
    centre, half = cells(chart, rng)
    f = constraints.over(centre, half)
    u, inside = drawn_in(centre, half, rng)
    values = truth(chart, constraints.names, inside.reshape(-1, 3)).reshape(*u.shape[:2], -1)
    linear = f.value[:, None] + np.einsum("nmk,nck->ncm", f.slope, half[:, None] * u)
    low, high = linear + f.below[:, None], linear + f.above[:, None]
    signed = [k for k, name in enumerate(constraints.names) if "clearance" in name or name == SINGULARITY]
    others = np.setdiff1d(np.arange(len(constraints.names)), signed)
    # Cosines are of angles, as rounded as those.
    rounding = 1e-13 * chart.root[1]
    assert (low[..., others] <= values[..., others] + rounding).all()
    assert (high[..., others] >= values[..., others] - rounding).all()
    assert (values[..., signed] >= -rounding)[low[..., signed] >= 0].all()
    assert (values[..., signed] <= rounding)[high[..., signed] < 0].all()
    clearances = signed[:-1]
    assert (low[..., clearances] >= 0).any()
    assert (high[..., clearances] < 0).any()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("make", CHARTS)
def test_the_side_of_the_singularity_is_that_of_every_pose(make, seed):
    """Without other limits, which would keep cells from being asked."""
    drawn, rng = random_mechanism(seed), np.random.default_rng(seed)
    far = 100 * drawn.characteristic_length
    mechanism = Mechanism.geometry("wide", drawn.base_anchors, drawn.platform_anchors, (0, far))
    chart = make(mechanism, home_position(drawn), exponential(rng.normal(0, 0.3, (1, 3)))[0])
    constraints = Constraints(chart)
    size = 0.5 if make is Turning else 0.5 * drawn.characteristic_length
    centre = rng.uniform(-4, 4, (400, 3)) * size
    half = size * 10 ** rng.uniform(-5, -0.5, (400, 1)) * np.ones(3)
    f = constraints.over(centre, half)
    column = constraints.names.index(SINGULARITY)
    u, inside = drawn_in(centre, half, rng)
    determinant = constraints.at(inside.reshape(-1, 3))[:, column].reshape(u.shape[:2])
    J = jacobian(mechanism, *chart.poses(inside.reshape(-1, 3)))
    home = jacobian(mechanism, home_position(mechanism)[None], np.eye(3)[None])
    expected = np.sign(np.linalg.det(home)) * np.linalg.det(J).reshape(u.shape[:2])
    assert np.array_equal(np.sign(determinant), np.sign(expected))
    linear = f.value[:, None, column] + np.einsum("nk,nck->nc", f.slope[:, column], half[:, None] * u)
    proven, broken = linear + f.below[:, None, column] >= 0, linear + f.above[:, None, column] < 0
    assert (expected[proven] > 0).all()
    assert (expected[broken] < 0).all()
    # Undecided is what is near a zero, as cells are small.
    small = half[:, 0] < 1e-3 * size
    assert np.mean((proven | broken)[small]) > 0.9


@pytest.mark.parametrize("make", CHARTS)
def test_bounds_close_with_the_square_of_the_size(make):
    mechanism = limited(3)
    chart = make(mechanism, home_position(mechanism), np.eye(3))
    constraints, rng = Constraints(chart), np.random.default_rng(0)
    centre = rng.uniform(-0.2, 0.2, (40, 3)) * chart.root[1]
    smooth = [
        k for k, name in enumerate(constraints.names) if "clearance" not in name and name != SINGULARITY
    ]
    gaps = []
    for size in (1e-2, 1e-3):
        f = constraints.over(centre, np.full((40, 3), size * chart.root[1]))
        gaps.append((f.above - f.below)[:, smooth].max(axis=0))
    # Rounding is a part in 1e6 of the smaller gap.
    assert (gaps[1] <= gaps[0] / 80).all()


def test_singular_surface_is_enclosed_to_second_order():
    """At the singular yaw of a quarter turn the bound knows the surface's place and slope."""
    mechanism = Mechanism.load("wu2012")
    chart = Turning(mechanism, home_position(mechanism), np.eye(3))
    constraints, column = Constraints(chart), -1
    assert constraints.names[-2:] == (HALF_TURN, SINGULARITY)
    spread = []
    for size in (1e-2, 1e-3):
        f = constraints.over(np.array([[0.0, 0.0, math.pi / 2 - 0.3 * size]]), np.full((1, 3), size))
        slope = np.abs(f.slope[0, column, 2]) * size
        assert f.value[0, column] == pytest.approx(0.3 * slope, rel=0.2)
        spread.append((f.above[0, column] - f.below[0, column]) / slope)
    assert spread[1] < spread[0] / 8


def test_rotation_vectors_are_no_nearer_than_their_rotations():
    rng = np.random.default_rng(0)
    a = rng.uniform(-3, 3, (2000, 3))
    d = rng.standard_normal((2000, 3)) * 10 ** rng.uniform(-6, 0.5, (2000, 1))
    between = np.einsum("nij,nkj->nik", exponential(a + d), exponential(a))
    angle = np.arccos(np.clip((np.trace(between, axis1=1, axis2=2) - 1) / 2, -1, 1))
    # The arc cosine loses half of the digits near 0.
    assert (angle <= np.linalg.norm(d, axis=1) + 1e-7).all()


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.04, 0.06, 1.0, 3.1, 6.0])
def test_left_jacobian_is_the_slope_of_the_exponential(size):
    rng = np.random.default_rng(1)
    axis = rng.standard_normal((20, 3))
    r = size * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    d, step = rng.standard_normal((20, 3)), 1e-5
    ahead, behind = exponential(r + step * d), exponential(r - step * d)
    turning = np.einsum("nij,nkj->nik", ahead - behind, exponential(r)) / (2 * step)
    expected = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
    found = np.einsum("nij,nj->ni", left_jacobian(r), d)
    # Central differences: step^2 and roundoff / step.
    assert np.abs(found - expected).max() < 2e-9 * (1 + np.abs(d).max() ** 3)


def test_fractions_hold_the_counted_part():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (200_000, 3))
    for _ in range(60):
        slope = rng.standard_normal(3) * 10 ** rng.uniform(-6, 0, 3)
        offset = rng.uniform(-1.2, 1.2) * np.abs(slope).sum()
        width = 10 ** rng.uniform(-8, -1) * np.abs(slope).sum()
        lower, upper = fraction_bounds(np.array([offset - width]), np.array([offset + width]), slope[None])
        exact = [np.mean(points @ slope + offset + shift >= 0) for shift in (-width, width)]
        noise = 4 * 0.5 / math.sqrt(len(points))
        assert lower[0] <= exact[0] + noise
        assert upper[0] >= exact[1] - noise
        # And no more than slopes that were raised cost.
        assert lower[0] >= exact[0] - noise - 2e-3
        assert upper[0] <= exact[1] + noise + 2e-3


def test_fractions_of_known_cuts():
    slope = np.array([[1.0, 0, 0], [1.0, 1.0, 0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [0, 0, 0], [0, 0, 0]])
    offset = np.array([0.5, 0.0, -1.0, 2.0, 0.1, -0.1])
    lower, upper = fraction_bounds(offset, offset, slope)
    expected = np.array([0.75, 0.5, 2**3 / 6 / 8, 1 - 1 / 48, 1.0, 0.0])
    assert (lower <= expected).all()
    assert (upper >= expected).all()
    assert (upper - lower).max() < 2.5e-3


def test_nearest_points_are_as_near_as_the_distance():
    rng = np.random.default_rng(2)
    D, S, T = rng.standard_normal((3, 20_000, 3)) * 10 ** rng.uniform(-2, 1, (3, 20_000, 1))
    T[:5000] = S[:5000] * rng.uniform(-2, 2, (5000, 1))  # parallel
    t, u = nearest(D, S, T)
    assert ((t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)).all()
    distance = np.linalg.norm(D + u[:, None] * T - t[:, None] * S, axis=1)
    exact = segment_distances(np.zeros_like(D), S, D, T)
    # Only used as points on the legs, so that near-parallel ones may cost digits.
    assert (distance >= exact - 1e-12).all()
    assert np.quantile(distance - exact, 0.99) < 1e-9


class TestOctree:
    def test_morton_orders_as_the_bits_say(self):
        rng = np.random.default_rng(0)
        points = rng.integers(0, 1 << 21, (500, 3))
        for point, code in zip(points.tolist(), morton(points).tolist(), strict=True):
            bits = sum(((point[axis] >> k) & 1) << (3 * k + axis) for axis in range(3) for k in range(21))
            assert bits == code

    def leaves(self):
        """The root cut into 8, one of these into 8, and one of those left out."""
        coarse = CORNERS[1:]
        fine = CORNERS[:7]
        index = np.concatenate([coarse, fine])
        level = np.concatenate([np.full(7, 1), np.full(7, 2)])
        return index, level, Leaves(index, level)

    def test_every_point_is_in_its_leaf(self):
        index, level, leaves = self.leaves()
        points = np.random.default_rng(0).integers(-10, (1 << DEEPEST) + 10, (5000, 3))
        found = leaves.holding(points)
        width = 1 << (DEEPEST - level)
        low = index * width[:, None]
        holds = ((points[:, None] >= low) & (points[:, None] < low + width[:, None])).all(axis=2)
        assert np.array_equal(found >= 0, holds.any(axis=1))
        assert holds[np.flatnonzero(found >= 0), found[found >= 0]].all()

    def test_parts_are_what_touches(self):
        rng = np.random.default_rng(3)
        for _ in range(30):
            index, level, _ = self.leaves()
            kept = rng.random(len(index)) < 0.35
            if not kept.any():
                continue
            index, level = index[kept], level[kept]
            width = 1 << (DEEPEST - level)
            low = index * width[:, None]
            high = low + width[:, None]
            touch = (low[:, None] <= high) & (low <= high[:, None])
            reach = touch.all(axis=2)
            for _ in range(len(index)):
                reach = reach @ reach
            every = np.ones((len(index), 8), dtype=bool)
            parts = Leaves(index, level).parts(every, every[:, 0])
            assert np.array_equal(parts[:, None] == parts, reach)

    def test_corners_join_only_where_both_have_them(self):
        index, level = np.array([[0, 0, 0], [1, 0, 0]]), np.array([1, 1])
        leaves, whole = Leaves(index, level), np.zeros(2, dtype=bool)
        corners = np.zeros((2, 8), dtype=bool)
        corners[0, 4], corners[1, 1] = True, True  # (1, 0, 0) of the one, (0, 0, 1) of the other
        assert len(set(leaves.parts(corners, whole))) == 2
        corners[1, 0] = True
        assert len(set(leaves.parts(corners, whole))) == 1
        corners[1] = False
        assert len(set(leaves.parts(corners, whole))) == 2
        assert len(set(leaves.parts(corners, np.array([False, True])))) == 1
