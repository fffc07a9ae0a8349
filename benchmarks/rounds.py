"""Contestants timed turn by turn: A B C A B C, so that what disturbs the machine disturbs all alike."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil
from time import perf_counter
from typing import Any

Progress = Callable[[str], None]
"""Told what is being measured."""


@dataclass(frozen=True)
class Contestant:
    """One of several that are timed against each other.

    Attributes:
        name: of its row.
        units: samples, operations or bytes that one pass does.
        run: one pass.
    """

    name: str
    units: float
    run: Callable[[], Any]


def interleaved(
    contestants: Sequence[Contestant], rounds: int, turn: float, progress: Progress
) -> dict[str, list[float]]:
    """Times contestants in rounds.

    Each has two turns that do not count: one for what is done once, one to see how many passes fill a turn.

    Args:
        contestants: with names that differ.
        rounds: number of turns of each.
        turn: seconds that a turn takes at least.
        progress: told the round.

    Returns:
        Name -> nanoseconds per unit in each round.
    """
    passes = {}
    for one in contestants:
        one.run()
        passes[one.name] = max(1, ceil(turn / seconds(one.run, 1)))
    times: dict[str, list[float]] = {one.name: [] for one in contestants}
    for number in range(rounds):
        progress(f"round {number + 1} of {rounds}")
        with undisturbed():
            for one in contestants:
                count = passes[one.name]
                times[one.name].append(1e9 * seconds(one.run, count) / (count * one.units))
    return times


def seconds(run: Callable[[], Any], passes: int) -> float:
    """Returns how long so many passes take."""
    start = perf_counter()
    for _ in range(passes):
        run()
    return perf_counter() - start


@contextmanager
def undisturbed() -> Iterator[None]:
    """Keeps Python from collecting garbage meanwhile, as the module timeit does."""
    gc.collect()
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
