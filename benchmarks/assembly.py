"""All assembly modes: time, residuals, and whether the pose that the lengths were made from is among them.

`python -m benchmarks.assembly` prints a table; a first call is one for a mechanism that was not seen before,
a warm one the next for the same mechanism. Poses, not times, are what `missed` counts.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from sixsps.arrays import Array
from sixsps.assembly.frame import rotations
from sixsps.assembly.modes import AssemblyModes
from sixsps.assembly.patterns import Pattern
from sixsps.assembly.solve import modes_of
from sixsps.assembly.start_systems import start_systems
from sixsps.home import home_position
from sixsps.mechanism import Mechanism

# A pose further from the one that the lengths were made from is another.
_SAME = 1e-6
_SEED = 20260601
_COLUMNS = (
    "| platforms | n | missed | proof | real: mean, most | residual | radius | first call | warm call |"
)


@dataclass(frozen=True, eq=False)
class Case:
    """A mechanism with the lengths of a known pose.

    Attributes:
        base: (6, 3) base anchors.
        platform: (6, 3) platform anchors.
        position: (3,) of the pose.
        rotation: (3, 3) of the pose.
    """

    base: Array
    platform: Array
    position: Array
    rotation: Array

    @property
    def lengths(self) -> Array:
        """(6,) leg lengths at the pose."""
        legs = self.position + self.platform @ self.rotation.T - self.base
        return np.asarray(np.linalg.norm(legs, axis=1))

    def modes(self) -> tuple[AssemblyModes, float]:
        """Returns the poses and how long that took [s]."""
        lengths = self.lengths
        start = time.perf_counter()
        modes = modes_of(self.base, self.platform, lengths)
        return modes, time.perf_counter() - start

    def is_among(self, modes: AssemblyModes) -> bool:
        """Whether the known pose was found."""
        apart = np.linalg.norm(modes.position - self.position, axis=1)
        apart = apart + np.abs(modes.rotation - self.rotation).max(axis=(1, 2), initial=0)
        return bool(apart.min(initial=np.inf) < _SAME * (1 + np.abs(self.base).max()))


@dataclass(eq=False)
class Tally:
    """What came out of many cases."""

    count: int = 0
    missed: int = 0
    proofs: Counter[str] = field(default_factory=Counter)
    real: list[int] = field(default_factory=list)
    residual: float = 0.0
    radius: float = 0.0
    first: list[float] = field(default_factory=list)
    warm: list[float] = field(default_factory=list)

    def add(self, case: Case) -> None:
        """Solves a case twice."""
        modes, first = case.modes()
        _, warm = case.modes()
        self.count += 1
        self.missed += not case.is_among(modes)
        self.proofs[modes.proof] += 1
        self.real.append(len(modes))
        self.residual = max(self.residual, modes.residual.max(initial=0.0))
        self.radius = max(self.radius, modes.position_radius.max(initial=0.0))
        self.first.append(first)
        self.warm.append(warm)

    def row(self, name: str) -> str:
        """Returns a line of the table."""
        proofs = ", ".join(f"{proof} {count}" for proof, count in self.proofs.most_common())
        real = f"{np.mean(self.real):.1f}, {max(self.real)}"
        errors = f"{self.residual:.1e} | {self.radius:.1e}"
        times = " | ".join(
            f"{1e3 * np.median(one):.2f} ms, at most {1e3 * max(one):.1f}" for one in (self.first, self.warm)
        )
        return f"| {name} | {self.count} | {self.missed} | {proofs} | {real} | {errors} | {times} |"


def random_case(random: np.random.Generator, pattern: Pattern | None = None, flat: int = 0) -> Case:
    """Returns a random mechanism of size one in a random pose.

    Args:
        random: source of numbers.
        pattern: which legs share anchors; none where it is left out.
        flat: how many of base and platform are planar.
    """
    base, platform = random.uniform(-1, 1, (2, 6, 3))
    if pattern:
        base, platform = base[list(pattern.base)], platform[list(pattern.platform)]
    for side in (base, platform)[:flat]:
        side[:, 2] = 0
    quaternion = random.standard_normal((1, 4))
    rotation = rotations(quaternion / np.linalg.norm(quaternion))[0]
    return Case(base, platform, random.uniform(-1, 1, 3), rotation)


def workspace_case(mechanism: Mechanism, random: np.random.Generator) -> Case:
    """Returns a bundled mechanism in a random pose with lengths within its limits."""
    home, size = home_position(mechanism), mechanism.characteristic_length
    low, high = mechanism.length_limits.T
    while True:
        quaternion = np.array([[1, *0.3 * random.standard_normal(3)]])
        rotation = rotations(quaternion / np.linalg.norm(quaternion))[0]
        position = home + size * random.uniform(-1, 1, 3)
        case = Case(mechanism.base_anchors, mechanism.platform_anchors, position, rotation)
        if np.all((case.lengths > low) & (case.lengths < high)):
            return case


def dietmaier_case(_: np.random.Generator) -> Case:
    """Returns Dietmaier's platform, in the first of its 40 poses."""
    mechanism = Mechanism.load("dietmaier1998")
    lengths = np.array([1.0, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071])
    modes = modes_of(mechanism.base_anchors, mechanism.platform_anchors, lengths)
    return Case(mechanism.base_anchors, mechanism.platform_anchors, modes.position[0], modes.rotation[0])


def sections(count: int) -> Iterator[tuple[str, int, Callable[[np.random.Generator], Case]]]:
    """Yields what is measured: its name, how many cases, and what makes one."""
    yield "Dietmaier (1998)", 30, dietmaier_case
    yield "general", count, random_case
    yield "planar base", count, partial(random_case, flat=1)
    yield "both planar", count, partial(random_case, flat=2)
    shared = [pattern for pattern in start_systems() if pattern.name != "6-6"]
    yield (
        f"shared anchors, {len(shared)} classes",
        count,
        lambda random: random_case(random, shared[random.integers(len(shared))]),
    )
    for name in ("wu2012", "tsai2000", "taghirad2013"):
        yield name, count, partial(workspace_case, Mechanism.load(name))


def table(count: int) -> Iterator[str]:
    """Yields the lines of the table.

    Args:
        count: cases of every kind.
    """
    yield _COLUMNS
    yield "|---" * (_COLUMNS.count("|") - 1) + "|"
    for name, number, made in sections(count):
        random, tally = np.random.default_rng(_SEED), Tally()
        for _ in range(number):
            tally.add(made(random))
        yield tally.row(name)


def main() -> int:
    """Prints the table; 1 where a pose was missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.assembly", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="mechanisms of every kind")
    missed = False
    for line in table(parser.parse_args().count):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
        cells = line.split("|")
        missed |= cells[3].strip().isdigit() and int(cells[3]) > 0
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
