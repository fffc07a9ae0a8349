"""What `sixsps fk` calculates: a motion file's columns from leg lengths, or every assembly mode."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from compare.modes import numbers
from compare.runner import Watcher
from sixsps.arrays import Array
from sixsps.errors import InputError, MechanismError
from sixsps.home import home_position
from sixsps.lengths_file import LegLengthTable
from sixsps.mechanism import Mechanism
from sixsps.platform_pose import ForwardKinematics, forward_kinematics
from sixsps.platform_rates import forward_rates

if TYPE_CHECKING:
    from sixsps.assembly import AssemblyModes

_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_RATES = ("vx", "vy", "vz", "wx", "wy", "wz", "ax", "ay", "az", "ex", "ey", "ez")
# What `--all` may leave out of a row, by the names that `AssemblyModes` has for it.
_MISSING = {
    "none": "no pose found",
    "singular": "a pose at which the legs do not hold the platform, left out",
    "non_isolated": "lengths with which the platform can move, left out",
    "unresolved": "poses that may be missing",
}
# What is told of rows without a pose, by status; that there is none is proven of the first alone.
_UNKNOWN = "none found from the guess or the row before (--all seeks everywhere)"
_LOST = {
    "impossible": "unreachable, no pose has such lengths",
    "unreachable": f"unreachable, {_UNKNOWN}",
    "singular": f"singular, {_UNKNOWN}",
    "limit": f"limit, {_UNKNOWN}",
}
# What is told between two steps of the progress.
_BLOCK = 65536


def guess_of(text: str | None, mechanism: Mechanism) -> tuple[Array, Array] | None:
    """Returns the position (3,) [m] and rotation (3, 3) of `--guess`; None where the home pose is to serve.

    Raises:
        InputError: not six numbers, or none where the mechanism has no home pose.
    """
    if text is None:
        _check_home(mechanism)
        return None
    values = np.array(numbers("--guess", text, 6))
    return values[:3], np.asarray(Rotation.from_euler("XYZ", values[3:]).as_matrix())


def _check_home(mechanism: Mechanism) -> None:
    try:
        home_position(mechanism)
    except MechanismError as error:
        allowed = "X,Y,Z,ALPHA,BETA,GAMMA [m, rad], a pose to start from: "
        allowed += f"without {error.place} the mechanism has no home pose"
        raise InputError("--guess", "missing", allowed) from None


def motion_columns(
    mechanism: Mechanism, table: LegLengthTable, guess: Any, watch: Watcher
) -> tuple[dict[str, Array], list[str]]:
    """Returns the columns of a motion file, NaN where no pose was found, and what has to be told of those.

    Args:
        mechanism: what has these lengths.
        table: lengths, with or without rates and accelerations, which become those of the platform.
        guess: pose that the first row is reached from; the home pose where it is None.
        watch: told how it gets on.
    """
    parts = []
    for start in range(0, len(table.time), _BLOCK):
        found = forward_kinematics(
            mechanism, table.lengths[start : start + _BLOCK], guess, on_failure="return"
        )
        if found.ok.any():
            last = np.flatnonzero(found.ok)[-1]
            guess = (found.position[last], found.quaternion[last])
        parts.append((found, _rates(mechanism, table, found, slice(start, start + _BLOCK))))
        watch("fk", "running", start + len(found.position))
    poses = np.concatenate([np.hstack([found.position, found.quaternion, rates]) for found, rates in parts])
    status = np.concatenate(
        [np.where(found.proven_impossible, "impossible", found.status) for found, _ in parts]
    )
    names = (*_POSE, *_RATES)[: poses.shape[1]]
    columns = {"t": table.time} | dict(zip(names, np.ascontiguousarray(poses.T), strict=True))
    return columns, list(_told(status, table.time))


def _rates(mechanism: Mechanism, table: LegLengthTable, found: ForwardKinematics, rows: slice) -> Array:
    """Returns twist (n, 6) and, with length accelerations, acceleration (n, 6); (n, 0) without rates."""
    if table.rates is None:
        return np.empty((len(found.position), 0))
    accelerations = None if table.accelerations is None else table.accelerations[rows]
    rates = forward_rates(mechanism, found, table.rates[rows], accelerations)
    return np.hstack([array for array in rates.arrays.values() if array is not None])


def _told(status: NDArray[np.str_], time: Array) -> Iterable[str]:
    for kind, what in _LOST.items():
        rows = np.flatnonzero(status == kind)
        if len(rows):
            yield _line(what, rows, time)


def mode_columns(
    mechanism: Mechanism, table: LegLengthTable, watch: Watcher
) -> tuple[dict[str, Any], list[str]]:
    """Returns the columns t, mode, x, y, z, qw, qx, qy, qz of all assembly modes, and what has to be told.

    Args:
        mechanism: what has these lengths.
        table: lengths; each row has modes 1, 2, ... or none.
        watch: told how it gets on.
    """
    from sixsps import assembly_modes

    times, modes, poses = [], [], []
    rows: dict[str, list[int]] = {kind: [] for kind in _MISSING}
    for row, (time, lengths) in enumerate(zip(table.time, table.lengths, strict=True)):
        found = assembly_modes(mechanism, lengths)
        for number, pose in enumerate(found, 1):
            times.append(time)
            modes.append(number)
            poses.append(np.concatenate([pose.position, pose.quaternion]))
        for kind in rows:
            if _is_none(found) if kind == "none" else getattr(found, kind):
                rows[kind].append(row)
        watch("fk --all", "running", row + 1)
    columns: dict[str, Any] = {"t": np.array(times), "mode": np.array(modes, np.int64)}
    columns |= dict(zip(_POSE, np.array(poses).reshape(-1, 7).T.copy(), strict=True))
    told = [_line(_MISSING[kind], np.array(missing), table.time) for kind, missing in rows.items() if missing]
    return columns, told


def _is_none(found: AssemblyModes) -> bool:
    return not (len(found) or found.singular or found.non_isolated or found.unresolved)


def _line(what: str, rows: NDArray[np.intp], time: Array) -> str:
    first = f"first at t = {time[rows[0]]:g} s (row {rows[0] + 1})"
    return f"{what}: {len(rows)} of {len(time)} rows, {first}"
