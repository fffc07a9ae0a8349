"""Recorded angles that jump by whole turns: of joints without limits they are undone, others are refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.errors import MotionError

_TURN = 2 * np.pi
# Written in decimals, -pi to pi is somewhat more than a turn.
_SLACK = 0.01
_ALLOWED = "steps of at most pi [rad], or also velocities that explain them"


def without_jumps(
    time: Array,
    position: Array,
    velocity: Array | None,
    kinds: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    place: Callable[[int, int], str],
) -> tuple[Array, Sequence[int]]:
    """Returns positions (m, k) whose angles do not jump, and the joints to which turns were added.

    A step is a jump where it is half a turn longer or shorter than recorded velocities say or, without
    them, than none. Of a joint with limits only steps longer than half a turn are judged.

    Args:
        time: (m,) [s].
        position: (m, k) as recorded [rad, m].
        velocity: (m, k) as recorded [rad/s, m/s], or None.
        kinds: which joints slide and which turn without end, (k,) bool each.
        place: sample and joint -> how a message names them.

    Raises:
        MotionError: a jump of a joint that has limits, or of one that does not go back and forth
            within one turn, without velocities to say which turn it is on.
    """
    sliding, endless = kinds
    steps = np.diff(position, axis=0)
    expected = np.zeros_like(steps)
    if velocity is not None:
        expected = np.diff(time)[:, None] * (velocity[1:] + velocity[:-1]) / 2
    jumps = (np.abs(steps - expected) > np.pi) & (endless | (np.abs(steps) > np.pi)) & ~sliding
    unclear = np.zeros_like(endless)
    if velocity is None:
        unclear = np.ptp(position, axis=0) > _TURN + _SLACK
    refused = jumps & (unclear | ~endless)
    if refused.any():
        sample, joint = (int(index) for index in np.argwhere(refused)[0])
        found = f"{position[sample + 1, joint]:.6g} after {position[sample, joint]:.6g}"
        raise MotionError(place(sample + 1, joint), found, _ALLOWED)
    turns = np.where(jumps, np.rint((expected - steps) / _TURN), 0.0)
    undone = position.copy()
    undone[1:] += _TURN * np.cumsum(turns, axis=0)
    return undone, [int(joint) for joint in np.flatnonzero(jumps.any(axis=0))]
