"""All assembly modes: paths from a generic mechanism of the class, proofs, and what became of the rest."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import islice, pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixsps.arguments import mechanism_of
from sixsps.arrays import Array, frozen
from sixsps.assembly.certificate import NOT_REAL, REAL, UNPROVEN, all_distinct, certified
from sixsps.assembly.continua import System
from sixsps.assembly.endgame import CAREFUL, DETOURS, End, ends
from sixsps.assembly.frame import Frame
from sixsps.assembly.lengths_start import LengthsStart, lengths_start
from sixsps.assembly.modes import AssemblyModes, SingularMode
from sixsps.assembly.nearly_real import nearly_real, residual
from sixsps.assembly.partners import candidates, paired
from sixsps.assembly.paths import Settings, follow
from sixsps.assembly.start_systems import MOST, Complex
from sixsps.errors import MotionError
from sixsps.mechanism import Mechanism

# Coordinates of length one whose cosine is nearer to 1 are those of one singular pose.
_SAME = 1e-9
# Imaginary parts of the ends of paths at singular real solutions, known to some 1e-8, are below that.
_REAL = 1e-6
# Where more solutions are unresolved, it is not for a pair or two that lie close together; and places next to
# such from which Newton's method is started, enough for ten pairs.
_MOST_PARTNERS, _MOST_PLACES = 6, 200


@dataclass(eq=False)
class Findings:
    """What has been found of a mechanism's solutions.

    Attributes:
        x: (n, 8) certified, different solutions.
        radius: (n,) of the balls that hold them.
        kinds: (n,) REAL or NOT_REAL.
        singular: ends of paths at isolated singular solutions.
        moving: ends of paths in sets of solutions, and the dimensions of these.
        infinite: number of paths to infinity.
        unresolved: number of paths of which nothing is known.
    """

    x: Complex = field(default_factory=lambda: np.empty((0, 8), np.complex128))
    radius: Array = field(default_factory=lambda: np.empty(0))
    kinds: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    singular: list[End] = field(default_factory=list)
    moving: list[tuple[End, int]] = field(default_factory=list)
    infinite: int = 0
    unresolved: int = 0

    def add(self, x: Complex, radius: Array, kinds: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Takes in certified solutions; returns which of them (n,) were not there."""
        together = np.concatenate([self.x, x]), np.concatenate([self.radius, radius])
        doubles = np.zeros(len(together[0]), np.bool_)
        all_distinct(*together, doubles)
        new = ~doubles[len(self.x) :]
        self.x, self.radius = together[0][~doubles], together[1][~doubles]
        self.kinds = np.concatenate([self.kinds, kinds[new]])
        return new


@dataclass(frozen=True, eq=False)
class Problem:
    """A mechanism with leg lengths, in its frame, and where paths to it start.

    Attributes:
        base: (6, 3) base anchors [m].
        platform: (6, 3) platform anchors [m].
        lengths: (6,) [m].
        frame: of the coordinates.
        start: the mechanism with other lengths.
    """

    base: Array
    platform: Array
    lengths: Array
    frame: Frame
    start: LengthsStart

    @classmethod
    def of(cls, base: Array, platform: Array, lengths: Array) -> Problem:
        """Returns the problem with anchors (6, 3) and lengths (6,) [m]."""
        frame = Frame.of(base, platform, lengths)
        return cls(base, platform, lengths, frame, lengths_start(frame, base, platform))


def assembly_modes(mechanism: Mechanism, lengths: ArrayLike) -> AssemblyModes:
    """Returns every pose in which the legs have given lengths, each proven to exist.

    Paths are followed from all complex poses of the mechanism with generic complex lengths to those with the
    given ones, and every end is proven to be near one solution, which is real or is not. Where paths start is
    found out, once for a mechanism, by paths from a generic mechanism of which legs share anchors alike.
    Lengths that no pose has give an empty sequence. Length limits are not looked at.

    Args:
        mechanism: any hexapod.
        lengths: (6,) distances between the joint centres A_i and B_i [m].

    Raises:
        MotionError: lengths are not six finite numbers, or one is negative.
        InputError: `mechanism` is no `Mechanism`.
    """
    given = frozen(lengths, (6,), "lengths", MotionError)
    for leg, length in enumerate(given):
        if length < 0:
            raise MotionError(f"lengths[{leg}]", float(length), "at least 0 m")
    mechanism = mechanism_of(mechanism)
    return modes_of(mechanism.base_anchors, mechanism.platform_anchors, given)


