"""Engines x motion: each engine in a process of its own, with a time limit."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from compare.registry import PAYLOAD_ENGINES, Entry, check_installed, check_names, entry
from compare.worker import ENGINE, FORCES, JOB, PROGRESS, STATUS
from sixsps.arrays import Array
from sixsps.errors import EngineUnavailable
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

if TYPE_CHECKING:
    from compare.payload.ride import Ride

START_LIMIT_S = 60.0
LONGEST_LIMIT_S = 1e6
_BASE_LIMIT_S, _LIMIT_PER_SAMPLE_S = 120.0, 0.01
_POLL_S = 0.01
_SLOW_START_S = 10.0
# One thread each, so that a time per sample is the time of one core.
_THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(eq=False)
class Outcome:
    """How one engine's run ended.

    Attributes:
        engine: name.
        status: "ok", "failed" or "unavailable".
        reason: why not, when not "ok".
        facts: version, formulation, loops and shares, as far as the engine got to say them.
        seconds: time for all samples, without start and loading [s].
        forces: (n, 6) [N], NaN at samples that were not given to the engine; None unless "ok".
        closure_residual: (n,) [N, N m] or None; see `EngineForces`.
        closure_error: (n,) [m] or None; see `EngineForces`.
    """

    engine: str
    status: str
    reason: str = ""
    facts: dict[str, str] = field(default_factory=dict)
    seconds: float | None = None
    forces: Array | None = None
    closure_residual: Array | None = None
    closure_error: Array | None = None


Watcher = Callable[[str, str, int], None]
"""Called with engine, state ("starting", "running" or a final status) and samples done."""


def run(
    engines: Sequence[str],
    mechanism: Mechanism,
    motion: Motion,
    regular: NDArray[np.bool_],
    *,
    legs: Legs = Legs.sps,
    time_limit: float | None = None,
    watch: Watcher = lambda *_: None,
    ride: Ride | None = None,
) -> list[Outcome]:
    """Computes the forces of every engine.

    Args:
        engines: names, all known to the registry.
        mechanism: geometry and inertia.
        motion: n samples.
        regular: (n,) bool; only these samples are given to the engines, the others' forces are NaN.
        legs: joints of the engines' legs.
        time_limit: for one engine's computation [s]; by default 2 min and 10 ms a sample.
        watch: told of every change.
        ride: n samples, for the engines that take a robot as it is; the motion has its wrench.

    Returns:
        One outcome an engine, in the order of `engines`; nothing that happens in an engine's
        process raises here.

    Raises:
        UnknownNameError: an engine that takes a robot, and no robot.
    """
    check_names([name for name in engines if name in PAYLOAD_ENGINES], robot=ride is not None)
    if not regular.any():
        return [_nothing_to_do(outcome, len(motion)) for outcome in probe(engines, legs)]
    given = motion[regular]
    given.rotation  # noqa: B018  computed once, here, and handed on with the motion
    jobs = dict.fromkeys(engines, pickle.dumps((mechanism, given)))
    if ride is not None:
        jobs |= dict.fromkeys(PAYLOAD_ENGINES, pickle.dumps((ride.carrier, ride[regular])))
    limit = _BASE_LIMIT_S + _LIMIT_PER_SAMPLE_S * len(motion) if time_limit is None else time_limit
    outcomes = _run_all(engines, legs, jobs, limit, watch)
    for outcome in outcomes:
        _spread(outcome, regular)
        _refuse_nonsense(outcome, motion, regular)
    return outcomes


def probe(engines: Sequence[str], legs: Legs = Legs.sps) -> list[Outcome]:
    """Returns, without computing anything, whether each engine is there and which version it is."""
    return _run_all(engines, legs, {}, START_LIMIT_S, lambda *_: None)


def _nothing_to_do(outcome: Outcome, samples: int) -> Outcome:
    if outcome.status == "ok":
        outcome.forces = np.full((samples, 6), np.nan)
    return outcome


class _Process:
    """A worker and the folder through which it talks."""

    def __init__(self, engine: str, place: Entry, folder: Path, job: bytes | None) -> None:
        self.engine, self.folder = engine, folder
        asked = {"name": engine, "entry": asdict(place)}
        (folder / ENGINE).write_text(json.dumps(asked))
        if job is not None:
            (folder / JOB).write_bytes(job)
        environment = os.environ | _THREADS | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        with (folder / "log").open("wb") as log:
            self.process = subprocess.Popen(  # noqa: S603  this program's own module
                [sys.executable, "-P", "-m", "compare.worker", str(folder)],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,  # so that whatever it starts ends with it
            )
        self.since = time.monotonic()
        self.state = "starting"

    def status(self) -> dict[str, Any]:
        path = self.folder / STATUS
        return json.loads(path.read_text()) if path.exists() else {"state": "starting"}

    def done(self) -> int:
        path = self.folder / PROGRESS
        text = path.read_text() if path.exists() else ""
        return int(text or 0)

    def go(self) -> None:
        self.state, self.since = "running", time.monotonic()
        if self.process.stdin:
            with suppress(OSError):  # where it died, the next look at the process says so
                self.process.stdin.write(b"go\n")
                self.process.stdin.flush()

    def stop(self) -> None:
        if hasattr(os, "killpg"):
            with suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)
        if self.process.poll() is None:
            self.process.kill()
        if self.process.stdin:
            with suppress(OSError):
                self.process.stdin.close()
        self.process.wait()


def _run_all(
    engines: Sequence[str], legs: Legs, jobs: Mapping[str, bytes], time_limit: float, watch: Watcher
) -> list[Outcome]:
    outcomes: dict[str, Outcome] = {}
    with ExitStack() as stack:
        processes = []
        for engine in engines:
            try:
                place = entry(engine, legs)
                check_installed(engine, place)
            except EngineUnavailable as error:
                outcomes[engine] = Outcome(engine, "unavailable", error.detail)
                continue
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="sixsps-")))
            process = _Process(engine, place, folder, jobs.get(engine))
            stack.callback(process.stop)
            processes.append(process)
            watch(engine, "starting", 0)
        waiting = list(processes)
        while waiting:
            for process in list(waiting):
                outcome = _look(process, time_limit)
                if outcome is not None:
                    waiting.remove(process)
                    outcomes[process.engine] = outcome
                    watch(process.engine, outcome.status, process.done())
                elif process.state == "running":
                    watch(process.engine, "running", process.done())
            _start_next(waiting)
            time.sleep(_POLL_S)
    return [outcomes[engine] for engine in engines]


def _start_next(waiting: list[_Process]) -> None:
    """Lets one process compute when none does, and none is busy starting: timings are undisturbed.

    A start that takes much longer than any import does not hold the others up.
    """
    now = time.monotonic()
    for process in waiting:
        starts = process.state == "starting" and now - process.since < _SLOW_START_S
        if starts or process.state == "running":
            return
    ready = [process for process in waiting if process.state == "ready"]
    if ready:
        ready[0].go()


def _look(process: _Process, time_limit: float) -> Outcome | None:
    """Returns the outcome of a process that has ended or has to be ended."""
    ended = process.process.poll()
    status = process.status()
    if status["state"] in ("done", "failed", "unavailable"):
        return _outcome(process, status)
    if ended is not None:
        return Outcome(process.engine, "failed", _cause_of_death(process, ended))
    if status["state"] == "ready" and process.state == "starting":
        process.state = "ready"
    limit = time_limit if process.state == "running" else START_LIMIT_S
    if process.state != "ready" and time.monotonic() - process.since > limit:
        process.stop()
        doing = "computing" if process.state == "running" else "starting"
        return Outcome(process.engine, "failed", f"time limit: still {doing} after {limit:g} s")
    return None


def _outcome(process: _Process, status: dict[str, Any]) -> Outcome:
    # A message may hold what no file can: half of a surrogate pair.
    status = {key: _encodable(value) if isinstance(value, str) else value for key, value in status.items()}
    state, reason = status.pop("state"), " ".join(status.pop("reason", "").split())
    seconds = status.pop("seconds", None)
    if state != "done":
        return Outcome(process.engine, state, reason, status)
    outcome = Outcome(process.engine, "ok", "", status, seconds)
    if (process.folder / FORCES).exists():
        with np.load(process.folder / FORCES) as arrays:
            outcome.forces = arrays["forces"]
            outcome.closure_residual = arrays.get("closure_residual")
            outcome.closure_error = arrays.get("closure_error")
    return outcome


def _encodable(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _signal_name(number: int) -> str:
    with suppress(ValueError):
        return signal.Signals(number).name
    return f"signal {number}"


def _cause_of_death(process: _Process, code: int) -> str:
    cause = f"killed by {_signal_name(-code)}" if code < 0 else f"exited with status {code}"
    log = (process.folder / "log").read_text(errors="replace").split("\n")
    last = next((line for line in reversed(log) if line.strip()), "")
    return f"its process {cause}" + (f": {last.strip()[:200]}" if last else "")


def _spread(outcome: Outcome, regular: NDArray[np.bool_]) -> None:
    for name in ("forces", "closure_residual", "closure_error"):
        values = getattr(outcome, name)
        if values is not None and len(values) == np.count_nonzero(regular):
            full = np.full((len(regular), *values.shape[1:]), np.nan)
            full[regular] = values
            setattr(outcome, name, full)


def _refuse_nonsense(outcome: Outcome, motion: Motion, regular: NDArray[np.bool_]) -> None:
    """Turns an "ok" with forces that are none into "failed"."""
    if outcome.status != "ok":
        return
    forces = outcome.forces
    if forces is None or forces.shape != (len(motion), 6):
        found = "none" if forces is None else f"an array of shape {forces.shape}"
        outcome.status, outcome.reason = "failed", f"gave {found}, not ({len(motion)}, 6) forces"
    elif not np.isfinite(forces[regular]).all():
        sample, leg = np.argwhere(~np.isfinite(forces) & regular[:, None])[0]
        time_s = motion.time[sample]
        outcome.status = "failed"
        outcome.reason = f"the force of leg {leg + 1} at t = {time_s:g} s is not a number"
    if outcome.status == "failed":
        outcome.forces = None
