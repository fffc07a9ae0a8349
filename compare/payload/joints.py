"""Recorded joint motions: CSV or Parquet in, joint positions and their derivatives at given times out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from compare.payload.ride import JointMotion
from compare.payload.turns import without_jumps
from sixsps.arrays import Array
from sixsps.errors import MotionError
from sixsps.motion import check_time
from sixsps.motion_file import source_in_errors
from sixsps.smoothing import FEWEST_SAMPLES, fit
from sixsps.tables import Table, read_table

_PREFIXES = ("", "d", "dd")
_SHOWN = 3
# Times that were written in decimals may miss the last one of the platform's by their rounding.
_ROUNDING = 4 * float(np.finfo(np.float64).eps)
# A step that is so much longer than nine in ten of the others is a gap, in which positions alone say nothing.
_GAP = 10
# Noise of recorded positions [rad, m], and its share of their range, beyond which something else is wrong.
_NOISE, _NOISE_SHARE = 1e-3, 0.01

Curves = tuple[Array, Array, Array]
"""Positions, velocities and accelerations, (n, k) each."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded motion of k joints.

    Attributes:
        time: (m,) strictly increasing [s].
        position: (m, k) [rad], of sliding joints [m].
        velocity: (m, k) [rad/s, m/s], None where it was not recorded.
        acceleration: (m, k) [rad/s^2, m/s^2], None where it was not recorded.
        sliding: (k,) bool, which joints slide.
        source: the file.
        warnings: what a reader has to know of how positions were read.
    """

    time: Array
    position: Array
    velocity: Array | None
    acceleration: Array | None
    sliding: NDArray[np.bool_]
    source: Path
    warnings: tuple[str, ...] = ()

    def at(self, time: Array) -> JointMotion:
        """Returns the motion at the times of the platform's motion.

        At the recording's own times what was recorded is used as it is, and what is missing comes
        from a smoothing spline of the positions. At other times everything comes from that spline
        or, where velocities and accelerations were recorded, from the quintic between two samples
        that has the values of both.

        Args:
            time: (n,) strictly increasing [s].

        Raises:
            MotionError: the recording does not cover these times, has a gap there or too few samples
                to be differentiated, or at other times than its own only one of both derivatives.
        """
        with source_in_errors(self.source):
            if np.array_equal(time, self.time):
                return self._at_own_times()
            inside = self._covered(time)
            if self.velocity is not None and self.acceleration is not None:
                curves = _quintic(self.time, (self.position, self.velocity, self.acceleration), inside)
                return JointMotion(*curves, self.source.stem, warnings=self.warnings)
            if self.velocity is not None or self.acceleration is not None:
                found = "only velocities" if self.acceleration is None else "only accelerations"
                raise MotionError("columns", found, "both or none, or the times of the platform's motion")
            self._check_gaps(inside)
            curves, how, told = self._smoothed(inside)
            return JointMotion(*curves, self.source.stem, how, self.warnings + told)

    def _at_own_times(self) -> JointMotion:
        velocity, acceleration, how = self.velocity, self.acceleration, ""
        told: tuple[str, ...] = ()
        if velocity is None or acceleration is None:
            (_, rate, change), how, told = self._smoothed(self.time)
            velocity = rate if velocity is None else velocity
            acceleration = change if acceleration is None else acceleration
        return JointMotion(self.position, velocity, acceleration, self.source.stem, how, self.warnings + told)

    def _covered(self, time: Array) -> Array:
        first, last = float(self.time[0]), float(self.time[-1])
        slack = _ROUNDING * max(abs(first), abs(last))
        if time[0] < first - slack or time[-1] > last + slack:
            found = f"{first:.10g} to {last:.10g} s"
            allowed = f"the times of the platform's motion, {time[0]:.10g} to {time[-1]:.10g} s"
            raise MotionError("t", found, allowed)
        return np.clip(time, first, last)

    def _check_gaps(self, time: Array) -> None:
        steps = np.diff(self.time)
        before = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(steps) - 1)
        gap = (steps > _GAP * np.quantile(steps, 0.9))[before] & (time != self.time[before])
        if gap.any():
            step = int(before[np.argmax(gap)])
            found = f"no samples from {self.time[step]:.10g} to {self.time[step + 1]:.10g} s"
            raise MotionError("t", found, "evenly recorded positions, or also velocities and accelerations")

    def _smoothed(self, time: Array) -> tuple[Curves, str, tuple[str, ...]]:
        """Returns smoothed curves, how they were made, and warnings; sliding joints by themselves."""
        if len(self.time) < FEWEST_SAMPLES:
            allowed = f"at least {FEWEST_SAMPLES} samples, or velocities and accelerations"
            raise MotionError("rows", f"{len(self.time)} samples without derivatives", allowed)
        curves = tuple(np.zeros((len(time), self.position.shape[1])) for _ in _PREFIXES)
        words, warnings = [], []
        for joints, unit in ((~self.sliding, "rad"), (self.sliding, "m")):
            if joints.any():
                recorded = self.position[:, joints]
                spline = fit(self.time, recorded)
                if spline.noise > max(_NOISE, _NOISE_SHARE * np.ptp(recorded, axis=0).max()):
                    warnings.append(
                        f"joint positions are {spline.noise:.2g} {unit} RMS from the curve through them, "
                        "more than recordings are noisy: see that none of them jumps"
                    )
                for order, curve in enumerate(curves):
                    curve[:, joints] = spline(time, order)
                words.append(f"cutoff {spline.cutoff:.3g} Hz, residual {spline.noise:.2g} {unit} RMS")
        position, velocity, acceleration = curves
        how = "quintic smoothing spline, " + "; ".join(words)
        return (position, velocity, acceleration), how, tuple(warnings)


def load(
    path: Path,
    names: Sequence[str],
    sliding: NDArray[np.bool_],
    endless: NDArray[np.bool_] | None = None,
) -> Recording:
    """Reads a joint motion.

    Columns, in any order: t; of all joints q1, ..., qk in the order of the robot's description, or the
    joints' names; velocities with d before the same names, accelerations with dd, each of all joints
    or of none.

    Args:
        path: CSV or Parquet file.
        names: of the robot's k joints.
        sliding: (k,) bool, which of them slide.
        endless: (k,) bool, which of them turn without limits, so that their angles may be recorded
            within one turn; none by default.

    Raises:
        MotionError: naming file, row and column, value and what is allowed.
    """
    endless = np.zeros_like(sliding) if endless is None else endless
    numbers = [f"q{joint}" for joint in range(1, len(names) + 1)]
    with source_in_errors(path):
        names = names if _are_clear(names) else numbers
        table = _table(path, numbers, names)
        columns = table.columns
        if "t" not in columns:
            raise MotionError("column t", "missing", "times in seconds")
        check_time(columns["t"], table.row)
        # A robot whose joints are called q1, q2, ... means them, whatever their order.
        named = any(prefix + name in columns for prefix in _PREFIXES for name in names)
        family = names if named else numbers
        if not columns.keys() <= {"t", *(prefix + name for prefix in _PREFIXES for name in family)}:
            raise MotionError("columns", "numbers and names of joints", "only one of them")
        position, velocity, acceleration = (_group(columns, prefix, family) for prefix in _PREFIXES)
        if position is None:
            raise MotionError("columns", "no joint positions", _words(numbers, names))
        position, turned = without_jumps(
            columns["t"],
            position,
            velocity,
            (sliding, endless),
            lambda sample, joint: f"{family[joint]}, {table.row(sample)}",
        )
        warnings = _turns_told([family[joint] for joint in turned])
        return Recording(columns["t"], position, velocity, acceleration, sliding, path, warnings)


def _turns_told(names: Sequence[str]) -> tuple[str, ...]:
    if not names:
        return ()
    return (f"recorded angles jump by whole turns, which were added: {_few(names)}",)


def _are_clear(names: Sequence[str]) -> bool:
    """Returns whether columns called after joints cannot be mistaken: for times, or for another's rates."""
    columns = ["t", *(prefix + name for prefix in _PREFIXES for name in names)]
    return len(set(columns)) == len(columns)