def modes_of(base: Array, platform: Array, lengths: Array) -> AssemblyModes:
    """Returns every pose with leg lengths (6,) between anchors (6, 3) each [m]; see `assembly_modes`."""
    problem = Problem.of(base, platform, lengths)
    return _told(problem, findings(problem))


def findings(problem: Problem) -> Findings:
    """Returns what paths find."""
    found = _found(problem)
    if problem.start.doubtful:
        # paths from doubles end twice: that all of them are accounted for says nothing
        known = len(found.x) + found.infinite + len(found.singular) + len(found.moving)
        rest = problem.start.expected - known
        found.unresolved = max(rest, 1) if len(found.x) < problem.start.expected else 0
    return found


def _found(problem: Problem) -> Findings:
    found = Findings(unresolved=problem.start.unaccounted)
    start, legs = problem.start, problem.frame.legs
    missing = _attempt(problem, found, start.solutions, [start.legs, legs], Settings())
    if not len(missing):
        return found
    missing = _attempt(problem, found, start.solutions[missing], [start.legs, legs], CAREFUL, missing)
    if len(missing):
        _explain(problem, found, start.solutions[missing])
    if 0 < found.unresolved - start.unaccounted <= _MOST_PARTNERS:
        _seek_partners(problem, found, start.solutions[missing])
    for detour in DETOURS if found.unresolved > start.unaccounted else ():
        between = start.legs + detour * (legs - start.legs)
        _attempt(problem, found, start.solutions, [start.legs, between, legs], CAREFUL)
        known = len(found.x) + found.infinite + len(found.singular) + len(found.moving)
        found.unresolved = start.unaccounted + max(len(start.solutions) - known, 0)
        if found.unresolved == start.unaccounted:
            break
    return found


def _attempt(
    problem: Problem,
    found: Findings,
    solutions: Complex,
    stops: list[Complex],
    settings: Settings,
    numbers: NDArray[np.intp] | None = None,
) -> NDArray[np.intp]:
    """Follows paths along stops; returns the numbers of those that brought no new certified solution."""
    numbers = np.arange(len(solutions)) if numbers is None else numbers
    alive = np.arange(len(solutions))
    for one, other in pairwise(stops):
        paths = follow(one, other, solutions, settings)
        alive, solutions = alive[paths.arrived], paths.ends[paths.arrived]
    kinds, radius = certified(problem.frame, problem.frame.legs, solutions)
    proven = np.flatnonzero(kinds != UNPROVEN)
    new = found.add(solutions[proven], radius[proven], kinds[proven])
    return np.delete(numbers, alive[proven[new]])


def _explain(problem: Problem, found: Findings, solutions: Complex) -> None:
    """Finds out where paths end that brought no certified solution."""
    system = System.of(problem.frame.legs)
    for end in ends(problem.start.legs, problem.frame.legs, solutions):
        if end is None:
            found.unresolved += 1
        elif end.infinite:
            found.infinite += 1
        elif free := system.dimension(end.x):
            found.moving.append((end, free))
        elif not _prove(problem, found, end):
            if system.deficit(end.x):
                found.singular.append(end)
            else:
                found.unresolved += 1


def _seek_partners(problem: Problem, found: Findings, solutions: Complex) -> None:
    """Looks for unresolved solutions next to certified ones and where paths from `solutions` stop."""
    system = System.of(problem.frame.legs)
    stopped = follow(problem.start.legs, problem.frame.legs, solutions, CAREFUL).ends
    # a copy: more are found meanwhile. The lengths are real: with a solution its conjugate is one
    places = [x / np.linalg.norm(x) for x in (*stopped, *found.x)]
    apart = [x.conj() for x, kind in zip(found.x, found.kinds, strict=True) if kind == NOT_REAL]
    near = (one for x in places if paired(system, x) for one in candidates(system, x))
    for x in (*apart, *islice(near, _MOST_PLACES)):
        if found.unresolved == problem.start.unaccounted:
            return
        if _prove_at(problem, found, x):
            found.unresolved -= 1


