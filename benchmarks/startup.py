"""Start-up: processes timed from outside, and what they load."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.naming import BARE, HELP, IMPORT
from benchmarks.plan import MECHANISM, Plan
from benchmarks.rounds import Progress

_RUN_HELP = """
from compare.cli import main
sys.argv = ["sixsps", "--help"]
try:
    main()
except SystemExit:
    pass
"""
_MODULES = """
import sys
{code}
names = {{name.split(".")[0] for name in sys.modules}}
print(*sorted(name for name in names - set(sys.stdlib_module_names) if not name.startswith("_")))
"""
_COMPILE = f"""
import json, time
start = time.perf_counter()
import sixsps
imported = time.perf_counter()
mechanism = sixsps.Mechanism.load("{MECHANISM}")
loaded = time.perf_counter()
model = sixsps.compile(mechanism)
compiled = time.perf_counter()
model.leg_forces([0, 0, 0.6], [1, 0, 0, 0])
first = time.perf_counter()
print(json.dumps({{"import": imported - start, "load": loaded - imported, "compile": compiled - loaded,
                  "first": first - compiled}}))
"""


def measure(plan: Plan, progress: Progress) -> dict[str, Any]:
    """Returns the entry `startup` of the results: seconds of processes, in rounds, and of compilation."""
    commands = {BARE: python("pass"), IMPORT: python(IMPORT), HELP: [*program(), "--help"]}
    seconds: dict[str, list[float]] = {name: [] for name in commands}
    for command in commands.values():
        _finished(command)
    for number in range(plan.starts):
        progress(f"start {number + 1} of {plan.starts}")
        for name, command in commands.items():
            start = perf_counter()
            _finished(command)
            seconds[name].append(perf_counter() - start)
    cold, warm = _compilation(plan, progress)
    return {
        "seconds": seconds,
        "loaded": {IMPORT: loaded(IMPORT), HELP: loaded(_RUN_HELP)},
        "cold": cold,
        "warm": warm,
    }


def python(code: str) -> list[str]:
    """Returns the command that runs `code`."""
    return [sys.executable, "-c", code]


def program() -> list[str]:
    """Returns the command `sixsps`: as it was installed, or else as a module."""
    script = Path(sysconfig.get_path("scripts")) / "sixsps"
    return [str(script)] if script.exists() else [sys.executable, "-m", "compare"]


def loaded(code: str) -> list[str]:
    """Returns the packages outside the standard library that a fresh process has loaded after `code`."""
    return _finished(python(_MODULES.format(code=code))).splitlines()[-1].split()


def _compilation(plan: Plan, progress: Progress) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Returns seconds of the steps up to the first force: with no machine code on disk, and with it."""
    cold = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(plan.cold_starts):
            progress(f"compiling anew, {number + 1} of {plan.cold_starts}")
            kept = Path(folder) / str(number)
            cold.append(_steps(kept))
        progress("machine code from disk")
        return cold, [_steps(kept) for _ in range(plan.starts)]


def _steps(cache: Path) -> dict[str, float]:
    steps: dict[str, float] = json.loads(_finished(python(_COMPILE), {"NUMBA_CACHE_DIR": str(cache)}))
    return steps


def _finished(command: list[str], environment: dict[str, str] | None = None) -> str:
    """Returns the standard output of a process that has to end well."""
    done = subprocess.run(  # noqa: S603  this program
        command, capture_output=True, text=True, check=True, env=os.environ | (environment or {})
    )
    return done.stdout
