"""What paths start from: the classes of hexapods, and all complex poses of one of each, counted twice."""

import re
from collections import Counter

import numpy as np
import pytest

from sixsps import sources
from sixsps.assembly import certificate, generate, lengths_start, tracker
from sixsps.assembly.endgame import CAREFUL
from sixsps.assembly.frame import Frame
from sixsps.assembly.paths import Settings, follow
from sixsps.assembly.patterns import Pattern, every_pattern, relabelling, shared
from sixsps.assembly.start_systems import MOST, legs_from, start_system, start_systems

GENERAL = Pattern(tuple(range(6)), tuple(range(6)))
OCTAHEDRON = Pattern((0, 0, 1, 1, 2, 2), (0, 1, 0, 2, 1, 2))
# Sums of some ten products of numbers up to ten.
ROUNDING = 1e-13


def defects(system):
    """Largest value of the equations at every solution."""
    values = []
    for x in system.solutions:
        v = generate.arms(system.legs, x[:4], x[4:])
        legs = np.sum(v**2, axis=1) - system.legs[:, 6] * np.sum(x[:4] ** 2)
        values.append(max(np.abs(legs).max(), abs(x[:4] @ x[4:])))
    return np.array(values)


class TestWhatIsShipped:
    def test_are_34_of_50_classes(self):
        assert len(every_pattern()) == 50
        assert len(start_systems()) == 34
        assert set(start_systems()) <= set(every_pattern())
        counts = Counter(len(system.solutions) for system in start_systems().values())
        assert set(counts) == {8, 16, 24, 32, 40}

    def test_the_others_have_singular_poses_alone(self):
        rng = np.random.default_rng(0)
        for pattern in every_pattern():
            regular = generate.is_regular(*generate.made_up(pattern, rng))
            assert regular == (pattern in start_systems())

    @pytest.mark.parametrize(
        ("pattern", "count"),
        [
            (GENERAL, 40),
            (OCTAHEDRON, 16),
            # 6-3 with pairs of legs: Nanua, Waldron & Murthy (1990)
            (Pattern((0, 0, 1, 1, 2, 2), (0, 1, 2, 3, 4, 5)), 16),
            (Pattern((0, 0, 1, 1, 2, 3), (0, 1, 2, 3, 4, 5)), 32),
            (Pattern((0, 0, 1, 2, 3, 4), (0, 1, 2, 3, 4, 5)), 40),
        ],
    )
    def test_counts_are_those_of_the_literature(self, pattern, count):
        assert len(start_systems()[pattern].solutions) == count

    @pytest.mark.parametrize("pattern", start_systems(), ids=lambda one: f"{one.base}{one.platform}")
    def test_are_different_solutions_of_a_mechanism_of_the_class(self, pattern):
        system = start_systems()[pattern]
        base, platform = (system.legs[:, 3:6] + sign * system.legs[:, :3] for sign in (1, -1))
        for anchors, labels in ((base, pattern.base), (platform, pattern.platform)):
            near = np.abs(anchors[:, None] - anchors).max(axis=-1) < ROUNDING
            assert np.array_equal(near, np.equal.outer(labels, labels))
        assert defects(system).max() < ROUNDING
        overlap = np.abs(system.solutions.conj() @ system.solutions.T) - np.eye(len(system.solutions))
        assert overlap.max() < 1 - 1e-6
        assert np.abs(np.sum(system.solutions[:, :4] ** 2, axis=1)).min() > 1e-6

    @pytest.mark.parametrize("pattern", start_systems(), ids=lambda one: f"{one.base}{one.platform}")
    def test_are_as_many_as_paths_from_the_general_class_find(self, pattern):
        """An isolated pose of any mechanism is the end of a path from a general one."""
        general, system = start_systems()[GENERAL], start_systems()[pattern]
        assert len(general.solutions) == MOST
        paths = follow(general.legs, system.legs, general.solutions, CAREFUL)
        x = paths.ends / np.linalg.norm(paths.ends, axis=1)[:, None]
        overlap = np.abs(x.conj() @ system.solutions.T)
        hits = overlap > 1 - 1e-9
        assert np.all(np.sum(hits, axis=0) == 1)
        # the others end, or stop for good, at infinity, where e.e is zero
        assert np.all(np.abs(np.sum(x[~hits.any(axis=1), :4] ** 2, axis=1)) < 1e-7)


def test_monodromy_finds_them_again():
    rng = np.random.default_rng(7)
    legs, pose = generate.made_up(OCTAHEDRON, rng)
    assert len(generate.all_solutions(legs, pose, OCTAHEDRON, rng)) == 16


