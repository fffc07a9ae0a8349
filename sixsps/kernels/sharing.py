"""Threads that take turns at the parts of one call."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from numbers import Integral
from threading import Thread
from typing import TypeVar

from sixsps.errors import InputError

_Result = TypeVar("_Result")


def shared(function: Callable[[int], _Result], starts: Sequence[int], threads: int) -> list[_Result]:
    """Returns what a function makes of each start, in any order; this thread and others take turns.

    The others live as long as the call: there is nothing to go wrong after a fork.
    """
    found: list[_Result] = []
    errors: list[BaseException] = []
    waiting = iter(starts)

    def work() -> None:
        try:
            for start in waiting:
                found.append(function(start))  # noqa: PERF401  threads extend no list at once
        except BaseException as error:
            errors.append(error)

    others = [Thread(target=work) for _ in range(min(threads, len(starts)) - 1)]
    for thread in others:
        thread.start()
    work()
    for thread in others:
        thread.join()
    if errors:
        raise errors[0]
    return found


def thread_count(given: int | None) -> int:
    """Returns a number of threads, that of the processors by default.

    Raises:
        InputError: not a positive whole number.
    """
    if given is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if isinstance(given, bool) or not isinstance(given, Integral) or given < 1:
        raise InputError("threads", given, "a positive whole number, or None for every processor")
    return int(given)
