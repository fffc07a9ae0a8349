"""Which legs share anchors: the classes of hexapods, and the one that a mechanism belongs to.

Legs are the edges of a graph between base and platform anchors (Faugère & Lazard, "Combinatorial classes
of parallel manipulators", Mechanism and Machine Theory 30, 1995, 765-776). Two mechanisms are of one class
where the graphs are, in any order of the legs and with base and platform exchanged.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import permutations, product
from typing import Any

import numpy as np

from sixsps.arrays import Array

Labels = tuple[int, ...]
_ORDERS = tuple(permutations(range(6)))


@dataclass(frozen=True)
class Pattern:
    """A class of mechanisms: the number of each leg's anchor on either side, numbered as they come first.

    Attributes:
        base: six numbers.
        platform: six numbers.
    """

    base: Labels
    platform: Labels

    @property
    def name(self) -> str:
        """Numbers of different anchors as the literature writes them, the larger first: 6-3."""
        counts = sorted((len(set(self.base)), len(set(self.platform))), reverse=True)
        return "-".join(map(str, counts))


@dataclass(frozen=True)
class Relabelling:
    """How a mechanism becomes its class's representative.

    Attributes:
        pattern: of the class.
        order: leg `order[k]` of the mechanism is leg k of the representative.
        exchanged: whether the representative's base is the mechanism's platform.
    """

    pattern: Pattern
    order: Labels
    exchanged: bool


def numbered(labels: Any) -> Labels:
    """Returns six labels as numbers, in the order in which they come first."""
    numbers: dict[Any, int] = {}
    return tuple(numbers.setdefault(label, len(numbers)) for label in labels)


def shared(anchors: Array) -> Labels:
    """Returns which of the anchors (6, 3) are the same points."""
    return numbered(tuple(anchor) for anchor in (anchors + 0.0).tolist())  # -0.0 is 0.0


@lru_cache(maxsize=256)
def relabelling(base: Labels, platform: Labels) -> Relabelling:
    """Returns how legs with these anchors become the representative of their class.

    Args:
        base: six numbers, as `shared` gives them.
        platform: six numbers.
    """
    (first, second), order, exchanged = min(_relabelled(base, platform))
    return Relabelling(Pattern(first, second), order, exchanged)


def _relabelled(base: Labels, platform: Labels) -> Iterator[tuple[tuple[Labels, Labels], Labels, bool]]:
    """Yields the labels in every order of the legs and in both roles."""
    for exchanged, (a, b) in ((False, (base, platform)), (True, (platform, base))):
        for order in _ORDERS:
            yield (numbered(a[k] for k in order), numbered(b[k] for k in order)), order, exchanged


@cache
def every_pattern() -> tuple[Pattern, ...]:
    """Returns the classes of six legs no two of which share both anchors, in order."""
    partitions = list(_partitions((), 0))
    shapes = {tuple(sorted(np.bincount(labels))): labels for labels in partitions}
    found, seen = [], set()
    for pair in product(shapes.values(), partitions):
        if len(set(zip(*pair, strict=True))) == 6 and pair not in seen:
            same = {labels for labels, _, _ in _relabelled(*pair)}
            seen |= same
            found.append(Pattern(*min(same)))
    return tuple(sorted(found, key=lambda pattern: (pattern.base, pattern.platform)))


def _partitions(start: Labels, used: int) -> list[Labels]:
    if len(start) == 6:
        return [start]
    return [
        whole for label in range(used + 1) for whole in _partitions((*start, label), max(used, label + 1))
    ]
