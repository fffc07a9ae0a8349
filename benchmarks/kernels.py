"""Each kernel beside what the arithmetic and the memory of this machine allow.

A kernel is timed twice: on arrays that stay in the second cache, where arithmetic decides, and on arrays
as long as those of the triad, where memory may. The loops of `arithmetic.py` and `bandwidth.py` have their
turn in the same rounds, on as many threads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.bandwidth import Triad
from benchmarks.batch import peaks
from benchmarks.machine import last_cache
from benchmarks.naming import CACHE, MEMORY, TRIAD, on_threads
from benchmarks.plan import Plan
from benchmarks.rounds import Contestant, Progress, interleaved
from benchmarks.states import States, long_motion
from benchmarks.workers import Workers, thread_counts
from sixsps.arrays import Array
from sixsps.kernels.compiled import kernel
from sixsps.kernels.emission import CAPACITY
from sixsps.kernels.graph import graph
from sixsps.kernels.signatures import EQUATIONS, FORCE_DERIVATIVES, FORCES, LEG_MOTION, Signature
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.parameters import parameter_vector

Loop = Callable[[int, int], Any]
"""From a sample to the one before another."""

KERNELS = (FORCES, EQUATIONS, LEG_MOTION, FORCE_DERIVATIVES)
# Half of the second cache of small processors.
_IN_CACHE = 256 * 2**10


def row_name(signature: Signature, place: str, threads: int) -> str:
    """Returns the name of the row of a kernel."""
    return on_threads(f"{signature.name}, {place}", threads)


def bytes_of(signature: Signature) -> int:
    """Returns bytes read and written a sample."""
    return 8 * (sum(signature.arrays.values()) + sum(signature.sizes.values()))


def measure(plan: Plan, states: States, progress: Progress) -> dict[str, Any]:
    """Returns the entry `kernels` of the results."""
    progress("setting up")
    workers = {count: Workers(count) for count in (thread_counts()[0], thread_counts()[-1])}
    triad = Triad(plan.beyond_cache)
    contestants = peaks()
    contestants += [
        Contestant(on_threads(TRIAD, n), triad.bytes, partial(triad.run, w)) for n, w in workers.items()
    ]
    rows = []
    largest = int(plan.beyond_cache * last_cache())
    lengths = {CACHE: _IN_CACHE, MEMORY: largest}
    motion = long_motion(states.mechanism, largest // min(map(bytes_of, KERNELS)))
    for signature in KERNELS:
        for place, size in lengths.items():
            # In the cache every thread has a part of that size, and goes over it again and again.
            samples_of = {n: size // bytes_of(signature) * (n if place == CACHE else 1) for n in workers}
            one = loop(signature, states.mechanism, motion[: max(samples_of.values())])
            passes = largest // size
            for threads, samples in samples_of.items():
                run = partial(workers[threads].share, repeated(one, passes), samples)
                name = row_name(signature, place, threads)
                contestants.append(Contestant(name, passes * samples, run))
                rows.append({"name": name, "kernel": signature.name, "place": place,
                             "threads": threads, "samples": samples})  # fmt: skip
    times = interleaved(contestants, plan.rounds, plan.turn, progress)
    for row in rows:
        row["ns_per_sample"] = times.pop(str(row["name"]))
    return {
        "rows": rows,
        "ns_per_unit": times,
        "counts": {one.name: counts(one) for one in KERNELS},
        "triad_array_bytes": triad.a.nbytes,
    }


def counts(signature: Signature) -> dict[str, Any]:
    """Returns operations by kind, floating-point operations and bytes of one sample."""
    found = graph(signature.name)
    return {
        "operations": dict(found.operations.most_common()),
        "flops": found.flops,
        "bytes": bytes_of(signature),
    }


def repeated(one: Loop, passes: int) -> Loop:
    """Returns a loop that is another one several times over."""

    def several(start: int, stop: int) -> None:
        for _ in range(passes):
            one(start, stop)

    return several


def loop(signature: Signature, mechanism: Mechanism, motion: Motion) -> Loop:
    """Returns a loop that evaluates a kernel and writes into arrays that are there."""
    one = kernel(signature)
    fixed = np.empty(CAPACITY)
    one.prepare(parameter_vector(mechanism), fixed)
    given = tuple(np.ascontiguousarray(getattr(motion, name)) for name in signature.arrays)
    found: tuple[Array, ...] = tuple(np.zeros((len(motion), size)) for size in signature.sizes.values())
    return partial(one.batch, given, fixed, found)
