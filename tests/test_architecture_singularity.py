"""Anchors with which every pose is singular are refused with the reason; others are not."""

import numpy as np
import pytest
from cases import random_mechanism
from scipy.spatial.transform import Rotation

from sixsps.architecture import best_condition, check_architecture
from sixsps.errors import MechanismError
from sixsps.mechanism import Mechanism

SEEDS = range(6)


def flat(points):
    return np.column_stack([points, np.zeros(len(points))])


def ellipse(angles, a=1.0, b=1.0):
    return np.column_stack([a * np.cos(angles), b * np.sin(angles)])


def angles_of(rng):
    """Six angles in any order, none close to another."""
    return rng.permutation(np.sort(rng.uniform(0, 1, 6) + np.arange(6)) * np.pi / 3.2)


def space(rng):
    return rng.standard_normal((6, 3))


def somewhere(points, rng):
    """The same anchors in a frame of its own, of another size."""
    size = 10 ** rng.uniform(-2, 2)
    return size * (Rotation.random(rng=rng).apply(points) + rng.standard_normal(3))


def on_a_line(places, rng):
    start, way = rng.standard_normal((2, 3))
    return start + np.asarray(places)[:, None] * way


def similar(rng):
    polygon = flat(ellipse(angles_of(rng)))
    return polygon, polygon, "base and platform are similar polygons, each on a conic"


def mirrored(rng):
    polygon = ellipse(angles_of(rng))
    return flat(polygon), flat(polygon * [1, -1]), "base and platform are similar polygons, each on a conic"


def affine(rng):
    angles = angles_of(rng)
    shear = np.array([[1.0, 0.5], [0.2, 1.5]])
    return (
        flat(ellipse(angles, 1, 0.6)),
        flat(ellipse(angles) @ shear),
        "base and platform are affinely related polygons, each on a conic",
    )


def projective(rng):
    """Chasles (1861): six lines between corresponding points of two projectively related conics."""
    points = ellipse(angles_of(rng))
    homography = np.eye(3) + 0.3 * rng.uniform(-1, 1, (3, 3))
    images = np.column_stack([points, np.ones(6)]) @ homography.T
    reason = "base and platform are projectively related polygons, each on a conic"
    return flat(points), flat(images[:, :2] / images[:, 2:]), reason


def hyperbola(rng):
    t = np.array([-2.0, -1, -0.4, 0.5, 1.2, 3]) * rng.uniform(0.9, 1.1, 6)
    points = flat(np.column_stack([t, 1 / t]))
    return points, 0.3 * points, "base and platform are similar polygons, each on a conic"


def griffis_duffy(rng):
    """Corners of a triangle joined to points on the sides of another, and the reverse."""
    corners = ellipse(np.radians([0, 120, 240]))
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    around = np.stack([corners, middles], axis=1).reshape(6, 2)
    shift = rng.choice([1, 3, 5])
    return flat(around), flat(0.6 * np.roll(around, shift, axis=0)), "belong to one linear complex"


def same_legs(rng):
    base, platform = space(rng), space(rng)
    base[4], platform[4] = base[1], platform[1]
    return base, platform, "legs 2 and 5 have the same joints"


def pencil(rng):
    base, platform = space(rng), space(rng)
    base[[0, 2, 3]] = base[0]
    platform[[0, 2, 3]] = on_a_line([0, 1, 2.5], rng)
    return base, platform, "legs 1, 3 and 4 meet in one base joint, and their platform joints are on one line"


def pencil_above(rng):
    platform, base, _ = pencil(rng)
    return base, platform, "legs 1, 3 and 4 meet in one platform joint, and their base joints are on one line"


def regulus(rng):
    """Four joints on a line, their others on a line of equal cross ratio: four lines of one regulus."""
    base, platform = space(rng), space(rng)
    places = np.array([0.0, 1, 3, 4])
    base[1:5] = on_a_line(places, rng)
    platform[1:5] = on_a_line((2 * places + 1) / (places + 3), rng)
    reason = "the joints of legs 2, 3, 4 and 5 divide a line of the base and one of the platform alike"
    return base, platform, reason


def congruence(rng):
    base, platform = space(rng), space(rng)
    base[:5], platform[:5] = on_a_line([0, 1, 2, 4, 5], rng), on_a_line([3, 1, 7, 4, 2.5], rng)
    return base, platform, "legs 1, 2, 3, 4 and 5 alone depend on each other"


def three_and_three(rng):
    base, platform = space(rng), space(rng)
    base[[0, 1, 2]], platform[[3, 4, 5]] = base[0], platform[3]
    return base, platform, "legs 1, 2 and 3 meet in one base joint, legs 4, 5 and 6 in one platform joint"


