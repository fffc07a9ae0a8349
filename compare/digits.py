"""Correct digits of every engine on every bundled mechanism, all samples certified, as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from compare.comparison import compare
from compare.inputs import load_motion
from compare.progress import watching
from compare.summary import verdict
from sixsps.errors import EngineError
from sixsps.mechanism import Mechanism
from sixsps.mechanism_file import bundled_mechanisms
from sixsps.motion import Motion
from sixsps.trajectories import bundled_motions

MOTIONS = ("line", "sinusoids")


@dataclass(frozen=True)
class Case:
    """One mechanism along one motion: heading of its column and `results["engines"]`."""

    heading: str
    engines: dict[str, Any]
    agreed: bool


def cases(motions: Sequence[str], engines: Sequence[str], samples: int) -> Iterator[Case]:
    """Compares engines on every bundled mechanism along every motion, at certified samples only.

    Args:
        motions: bundled names, or files, which are fitted to the mechanism.
        engines: names.
        samples: of a bundled motion.

    Yields:
        A case as soon as it is done.

    Raises:
        MotionError: a file cannot be read; before anything is computed.
        EngineError: nothing can be certified.
    """
    bundled = (Mechanism.load(name) for name in bundled_mechanisms())
    mechanisms = [mechanism for mechanism in bundled if mechanism.has_inertia]
    pairs = [(mechanism, _motion(name, mechanism, samples)) for mechanism in mechanisms for name in motions]
    for mechanism, motion in pairs:
        with watching(len(motion)) as watch:
            comparison = compare(mechanism, motion, engines, spread=len(motion), watch=watch)
        heading = f"{mechanism.name} {motion.name}".replace("|", "/")
        missing = comparison.results["reference"]["missing"]
        if missing:
            raise EngineError(f"{heading}: digits need certified forces: {missing}")
        yield Case(heading, comparison.results["engines"], comparison.agreed)


def markdown(done: Sequence[Case]) -> str:
    """Returns a table with a row an engine and a column a case."""
    rows = [["engine", "version", *(case.heading for case in done)], ["---", "---"] + ["---:"] * len(done)]
    for name in done[0].engines:
        version = next(filter(None, (case.engines[name]["version"] for case in done)), "")
        rows.append([f"`{name}`", version, *(_cell(case.engines[name]) for case in done)])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def _motion(name: str, mechanism: Mechanism, samples: int) -> Motion:
    if name in bundled_motions():
        return load_motion(name, mechanism, samples=samples)
    return load_motion(name, mechanism, fit=True)


def _cell(entry: dict[str, Any]) -> str:
    word = verdict(entry)
    return f"{entry['digits']:.1f}" if word == "ok" and entry["digits"] is not None else word
