"""One engine in a process of its own: `python -m compare.worker FOLDER`.

The folder is the whole interface. In: `engine.json`, name and registry entry, and `job.pickle`,
where there is something to compute. Out:
`status.json` (state, reason, version), `progress` (samples done) and `forces.npz`. Whatever an
engine prints goes elsewhere. When ready it waits for a line on standard input, so that engines
start side by side and are timed one after the other.
"""

from __future__ import annotations

import json
import pickle
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from compare.engine import Engine
from compare.registry import Entry, load_entry
from sixsps.arrays import Array
from sixsps.errors import EngineError, EngineUnavailable, SixspsError

ENGINE, JOB = "engine.json", "job.pickle"
STATUS, PROGRESS, FORCES = "status.json", "progress", "forces.npz"


def main(folder: Path) -> None:
    """Runs the engine on the job in `folder`, leaving the outcome in `status.json`."""
    try:
        asked = json.loads((folder / ENGINE).read_text())
        _run(load_entry(asked["name"], Entry(**asked["entry"])), folder)
    except EngineUnavailable as error:
        _report(folder, state="failed" if error.broken else "unavailable", reason=error.detail)
    except SixspsError as error:
        _report(folder, state="failed", reason=str(error))
    except Exception as error:  # the library's own error is the reason, whatever it is
        _report(folder, state="failed", reason=f"{type(error).__name__}: {error}")


def _run(engine: type[Engine], folder: Path) -> None:
    facts = {
        "version": str(engine.version()),
        "formulation": str(engine.formulation),
        "loops": str(engine.loops),
        "shares": str(engine.shares),
    }
    job = folder / JOB
    if not job.exists():
        _report(folder, state="done", **facts)
        return
    mechanism, motion = pickle.loads(job.read_bytes())  # noqa: S301  written by the runner
    model = engine(mechanism)
    _report(folder, state="ready", **facts)
    if not sys.stdin.readline():
        return  # the runner is gone
    progress = folder / PROGRESS

    def note(done: int) -> None:
        progress.write_text(str(int(done)))

    start = time.perf_counter()
    result = model.inverse_dynamics(motion, note)
    seconds = time.perf_counter() - start
    optional = {"closure_residual": result.closure_residual, "closure_error": result.closure_error}
    n = len(motion)
    given = {name: _numbers(value, (n,), name) for name, value in optional.items() if value is not None}
    np.savez(folder / FORCES, allow_pickle=False, forces=_numbers(result.forces, (n, 6), "forces"), **given)
    _report(folder, state="done", seconds=seconds, **facts)


def _numbers(value: Any, shape: tuple[int, ...], name: str) -> Array:
    array = np.asarray(value)
    if array.shape != shape or array.dtype.kind not in "fiu":
        found = f"{array.dtype} array of shape {array.shape}"
        raise EngineError(f"gave {name} as {found}, not {shape} numbers")
    return array.astype(np.float64)


def _report(folder: Path, **status: Any) -> None:
    written = folder / f"{STATUS}.part"
    written.write_text(json.dumps(status))
    written.replace(folder / STATUS)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
