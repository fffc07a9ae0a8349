"""Where paths to a mechanism's poses start: all its complex poses with one generic set of complex lengths.

Paths from there change the lengths alone, take a quarter of the steps of those from another mechanism, and
none leads to infinity, however special the anchors are. Made once for a mechanism and the octave of its legs'
root mean square length: lengths of another octave cost the first call's time again.

Special anchors have fewer poses than their class, whatever the lengths: the others are at infinity. Float64
does not tell these from poses far away, which anchors that are special up to a small number have: that they
are at infinity is found out numerically, never proven, and nearly special anchors give themselves away by
poses that cannot be certified, although the lengths are generic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from sixsps.arrays import Array
from sixsps.assembly.certificate import UNPROVEN, all_distinct, certified
from sixsps.assembly.endgame import CAREFUL, DETOURS, SAME, ends
from sixsps.assembly.frame import Frame
from sixsps.assembly.paths import Paths, Settings, follow
from sixsps.assembly.patterns import shared
from sixsps.assembly.start_systems import Complex, StartSystem, start_system

_SEED = 19981231
# Loops of lengths in a row that bring no new pose, after which there are no more.
_QUIET, _MOST_LOOPS = 12, 100
# e.e of coordinates of length one at infinity, or next to it for anchors that are special up to rounding. Of
# real poses it is 1 / (1 + |P|^2), where |P| is of the order of the legs; of complex ones it shrinks with the
# eighth power of the legs' length, as was found out by trying.
_NOTHING, _BY_OCTAVE, _ROUNDING = 1e-10, 2.0**-8, 1e-15
# The same of ends that are singular, and known less well.
_NEAR_NOTHING = 1e-6
# Octave of the shortest lengths that paths start from.
_SHORT = -2
# Paths go to infinity at their end, not before: one that did got onto the set at infinity by mistake.
_LATE = 0.99


@dataclass(frozen=True, eq=False)
class LengthsStart:
    """A mechanism with generic complex lengths, and all its poses.

    Attributes:
        general: of the class.
        legs: (6, 7) in the frame of the mechanism.
        solutions: (n, 8) coordinates, of length one.
        unaccounted: poses of the class that were neither found nor are at infinity.
        infinite: poses of the class that were followed to infinity.
        doubtful: whether some of the solutions could not be certified; there may be doubles among them.
    """

    general: StartSystem
    legs: Complex
    solutions: Complex
    unaccounted: int = 0
    infinite: int = 0
    doubtful: bool = False

    @property
    def expected(self) -> int:
        """How many solutions there are with generic lengths; those of the class, at most, where in doubt."""
        most = len(self.general.solutions)
        return most if self.doubtful else min(len(self.solutions), most)


def lengths_start(frame: Frame, base: Array, platform: Array) -> LengthsStart:
    """Returns where paths start, from memory where this mechanism was asked for before.

    Args:
        frame: of the mechanism.
        base: (6, 3) base anchors [m].
        platform: (6, 3) platform anchors [m].
    """
    mean = float(np.mean(frame.lengths**2))
    octave = round(math.log2(mean) / 2) if mean > 0 else 0
    return _made(base.tobytes(), platform.tobytes(), max(octave, _SHORT))


@lru_cache(maxsize=64)
def _made(base: bytes, platform: bytes, octave: int) -> LengthsStart:
    a, b = (np.frombuffer(side).reshape(6, 3) for side in (base, platform))
    general = start_system(shared(a), shared(b))
    frame = Frame.of(a, b, np.zeros(6))
    random = np.random.default_rng(_SEED)
    legs = _with_lengths(frame.legs, octave, random)
    for settings in (Settings(), CAREFUL):
        paths = follow(general.legs, legs, general.solutions, settings)
        solutions = _unit(paths.ends)
        if paths.arrived.all() and _all_proven(frame, legs, solutions):
            return LengthsStart(general, legs, solutions)
    least = max(_NOTHING * _BY_OCTAVE ** max(octave - 2, 0), _ROUNDING)
    known = different(np.concatenate([_finite(paths, least), _by_detours(general, legs, least)]))
    infinite, proven = _ended(general, frame, legs, paths, least)
    known = _closed(legs, different(np.concatenate([known, proven])), octave, random)
    if not len(known):  # every pose is singular: generic lengths have none
        return LengthsStart(general, general.legs, general.solutions)
    lost = len(solutions) - len(known)
    unaccounted = max(lost - infinite, 0)
    doubtful = not _all_proven(frame, legs, known.copy()) or _more_elsewhere(
        general, frame, len(known), random
    )
    return LengthsStart(general, legs, known, unaccounted, max(lost - unaccounted, 0), doubtful)


def _finite(paths: Paths, least: float) -> Complex:
    """Returns the ends (n, 8) of paths that arrived at poses that are not at infinity."""
    return _unit(paths.ends[paths.arrived & (squares(paths.ends) > least)])


def _by_detours(general: StartSystem, legs: Complex, least: float) -> Complex:
    """Returns what other paths find: beside poses at infinity one is lost now and then."""
    found = []
    for detour in DETOURS:
        between = general.legs + detour * (legs - general.legs)
        paths = follow(general.legs, between, general.solutions, CAREFUL)
        found.append(_finite(follow(between, legs, paths.ends[paths.arrived], CAREFUL), least))
    return np.concatenate(found)


def _ended(
    general: StartSystem, frame: Frame, legs: Complex, paths: Paths, least: float
) -> tuple[int, Complex]:
    """Returns how many paths went to infinity, and certified poses that others end at."""
    square = squares(paths.ends)
    there = (square <= least) & (paths.places > _LATE)
    doubtful = ~there & ~(paths.arrived & (square > least))
    found = _unit(paths.ends[doubtful])
    near = np.where(paths.places[doubtful] > _LATE, square[doubtful], 1.0)
    for k, end in enumerate(ends(general.legs, legs, general.solutions[doubtful])):
        if end is not None:
            found[k], near[k] = end.x, squares(end.x)
    proven = (certified(frame, legs, found)[0] != UNPROVEN) & (near > least)
    return int(np.sum(there) + np.sum(~proven & (near < _NEAR_NOTHING))), _unit(found[proven])


def _more_elsewhere(general: StartSystem, frame: Frame, count: int, random: np.random.Generator) -> bool:
    """Returns whether more poses than that are certified with short legs, where they are less far away."""
    legs = _with_lengths(frame.legs, _SHORT, random)
    paths = follow(general.legs, legs, general.solutions, CAREFUL)
    solutions = _unit(paths.ends)
    kinds, radii = certified(frame, legs, solutions)
    proven = kinds != UNPROVEN
    doubles = np.zeros(int(proven.sum()), np.bool_)
    all_distinct(solutions[proven], radii[proven], doubles)
    return int(np.sum(~doubles)) > count


def squares(x: Complex) -> Array:
    """Returns |e.e| of coordinates x (..., 8) scaled to length one."""
    return np.abs(np.sum(x[..., :4] ** 2, axis=-1)) / np.sum(np.abs(x) ** 2, axis=-1)


def _all_proven(frame: Frame, legs: Complex, solutions: Complex) -> bool:
    kinds, radii = certified(frame, legs, solutions)
    return bool(np.all(kinds != UNPROVEN)) and all_distinct(solutions, radii, np.zeros(len(radii), np.bool_))


def _closed(legs: Complex, known: Complex, octave: int, random: np.random.Generator) -> Complex:
    """Returns solutions (n, 8) and all that paths around loops of lengths turn them into."""
    quiet = loops = 0
    while len(known) and quiet < _QUIET and loops < _MOST_LOOPS:
        stops = [legs, *(_with_lengths(legs, octave, random) for _ in range(2)), legs]
        moved = known
        for one, other in pairwise(stops):
            paths = follow(one, other, moved, CAREFUL)
            moved = _unit(paths.ends[paths.arrived])
        found = different(np.concatenate([known, moved]))
        quiet, loops = (quiet + 1 if len(found) == len(known) else 0), loops + 1
        known = found
    return known


def different(x: Complex) -> Complex:
    """Returns the different ones of solutions x (n, 8) of length one."""
    near = np.abs(x.conj() @ x.T) > 1 - SAME
    return x[[k for k in range(len(x)) if not near[k, :k].any()]]


def _unit(x: Complex) -> Complex:
    return x / np.linalg.norm(x, axis=1)[:, None]


def _with_lengths(legs: Complex, octave: int, random: np.random.Generator) -> Complex:
    changed = legs.copy()
    numbers = random.standard_normal((2, 6))
    changed[:, 6] = 4.0**octave * (1 + 0.5 * (numbers[0] + 1j * numbers[1]))
    return changed