def _prove(problem: Problem, found: Findings, end: End) -> bool:
    """Returns whether the end of a path is a solution that was new and could be certified."""
    return any(_prove_at(problem, found, x) for x in (end.near, end.x))


def _prove_at(problem: Problem, found: Findings, x: Complex) -> bool:
    """Returns whether Newton's method from x (8,) finds a solution that was new and could be certified."""
    from sixsps.assembly.exact import prove

    exact = prove(problem.base, problem.platform, problem.lengths, problem.frame, x)
    if exact is None or not exact.finite:
        return False
    kind = np.array([REAL if exact.real else NOT_REAL])
    return bool(found.add(exact.x[None], np.array([exact.radius]), kind).all())


def _told(problem: Problem, found: Findings) -> AssemblyModes:
    """Returns the poses among what was found."""
    real = found.kinds == REAL
    x = found.x[real].real
    position, quaternion, rotation = problem.frame.poses(x)
    position_radius, rotation_radius = problem.frame.radii(x, found.radius[real])
    order = np.lexsort(position.T)
    legs = position[:, None] + problem.platform @ rotation.transpose(0, 2, 1) - problem.base
    off = np.abs(np.sqrt(np.sum(legs**2, axis=-1)) - problem.lengths).max(axis=-1, initial=0)
    modes = AssemblyModes(
        position=_read_only(position[order]),
        quaternion=_read_only(quaternion[order]),
        rotation=_read_only(rotation[order]),
        residual=_read_only(off[order]),
        position_radius=_read_only(position_radius[order]),
        rotation_radius=_read_only(rotation_radius[order]),
        pattern=problem.start.general.pattern.name,
        expected=problem.start.expected,
        certified=len(found.x),
        always_at_infinity=problem.start.infinite,
        at_infinity=found.infinite,
        unresolved=found.unresolved,
        bound=MOST,
    )
    return _with_singular(problem, modes, found)


def _with_singular(problem: Problem, modes: AssemblyModes, found: Findings) -> AssemblyModes:
    given = problem.frame, problem.base, problem.platform, problem.lengths
    split = [x.astype(np.complex128) for x in nearly_real(*given, found.x[found.kinds == NOT_REAL])]
    if not (split or found.singular or found.moving):
        return modes
    isolated: list[SingularMode] = []
    moving: list[SingularMode] = []
    counts = [0, 0]
    for x, multiplicity, apart in _grouped(split, [end.x for end in found.singular]):
        if np.abs(x.imag).max() < _REAL:
            isolated.append(_singular_mode(problem, x.real, multiplicity, 0, apart))
        else:
            counts[0] += multiplicity
    system = System.of(problem.frame.legs)
    for end, free in found.moving:
        point = system.real_point(end.x, free)
        if point is None:
            counts[1] += 1
        else:
            moving.append(_singular_mode(problem, point, 1, free))
    return replace(
        modes,
        singular=tuple(isolated),
        non_isolated=tuple(moving),
        complex_singular=counts[0],
        complex_non_isolated=counts[1],
    )


def _grouped(split: list[Complex], singular: list[Complex]) -> list[tuple[Complex, int, int]]:
    """Returns the different ones of points (8,), how many there are of each, and how many are split."""
    groups: list[tuple[Complex, int, int]] = []
    for number, point in enumerate((*split, *singular)):
        # real ones turned real
        x = point * np.conj(point[np.argmax(np.abs(point))])
        x, one = x / np.linalg.norm(x), int(number < len(split))
        for k, (other, count, apart) in enumerate(groups):
            if abs(np.vdot(other, x)) > 1 - _SAME:
                groups[k] = (other, count + 1, apart + one)
                break
        else:
            groups.append((x, 1, one))
    return groups


def _singular_mode(problem: Problem, x: Array, multiplicity: int, free: int, split: int = 0) -> SingularMode:
    position, quaternion, _ = (array[0] for array in problem.frame.poses(x[None]))
    off = residual(problem.frame, problem.base, problem.platform, problem.lengths, x)
    return SingularMode(position, quaternion, off, multiplicity, free, split)


def _read_only(array: Array) -> Array:
    array.setflags(write=False)
    return array
