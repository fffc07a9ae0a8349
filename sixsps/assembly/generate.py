"""Makes `start_systems.npz`: a generic mechanism of every class with all its poses, by monodromy.

A made-up pose and made-up anchors give one solution. Paths around closed loops of mechanisms of the class
permute the solutions of the first; they are all found when loop after loop brings no new one. Of several
mechanisms that one is kept from which paths to random real ones take the fewest steps.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sixsps.assembly.paths import Complex, Settings, follow
from sixsps.assembly.patterns import Pattern, every_pattern
from sixsps.assembly.start_systems import FILE, legs_from

# Loops in a row without a new solution.
_QUIET = 15
_MOST_LOOPS = 200
_CANDIDATES, _TARGETS = 24, 12
_CAREFUL = Settings(tolerance=1e-5, contraction=0.02, least_step=1e-9, most_steps=4000)
# 1 - cosine of the angle between two solutions
_APART = 1e-11
# Smallest singular value over the largest below which every pose of the class is singular.
_SINGULAR = 1e-10


def anchors(pattern: Pattern, random: np.random.Generator, real: bool = False) -> tuple[Complex, Complex]:
    """Returns base and platform anchors (6, 3) of a random mechanism of a class."""
    base, platform = (_normal(random, (6, 3), real) for _ in range(2))
    return base[list(pattern.base)], platform[list(pattern.platform)]


def made_up(pattern: Pattern, random: np.random.Generator, real: bool = False) -> tuple[Complex, Complex]:
    """Returns legs (6, 7) of a random mechanism in a random pose, and the pose's coordinates (8,)."""
    base, platform = anchors(pattern, random, real)
    e, g = (_normal(random, (4,), real) for _ in range(2))
    g -= (e @ g) / (e @ e) * e
    legs = legs_from(base, platform, np.zeros(6))
    legs[:, 6] = np.sum(arms(legs, e, g) ** 2, axis=1) / (e @ e)
    return legs, np.concatenate([e, g])


def arms(legs: Complex, e: Complex, g: Complex) -> Complex:
    """Returns the legs' quaternions v (6, 4) at (e, g)."""
    d, m = legs[:, :3], legs[:, 3:6]
    vector = -e[0] * d - np.cross(m, e[1:])
    return g + np.concatenate([(d @ e[1:])[:, None], vector], axis=1)


def merged(known: Complex, more: Complex) -> Complex:
    """Returns the different ones of two sets of solutions (n, 8), of length one."""
    for x in more / np.linalg.norm(more, axis=1)[:, None]:
        overlap = np.abs(known.conj() @ x)
        if not np.any(overlap > 1 - _APART):
            known = np.concatenate([known, x[None]])
    return known


def all_solutions(legs: Complex, pose: Complex, pattern: Pattern, random: np.random.Generator) -> Complex:
    """Returns the solutions (n, 8) that loops from one of them reach."""
    known = merged(np.empty((0, 8), complex), pose[None])
    quiet = loops = 0
    while quiet < _QUIET and loops < _MOST_LOOPS:
        stops = [legs, *(made_up(pattern, random)[0] for _ in range(2)), legs]
        moved = known
        for start, end in pairwise(stops):
            paths = follow(start, end, moved, _CAREFUL)
            moved = paths.ends[paths.arrived]
        found = merged(known, moved)
        quiet, loops = (quiet + 1 if len(found) == len(known) else 0), loops + 1
        known = found
    return known


def is_regular(legs: Complex, pose: Complex) -> bool:
    """Returns whether a pose is an isolated, simple solution."""
    e, g = pose[:4], pose[4:]
    v = arms(legs, e, g)
    units = [arms(legs, unit, np.zeros(4, complex)) for unit in np.eye(4, dtype=complex)]
    by_e = np.stack([np.sum(v * column, axis=1) for column in units], axis=1) - legs[:, 6:] * e
    rows = np.concatenate([np.hstack([by_e, v]), np.concatenate([g, e])[None]])
    values = np.linalg.svd(rows, compute_uv=False)
    return bool(values[-1] > _SINGULAR * values[0])


def best(pattern: Pattern, seed: int) -> tuple[Complex, Complex] | None:
    """Returns legs and solutions from which paths are short, or None where every pose is singular."""
    random = np.random.default_rng(seed)
    targets = [made_up(pattern, random, real=True)[0] for _ in range(_TARGETS)]
    kept, least, count = None, np.inf, 0
    for _ in range(_CANDIDATES):
        legs, pose = made_up(pattern, random)
        if not is_regular(legs, pose):
            return None
        solutions = all_solutions(legs, pose, pattern, random)
        steps = sum(follow(legs, target, solutions, Settings()).steps.mean() for target in targets)
        if len(solutions) > count or (len(solutions) == count and steps < least):
            kept, least, count = (legs, solutions), steps, len(solutions)
    return kept


def main() -> int:
    """Writes the file; takes some minutes."""
    patterns, legs, solutions = [], [], []
    for number, pattern in enumerate(every_pattern()):
        found = best(pattern, number)
        count = len(found[1]) if found else 0
        sys.stdout.write(f"{pattern.name} {pattern.base} {pattern.platform}: {count}\n")
        sys.stdout.flush()
        if found:
            patterns.append((pattern.base, pattern.platform))
            legs.append(found[0])
            solutions.append(found[1])
    counts = np.array([len(one) for one in solutions])
    np.savez_compressed(
        Path(__file__).with_name(FILE),
        patterns=np.array(patterns, np.int8),
        legs=np.array(legs),
        counts=counts,
        solutions=np.concatenate(solutions),
    )
    return 0


def _normal(random: np.random.Generator, shape: tuple[int, ...], real: bool) -> NDArray[np.complex128]:
    numbers = random.standard_normal(shape) + 0j
    if not real:
        numbers = (numbers + 1j * random.standard_normal(shape)) / np.sqrt(2)
    return numbers.astype(np.complex128)


if __name__ == "__main__":
    sys.exit(main())
