"""Names and paths of the command line to mechanisms and motions."""

from __future__ import annotations

from pathlib import Path

from sixsps.errors import InputError, MotionError, OutputError
from sixsps.files import exists
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import bundled, bundled_motions, fitted

# Some gigabytes of leg kinematics, a few kilobytes a sample.
_MOST_SAMPLES = 1_000_000


def check_range(option: str, value: float | None, low: float, high: float) -> None:
    """Raises InputError for an option that is given and not a number from `low` to `high`."""
    if value is not None and not low <= value <= high:
        raise InputError(option, value, f"{low:g} to {high:g}")


def check_not_input(output: Path, *inputs: str) -> None:
    """Raises OutputError where `output` is one of the files that the command reads."""
    for name in inputs:
        if exists(output) and exists(Path(name)) and output.samefile(name):
            raise OutputError("output", "an input of this command", "another file", str(output))


def load_motion(
    name_or_path: str,
    mechanism: Mechanism,
    *,
    samples: int | None = None,
    cutoff: float | None = None,
    fit: bool = False,
) -> Motion:
    """Returns a bundled motion made for `mechanism`, or the motion in a file.

    Args:
        name_or_path: one of `bundled_motions()`, or a CSV or Parquet file.
        mechanism: what it shall move.
        samples: number of samples of a bundled motion; its own by default.
        cutoff: corner frequency of the smoothing of a recorded motion [Hz].
        fit: shift a file's motion to the mechanism's home and scale it to the strokes.

    Raises:
        MotionError: no such name or file, or a file that cannot be read.
    """
    check_range("--samples", samples, 2, _MOST_SAMPLES)
    if name_or_path in bundled_motions():
        for option, value in (("--cutoff", cutoff), ("--fit", fit or None)):
            if value is not None:
                raise MotionError(option, value, "only with a motion file", name_or_path)
        sizes = {} if samples is None else {"samples": samples}
        return bundled(name_or_path, mechanism, **sizes)
    path = Path(name_or_path)
    if not exists(path) and path.suffix not in (".csv", ".parquet"):
        allowed = f"a CSV or Parquet file, or one of {', '.join(bundled_motions())}"
        raise MotionError("motion", "no such file or bundled name", allowed, name_or_path)
    if samples is not None:
        raise MotionError("--samples", samples, "only with a bundled motion", name_or_path)
    motion = Motion.load(path, cutoff=cutoff)
    return fitted(motion, mechanism) if fit else motion
