"""Names and paths of the command line to mechanisms and motions.

What reads files is imported where there is one to read: pyarrow takes longer than most bundled motions.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import Protocol

from sixsps.errors import InputError, MotionError, OutputError
from sixsps.files import exists
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import bundled, bundled_motions, fitted

# A bundled motion is made at once: some gigabytes, with the leg kinematics of a comparison.
_MOST_SAMPLES = 1_000_000
# A file longer than this is read block by block where that can be done.
_LONG = 131072
# What smoothing takes of memory; a motion with derivatives takes half of it.
_BYTES_A_SAMPLE = 2000

Block = Callable[[], Motion]
"""Returns samples of a motion, checked; may be called in any thread."""


class Motions(Protocol):
    """A motion that comes in blocks."""

    @property
    def samples(self) -> int | None:
        """Number of samples; None where it is not known before the end."""
        ...

    def blocks(self, size: int) -> Generator[Block, None, None]:
        """Yields the blocks in their order, of `size` samples or somewhat more, the last with fewer."""
        ...


class WholeMotion:
    """A motion in memory, in blocks; see `Motions`."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self.samples = len(motion)

    def blocks(self, size: int) -> Generator[Block, None, None]:
        """Yields the blocks; see `Motions`."""
        for start in range(0, self.samples, size):
            yield partial(self._motion.__getitem__, slice(start, start + size))


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
    _check_fits(path)
    motion = Motion.load(path, cutoff=cutoff)
    return fitted(motion, mechanism) if fit else motion


def open_motions(
    name_or_path: str,
    mechanism: Mechanism,
    *,
    samples: int | None = None,
    cutoff: float | None = None,
    fit: bool = False,
) -> Motions:
    """Returns a motion that comes in blocks, out of a file that is read on the way where it is long.

    Args:
        name_or_path: as for `load_motion`, like all others.
        mechanism: what it shall move.
        samples: number of samples of a bundled motion.
        cutoff: corner frequency of the smoothing of a recorded motion [Hz].
        fit: shift a file's motion to the mechanism's home and scale it to the strokes.

    Raises:
        MotionError: as `load_motion`.
    """
    from sixsps.motion_stream import open_motion
    from sixsps.table_stream import row_count

    of_all_samples = samples is not None or cutoff is not None or fit or name_or_path in bundled_motions()
    path = Path(name_or_path)
    if not of_all_samples and exists(path) and row_count(path)[0] > _LONG:
        stream = open_motion(path)
        if stream is not None:
            return stream
    return WholeMotion(load_motion(name_or_path, mechanism, samples=samples, cutoff=cutoff, fit=fit))


def _check_fits(path: Path) -> None:
    """Raises MotionError for a file whose motion this machine's memory cannot hold."""
    from sixsps.table_stream import row_count

    rows, exact = row_count(path)
    most = _memory() // _BYTES_A_SAMPLE
    if rows > most:
        allowed = (
            f"at most {most} at once, {_BYTES_A_SAMPLE // 1000} kB of this machine's memory each; forces and "
            "ik read more block by block from a file with twist and acceleration columns, without --fit"
        )
        raise MotionError("rows", rows if exact else f"about {rows}", allowed, str(path))


def _memory() -> int:
    """Returns the bytes of memory that this machine has, more than any where it does not say."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 2**63
