"""`python -m benchmarks`: measures, writes results and report; see --help.

Exit status: 0 measured, 2 bad input, 130 interrupted, both told in one line on standard error.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

# Libraries of linear algebra read this when they are loaded: engines have one thread each.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
RESULTS, REPORT = "results.json", "report.md"


def main(arguments: list[str] | None = None) -> int:
    """Returns the exit status of the command."""
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    from sixsps.errors import SixspsError

    options = _parser().parse_args(arguments)
    try:
        _run(options)
    except SixspsError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("error: interrupted; nothing was left half-written\n")
        return 130
    return 0


def _run(options: argparse.Namespace) -> None:
    from benchmarks.report import markdown, read
    from compare.registry import ENGINES, check_names
    from sixsps.files import output_folder, write_atomically

    if options.report:
        results = read(options.report)
    else:
        check_names(options.engine or [])
    folder = output_folder(options.output)
    if not options.report:
        results = _measured(options, tuple(options.engine or ENGINES))
        with write_atomically(folder / RESULTS) as temporary:
            temporary.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    with write_atomically(folder / REPORT) as temporary:
        temporary.write_text(markdown(results), encoding="utf-8")
    sys.stdout.write(f"report: {folder / REPORT}, raw times: {options.report or folder / RESULTS}\n")


def _measured(options: argparse.Namespace, engines: tuple[str, ...]) -> dict[str, Any]:
    from benchmarks import suite
    from benchmarks.plan import FULL, QUICK

    plan = replace(QUICK if options.quick else FULL, engines=engines)
    start = time.perf_counter()

    def told(part: str, what: str) -> None:
        line = f"[{time.perf_counter() - start:4.0f} s] {part}: {what}"
        sys.stderr.write(f"\r\033[K{line}" if sys.stderr.isatty() else f"{line}\n")
        sys.stderr.flush()

    results = suite.run(plan, told, options.long)
    told("done", "")
    return results


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Benchmarks of sixsps, side by side."
    )
    parser.add_argument(
        "--quick", action="store_true", help="show in half a minute that all works; no figures"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("bench"), metavar="DIR", help="folder; bench by default"
    )
    parser.add_argument(
        "--engine", action="append", metavar="NAME", help="registered engine; repeat; all by default"
    )
    parser.add_argument(
        "--long", action="store_true", help="add 10^8 samples, 100 passes over 10^6; some minutes"
    )
    parser.add_argument("--report", type=Path, metavar="FILE", help="only write the report of such results")
    return parser


if __name__ == "__main__":
    sys.exit(main())