class TestClasses:
    def test_do_not_depend_on_order_and_roles(self):
        rng = np.random.default_rng(0)
        for pattern in every_pattern():
            order = rng.permutation(6)
            base, platform = (tuple(np.array(side)[order]) for side in (pattern.base, pattern.platform))
            for sides in ((base, platform), (platform, base)):
                change = relabelling(*sides)
                assert change.pattern == pattern
                back = [sides[change.exchanged][k] for k in change.order]
                assert shared(np.array(back)[:, None] * np.ones(3)) == pattern.base

    def test_start_systems_follow_the_order_and_the_roles(self):
        rng = np.random.default_rng(1)
        for _ in range(20):
            pattern = list(start_systems())[rng.integers(34)]
            order = rng.permutation(6)
            sides = [
                tuple(int(k) for k in np.array(side)[order]) for side in (pattern.base, pattern.platform)
            ]
            sides = sides[:: rng.choice([1, -1])]
            system = start_system(*sides)
            assert defects(system).max() < ROUNDING
            assert shared((system.legs[:, 3:6] + system.legs[:, :3]).round(9).real) == shared(
                np.array(sides[0])[:, None] * np.ones(3)
            )

    def test_minus_zero_is_zero(self):
        anchors = np.zeros((6, 3))
        anchors[1:, 0] = range(5)
        anchors[0] = -0.0
        assert shared(anchors) == (0, 0, 1, 2, 3, 4)


class TestPaths:
    @pytest.fixture
    def ends(self):
        rng = np.random.default_rng(3)
        general = start_systems()[GENERAL]
        return general.legs, generate.made_up(GENERAL, rng, real=True)[0], general.solutions

    def test_lead_there_and_back(self, ends):
        start, end, solutions = ends
        there = follow(start, end, solutions, Settings())
        back = follow(end, start, there.ends, Settings())
        assert back.arrived.all()
        overlap = np.abs(np.sum(back.ends.conj() * solutions, axis=1)) / np.linalg.norm(back.ends, axis=1)
        assert overlap.min() > 1 - 1e-12

    def test_do_not_depend_on_how_carefully_they_are_followed(self, ends):
        results = [follow(*ends, settings).ends for settings in (Settings(), CAREFUL)]
        one, other = (x / np.linalg.norm(x, axis=1)[:, None] for x in results)
        assert np.abs(np.sum(one.conj() * other, axis=1)).min() > 1 - 1e-12

    def test_take_few_steps(self, ends):
        assert np.mean(follow(*ends, Settings()).steps) < 40

    def test_end_where_they_are_told_to(self, ends):
        paths = follow(*ends, Settings(most_steps=3))
        assert not paths.arrived.any()
        assert np.all(paths.steps <= 4)
        assert np.all((paths.places > 0) & (paths.places < 1))

    def test_from_what_is_no_solution_stall(self, ends):
        start, end, solutions = ends
        random = np.random.default_rng(0).standard_normal(solutions.shape) + 0j
        paths = follow(start, end, random, Settings())
        assert not paths.arrived.any()


def test_lengths_alone_lead_to_as_many_poses_in_fewer_steps():
    rng = np.random.default_rng(9)
    base, platform = rng.uniform(-1, 1, (2, 6, 3))
    frame = Frame.of(base, platform, np.full(6, 1.5))
    start = lengths_start.lengths_start(frame, base, platform)
    assert len(start.solutions) == 40
    assert start.unaccounted == 0
    direct = follow(start.general.legs, frame.legs, start.general.solutions, Settings())
    assert follow(start.legs, frame.legs, start.solutions, Settings()).steps.sum() < direct.steps.sum()


def test_special_anchors_lose_poses_to_infinity():
    """Semiregular hexagons: a number of its own, that the lengths do not change."""
    angles = np.array([0.0, 0.4, 2.1, 2.5, 4.2, 4.6])
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    base, platform = ring, 0.6 * np.roll(ring, 1, axis=0)
    counts = set()
    for size in (1.0, 3.0):
        frame = Frame.of(base, platform, np.full(6, size))
        start = lengths_start.lengths_start(frame, base, platform)
        assert start.unaccounted == 0
        counts.add(len(start.solutions))
    assert len(counts) == 1
    assert counts.pop() < 40


def test_legs_from_anchors():
    base, platform = np.random.default_rng(0).standard_normal((2, 6, 3))
    legs = legs_from(base, platform, np.arange(6.0))
    assert np.allclose(legs[:, 3:6] + legs[:, :3], 2 * base, rtol=0, atol=ROUNDING)
    assert np.allclose(legs[:, 3:6] - legs[:, :3], 2 * platform, rtol=0, atol=ROUNDING)
    assert np.array_equal(legs[:, 6], np.arange(6))


def test_machine_code_is_named_after_the_sources_that_it_is_made_of():
    digest = sources.digest("machine_code.py", "assembly")[:16]
    for entry in (tracker.track_paths, certificate.certify, certificate.all_distinct):
        assert re.fullmatch(rf"\w+_{digest}", entry.py_func.__qualname__)
