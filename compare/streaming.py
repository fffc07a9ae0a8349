"""Motions of any length, block by block: read, calculated and written at the same time, in bounded memory."""

from __future__ import annotations

import ctypes
import sys
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from compare.inputs import Block, Motions
from compare.metrics import finite_or_none
from compare.runner import Watcher
from compare.single import Calculated, Calculation
from compare.summary import singular_lines
from sixsps.table_stream import writing

Item = TypeVar("Item")
Result = TypeVar("Result")
# Singular samples that are told one by one.
_TOLD = 5
# Reading goes on while a block is waited for; calculating goes on while a row group is written.
_READ_AHEAD, _CALCULATED_AHEAD = 2, 8
# M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's malloc.h [bytes].
_MALLOPT = {-1: 1 << 28, -3: 1 << 25}


class SingularSamples:
    """The singular samples of a motion: how many there are, and the first few."""

    def __init__(self) -> None:
        self.number = 0
        self._first: list[dict[str, Any]] = []

    def add(self, result: Calculated, start: int) -> None:
        """Adds those of a block whose first sample is `start`."""
        told = slice(0, _TOLD - len(self._first))
        for index, condition in zip(result.singular[told], result.condition[told], strict=True):
            time = float(result.columns["t"][index])
            sample = {"sample": start + int(index) + 1, "t": time}
            self._first.append(sample | {"condition": finite_or_none(float(condition))})
        self.number += len(result.singular)

    def lines(self) -> list[str]:
        """Returns what the user has to be told, nothing where there are none."""
        others = self.number - len(self._first)
        return singular_lines(self._first) + ([f"and {others} more singular samples"] if others else [])


def stream(motions: Motions, calculation: Calculation, output: Path, watch: Watcher) -> SingularSamples:
    """Writes the results of a calculation along a motion, with its times, as CSV or Parquet.

    Args:
        motions: the motion.
        calculation: what is to be done with it.
        output: file to write, ending in .csv or .parquet; unless all goes well it stays as it is.
        watch: told how it gets on.

    Raises:
        MotionError: a block of the motion is not valid.
        OutputError: `output` cannot be written.
        EngineUnavailable: the library of the engine is missing.
        EngineError: it failed.
    """
    singular, done = SingularSamples(), 0
    try:
        results = _results(motions, calculation, watch)
        with writing(output, calculation.names) as append, closing(results):
            for result in results:
                append(result.columns)
                singular.add(result, done)
                done += len(result.columns["t"])
                watch(calculation.name, "running", done)
    except _CalculationError as error:
        raise error.reason from None
    return singular


def _keep_freed_memory() -> None:
    """Lets glibc keep what a block has freed for the next; a fifth of the time went into giving it back."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            mallopt = ctypes.CDLL(None).mallopt
            for parameter, size in _MALLOPT.items():
                mallopt(parameter, size)


class _CalculationError(Exception):
    """Carries an OSError or ValueError past the writing of a file, which would take it for its own."""

    def __init__(self, reason: Exception) -> None:
        super().__init__(reason)
        self.reason = reason


def _results(motions: Motions, calculation: Calculation, watch: Watcher) -> Generator[Calculated, None, None]:
    blocks = ahead(motions.blocks(calculation.block), _READ_AHEAD)
    if calculation.threads:
        _keep_freed_memory()
        of_block = partial(_result, calculation, watch)
        results = ahead(in_order(of_block, blocks, calculation.threads), _CALCULATED_AHEAD)
    else:
        results = _one_by_one(calculation, blocks, watch)
    try:
        with closing(results):
            yield from results
    except (OSError, ValueError) as error:
        raise _CalculationError(error) from error


def _result(calculation: Calculation, watch: Watcher, block: Block) -> Calculated:
    return calculation.calculate(block(), watch)


def _one_by_one(
    calculation: Calculation, blocks: Generator[Block, None, None], watch: Watcher
) -> Generator[Calculated, None, None]:
    before = 0

    def further(engine: str, state: str, done: int) -> None:
        watch(engine, "running" if state == "ok" else state, before + done)

    with closing(blocks):
        for block in blocks:
            result = _result(calculation, further, block)
            yield result
            before += len(result.columns["t"])


def in_order(
    function: Callable[[Item], Result], items: Generator[Item, None, None], threads: int
) -> Generator[Result, None, None]:
    """Yields what `function` makes of each item, in their order, worked out by some threads.

    Of the items no more are taken than the threads need to have something to do.
    """
    pool = ThreadPoolExecutor(threads)
    pending: deque[Future[Result]] = deque()
    try:
        for item in items:
            pending.append(pool.submit(function, item))
            if len(pending) > threads + 1:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
        items.close()


def ahead(items: Generator[Item, None, None], number: int) -> Generator[Item, None, None]:
    """Yields `items`, which a thread of its own takes, up to `number` of them before they are asked for."""
    thread = ThreadPoolExecutor(1)
    end = object()
    try:
        pending: deque[Future[Any]] = deque(thread.submit(next, items, end) for _ in range(number))
        while (item := pending.popleft().result()) is not end:
            pending.append(thread.submit(next, items, end))
            yield item
    finally:
        thread.shutdown(cancel_futures=True)
        items.close()
