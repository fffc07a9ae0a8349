"""Memory of one batch: how far the resident set of a process of its own rises above what it began with.

`python -m benchmarks.memory NAME SAMPLES` is that process. What counts begins when motion and candidate
are there and a few samples have been computed, so that it is the batch and not the library.
"""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.candidates import Missing, build, of_arrays
from benchmarks.plan import MECHANISM, MOTION, Plan
from benchmarks.rounds import Progress
from benchmarks.workers import processors
from sixsps.mechanism import Mechanism
from sixsps.trajectories import bundled

_FEW = 16
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def measure(plan: Plan, rows: list[dict[str, Any]], progress: Progress) -> dict[str, Any]:
    """Returns the entry `memory` of the results.

    Args:
        plan: how many samples.
        rows: of the batch; what goes over its samples one by one needs no memory to speak of.
        progress: told how many.
    """
    asked = [row for row in rows if row["name"] in of_arrays()]
    progress(f"{len(asked)} processes, of one batch each")
    # Side by side: nothing is timed.
    with ThreadPoolExecutor(processors()) as pool:
        return {"rows": list(pool.map(partial(_row, plan), asked))}


def _row(plan: Plan, row: dict[str, Any]) -> dict[str, Any]:
    if "reason" in row:
        return {"name": row["name"], "reason": row["reason"]}
    samples = plan.memory[row["pace"]]
    command = [sys.executable, "-m", "benchmarks.memory", row["name"], str(samples)]
    done = subprocess.run(command, capture_output=True, text=True)  # noqa: S603  this program
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"it ended with status {done.returncode}"]
        return {"name": row["name"], "reason": lines[-1]}
    return {"name": row["name"], "samples": samples} | json.loads(done.stdout.splitlines()[-1])


def batch_memory(name: str, samples: int) -> dict[str, int]:
    """Returns resident bytes before a batch, and the most during it; to be called in a fresh process.

    Raises:
        OSError: the system does not tell.
    """
    mechanism = Mechanism.load(MECHANISM)
    motion = bundled(MOTION, mechanism, samples)
    motion.rotation  # noqa: B018  as in the batch, made before
    found = build(name, mechanism, motion[:_FEW])
    if isinstance(found, Missing):
        raise OSError(found.reason)
    found.prepare(motion[:_FEW])()
    run = found.prepare(motion)
    _give_back()
    _RESET.write_text("5")  # the peak is from now on
    before = _resident("VmRSS")
    run()
    return {"before": before, "peak": _resident("VmHWM")}


def _give_back() -> None:
    """Has freed memory handed to the system, where there is glibc: a batch must not find it lying about."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def _resident(key: str) -> int:
    lines = _STATUS.read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(f"{key}:"))


if __name__ == "__main__":
    sys.stdout.write(json.dumps(batch_memory(sys.argv[1], int(sys.argv[2]))) + "\n")
