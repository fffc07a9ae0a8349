"""What `sixsps modes` reads and shows: numbers with commas, a table in 80 columns, JSON."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array
from sixsps.errors import InputError, printable
from sixsps.home import home_position

if TYPE_CHECKING:
    from sixsps.mechanism import Mechanism
    from sixsps.modes import Modes

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_UNITS = ("[m]", "", "", "[rad]", "", "")
_LOADS = " " * 8 + "".join(f"{load:>12}" for load in ("fx [N]", "fy", "fz", "mx [N m]", "my", "mz"))
# Entries below this are shown as zero beside those that they stand with.
_ROUNDING = 1e-12


def numbers(option: str, text: str, *counts: int) -> list[float]:
    """Returns the numbers of an option.

    Args:
        option: its name, for the message.
        text: numbers with commas between them.
        counts: how many there may be.

    Raises:
        InputError: a part is no finite number, or there are more or fewer.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)):
        allowed = f"{' or '.join(map(str, counts))} finite numbers, with commas between them"
        raise InputError(option, text, allowed)
    return values


def pose_of(mechanism: Mechanism, text: str | None) -> tuple[Array, Array]:
    """Returns position (3,) [m] and rotation (3, 3) of `--pose`, the home pose where it is not given.

    Raises:
        InputError: not six numbers.
    """
    if text is None:
        return home_position(mechanism), np.eye(3)
    values = np.array(numbers("--pose", text, 6))
    return values[:3], np.asarray(Rotation.from_euler("XYZ", values[3:]).as_matrix())


def mapping(name: str, position: Array, found: Modes, point: list[float]) -> dict[str, object]:
    """Returns all results for JSON.

    Args:
        name: of the mechanism.
        position: (3,) of O1 [m].
        found: the modes.
        point: of the compliance, platform frame [m].
    """
    angles = Rotation.from_matrix(found.rotation).as_euler("XYZ")
    stable = bool(found.frequencies[0] > 0)
    return {
        "mechanism": name,
        "pose": {"position_m": position.tolist(), "euler_rad": angles.tolist()},
        "axes": "world; [displacement of O1; rotation], wrenches about O1",
        "frequencies_Hz": found.frequencies.tolist(),
        "stable": stable,
        "shapes": found.shapes.T.tolist(),
        "shapes_are": "one a row, shape M shape' = 1",
        "leg_forces_N": found.leg_forces.tolist(),
        "mass_matrix": found.mass_matrix.tolist(),
        "stiffness_matrix": found.stiffness_matrix.tolist(),
        "geometric_stiffness": found.geometric_stiffness.tolist(),
        "compliance": {"point_m": point, "matrix": found.compliance(point).tolist() if stable else None},
    }


def json_text(content: dict[str, object]) -> str:
    """Returns a mapping as the text of a JSON file."""
    return json.dumps(content, indent=1) + "\n"


def table(name: str, position: Array, found: Modes, point: list[float]) -> str:
    """Returns the results for a reader, in 80 columns; arguments as in `mapping`."""
    angles = Rotation.from_matrix(found.rotation).as_euler("XYZ")
    preload = "with gravity and force" if found.geometric_stiffness.any() else "without preload"
    lines = [
        f"{printable(name)[:40]} at {_list(position)} m, {_list(angles)} rad",
        f"static leg forces {_list(found.leg_forces)} N",
        "",
        f"natural frequencies, stiffness {preload}",
        f"{'mode':>4}{'Hz':>12}  " + "".join(f"{axis:>8}" for axis in _AXES),
    ]
    for mode, (frequency, shape) in enumerate(zip(found.frequencies, found.proportions.T, strict=True), 1):
        lines.append(
            f"{mode:>4}{frequency:>12.6g}  " + "".join(f"{round(entry, 3) + 0.0:>8.3f}" for entry in shape)
        )
    lines += [f"rotations times {found.characteristic_length:.4g} m; the largest entry of a mode is 1"]
    if found.frequencies[0] <= 0:
        return "\n".join([*lines, "-f: not stable, grows by exp(2 pi f t), and so has no compliance"]) + "\n"
    lines += ["", f"compliance at {_list(np.array(point))} m of the platform, world axes", _LOADS]
    matrix = found.compliance(point)
    size = np.sqrt(np.diag(matrix))
    shown = np.where(np.abs(matrix) > _ROUNDING * np.outer(size, size), matrix, 0.0)
    for axis, unit, row in zip(_AXES, _UNITS, shown, strict=True):
        lines.append(f"{axis:<2} {unit:<5}" + "".join(f"{entry:>12.4g}" for entry in row))
    return "\n".join(lines) + "\n"


def _list(values: Array) -> str:
    shown = np.where(np.abs(values) > _ROUNDING * np.abs(values).max(), values, 0.0)
    return "[" + ", ".join(f"{value:.4g}" for value in shown) + "]"