def _table(path: Path, numbers: Sequence[str], names: Sequence[str]) -> Table:
    known = ("t", *(prefix + name for prefix in _PREFIXES for name in (*numbers, *names)))
    try:
        return read_table(path, known)
    except MotionError as error:
        if error.allowed != ", ".join(known):
            raise
        # A humanoid has hundreds of possible columns.
        raise MotionError(error.place, error.value, _words(numbers, names), error.source) from None


def _group(columns: dict[str, Array], prefix: str, family: Sequence[str]) -> Array | None:
    missing = [prefix + name for name in family if prefix + name not in columns]
    if len(missing) == len(family):
        return None
    if missing:
        found = f"{_few(missing)} missing"
        allowed = f"all {len(family)} of {prefix + family[0]} to {prefix + family[-1]}"
        raise MotionError("columns", found, allowed if prefix == "" else f"{allowed} or none")
    return np.column_stack([columns[prefix + name] for name in family])


def _words(numbers: Sequence[str], names: Sequence[str]) -> str:
    many = f"{numbers[0]} to {numbers[-1]}" if numbers else "no joint"
    return f"t, {many} or the names of the joints ({_few(names)}), and the same with d or dd before them"


def _few(names: Sequence[str]) -> str:
    others = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {others} more" if others > 0 else "")


def _quintic(time: Array, values: Curves, at: Array) -> Curves:
    """Returns the quintic Hermite interpolant, (m, k) each.

    Args:
        time: (n,) of the samples.
        values: at the samples, (n, k) each.
        at: (m,) times between the first and the last.
    """
    before = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    h = (time[before + 1] - time[before])[:, None]
    u = (at - time[before])[:, None] / h
    p0, v0, a0 = (value[before] * h**order for order, value in enumerate(values))
    p1, v1, a1 = (value[before + 1] * h**order for order, value in enumerate(values))
    # What the parabola of the first sample leaves to the second.
    p, v, a = p1 - (p0 + v0 + a0 / 2), v1 - (v0 + a0), a1 - a0
    c3, c4, c5 = 10 * p - 4 * v + a / 2, -15 * p + 7 * v - a, 6 * p - 3 * v + a / 2
    position = p0 + u * (v0 + u * (a0 / 2 + u * (c3 + u * (c4 + u * c5))))
    velocity = v0 + u * (a0 + u * (3 * c3 + u * (4 * c4 + u * 5 * c5)))
    acceleration = a0 + u * (6 * c3 + u * (12 * c4 + u * 20 * c5))
    return position, velocity / h, acceleration / h**2