def four_in_one(rng):
    base = space(rng)
    base[2:] = base[2]
    return base, space(rng), "4 anchors coincide and every pose is singular; allowed: at most three"


def platform_in_one(rng):
    return space(rng), np.tile(rng.standard_normal(3), (6, 1)), "6 anchors coincide"


def base_on_a_line(rng):
    return on_a_line(rng.standard_normal(6), rng), space(rng), "base.anchors: all on one line"


def platform_on_a_line(rng):
    return space(rng), on_a_line(rng.standard_normal(6), rng), "platform.anchors: all on one line"


SINGULAR = [
    similar, mirrored, affine, projective, hyperbola, griffis_duffy, same_legs, pencil, pencil_above, regulus,
    congruence, three_and_three, four_in_one, platform_in_one, base_on_a_line, platform_on_a_line,
]  # fmt: skip


@pytest.mark.parametrize("kind", SINGULAR)
@pytest.mark.parametrize("seed", SEEDS)
def test_is_refused_with_the_reason(kind, seed):
    rng = np.random.default_rng(seed)
    base, platform, reason = kind(rng)
    with pytest.raises(MechanismError, match=reason) as refusal:
        Mechanism.geometry("x", somewhere(base, rng), somewhere(platform, rng))
    assert "every pose is singular" in str(refusal.value) or "coincide" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def conics_that_do_not_correspond(rng):
    return flat(ellipse(angles_of(rng))), flat(ellipse(angles_of(rng)))


def similar_off_conics(rng):
    polygon = flat(rng.standard_normal((6, 2)))
    return polygon, polygon


def other_cross_ratio(rng):
    base, platform, _ = regulus(rng)
    platform[4] += 0.2 * (platform[3] - platform[4])
    return base, platform


def five_on_a_line(rng):
    base = space(rng)
    base[:5] = on_a_line([0, 1, 2, 3, 5], rng)
    return base, space(rng)


def congruent_in_space(rng):
    anchors = space(rng)
    return anchors, anchors


def shared_joints(rng):
    """The 3-3 octahedron."""
    corners = flat(ellipse(np.radians([0, 120, 240])))
    return np.repeat(corners, 2, axis=0), -0.5 * corners[[2, 1, 2, 0, 0, 1]]


def three_in_one(rng):
    base = space(rng)
    base[:3] = base[0]
    return base, space(rng)


@pytest.mark.parametrize(
    "kind",
    [conics_that_do_not_correspond, similar_off_conics, other_cross_ratio, five_on_a_line, congruent_in_space,
     shared_joints, three_in_one],
)  # fmt: skip
@pytest.mark.parametrize("seed", SEEDS)
def test_what_looks_alike_and_is_regular_is_taken(kind, seed):
    rng = np.random.default_rng(seed)
    base, platform = (somewhere(anchors, rng) for anchors in kind(rng))
    mechanism = Mechanism.geometry("x", base, platform)
    assert best_condition(mechanism.base_anchors, mechanism.platform_anchors) < 1e6


@pytest.mark.parametrize("seed", SEEDS)
def test_where_the_frames_sit_does_not_matter(seed):
    """A platform frame a million radii away makes J ill-conditioned, and no pose singular."""
    mechanism = random_mechanism(seed)
    A, b, size = mechanism.base_anchors, mechanism.platform_anchors, mechanism.characteristic_length
    best = best_condition(A, b)
    for far in (1e3, 1e6):
        check_architecture(A + far * size, b, size)
        check_architecture(A, b + far * size, far * size)
        assert best_condition(A + far * size, b - far * size) == pytest.approx(best, rel=1e-6)
    assert best_condition(1e3 * A, 1e3 * b) == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("digits", [2, 3, 4, 6, 9])
def test_rounded_anchors_are_as_bad_as_their_rounding(digits):
    """The condition number says how near to singular every pose is, and beyond 1e5 they are refused."""
    angles = np.radians([3, 47, 125, 166, 244, 289.0])
    base, platform = np.round(flat(ellipse(angles)), digits), np.round(flat(0.37 * ellipse(angles)), digits)
    best = best_condition(base, platform)
    assert 10**digits / 30 < best < 10**digits * 1000
    if best < 1e5:
        Mechanism.geometry("rough", base, platform)
    else:
        with pytest.raises(MechanismError, match=r"nearly singular.* similar polygons, each on a conic"):
            Mechanism.geometry("typed", base, platform)
