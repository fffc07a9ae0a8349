"""C files for controllers: functions, the parameters of a mechanism, and an example that checks itself."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from compare.tolerances import tolerance_of
from sixsps.arrays import Array
from sixsps.errors import OutputError, printable
from sixsps.files import output_folder, write_atomically
from sixsps.formulations import inverse_dynamics
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.parameters import MOTION_COLUMNS, parameter_vector
from sixsps.symbolic.c_code import header, source
from sixsps.symbolic.c_header import HEADER, NUMBERS, SOURCE, comment, parameter_ranges, versions

EXAMPLE = "example.c"

_MARK = b"Written by sixsps"
_MARKED = 1000
_COLUMNS = {"base.anchors": 3, "platform.anchors": 3, "legs": 4}
# Tilts of the platform, of exactly unit length in decimals; the one furthest from a singularity is taken.
_TILTS = ((0.98, 0.1, -0.1, 0.14), (0.9, 0.3, -0.3, 0.1), (0.9, -0.1, 0.3, 0.3), (0.7, 0.5, 0.1, 0.5))


def export_c(mechanism: Mechanism, folder: Path, derivatives: bool = False) -> list[Path]:
    """Writes the C files of a mechanism into a folder: all of them or, where one cannot be written, none.

    Args:
        mechanism: geometry and inertia.
        folder: made where its parent exists.
        derivatives: whether the functions include the exact derivatives of the forces.

    Returns:
        Paths of source, header, parameters and example.

    Raises:
        OutputError: the folder cannot be written, or a file of one of these names is not of this command.
        MechanismError: a mechanism of geometry alone.
    """
    mechanism.check_inertia()
    contents = {
        SOURCE: source(derivatives),
        HEADER: header(derivatives),
        NUMBERS: parameters_text(mechanism),
        EXAMPLE: example_text(mechanism),
    }
    paths = {output_folder(folder) / name: text for name, text in contents.items()}
    for path in paths:
        _check_replaceable(path)
    with ExitStack() as stack:
        for path, text in paths.items():
            stack.enter_context(write_atomically(path)).write_text(text, encoding="ascii", newline="\n")
    return list(paths)


def parameters_text(mechanism: Mechanism) -> str:
    """Returns the header that holds the parameters of a mechanism."""
    numbers = parameter_vector(mechanism)
    rows = []
    for key, places in parameter_ranges().items():
        width = _COLUMNS.get(key, len(places))
        rows.append(f"    /* {key} */")
        rows += [f"    {_listed(numbers[k : k + width])}," for k in places[::width]]
    table = "\n".join(["static const double hexapod_parameters[HEXAPOD_PARAMETERS] = {", *rows, "};"])
    guard = ["#ifndef SIXSPS_HEXAPOD_PARAMETERS_H", "#define SIXSPS_HEXAPOD_PARAMETERS_H"]
    lines = [*guard, "", f'#include "{HEADER}"', "", table, "", "#endif"]
    return comment("\n".join(_facts(mechanism))) + "\n" + "\n".join(lines) + "\n"


def _facts(mechanism: Mechanism) -> list[str]:
    assumed = [f"  {key}: {why}" for key, why in mechanism.assumed.items()]
    return [
        _line(text)
        for text in (
            f"Written by {versions()}.",
            "",
            f"Parameters of a hexapod in SI units; {HEADER} describes their order.",
            f"Name: {mechanism.name}",
            f"sha256 of the numbers: {mechanism.sha256}",
            *([f"Source: {mechanism.source}"] if mechanism.source else []),
            *(["Assumed, not given by the source:", *assumed] if assumed else []),
        )
    ]


def _line(text: str) -> str:
    """A text of any length as one printable line."""
    indent = len(text) - len(text.lstrip(" "))
    return " " * indent + printable(" ".join(text.split()))


def example_text(mechanism: Mechanism) -> str:
    """Returns a program that prints the forces of one sample and compares them with Kane's method."""
    sample = _sample(mechanism)
    expected = inverse_dynamics(mechanism, sample)[0]
    growth = float(inverse_kinematics(mechanism, sample).error_growth[0])
    allowed = tolerance_of("casadi").rounding(growth) * np.abs(expected).max()
    names = [array for arrays in MOTION_COLUMNS.values() for array, _ in arrays]
    given = {name: getattr(sample, name)[0] for name in names}
    about = (
        f"Written by {versions()}.\n\n"
        "Leg lengths and forces of one sample, beside the forces that Kane's method gives in sixsps.\n\n"
        f"  cc -std=c99 -O2 -o example {EXAMPLE} {SOURCE} -lm && ./example\n\n"
        "The exit status is 0 where they agree."
    )
    declared = [f"    const double {name}[{len(row)}] = {{{_listed(row)}}};" for name, row in given.items()]
    return comment(about) + _EXAMPLE.format(
        header=HEADER,
        numbers=NUMBERS,
        given="\n".join(declared),
        expected=f"{_listed(expected[:3])},\n        {_listed(expected[3:])}",
        allowed=_number(float(f"{allowed:.1e}")),
    )


def _sample(mechanism: Mechanism) -> Motion:
    """Returns a tilted pose near home with everything in motion, in few digits."""
    size, mass = mechanism.characteristic_length, mechanism.platform.mass

    def scaled(scale: float, *values: float) -> Array:
        return np.array([[float(f"{scale * value:.3g}") for value in values]] * len(_TILTS))

    motion = Motion(
        time=np.arange(float(len(_TILTS))),
        position=scaled(1, *(home_position(mechanism) + size * np.array([0.1, -0.05, 0.02]))),
        quaternion=np.array(_TILTS),
        velocity=scaled(size, 0.4, -0.3, 0.2),
        angular_velocity=scaled(1, 0.5, -0.4, 0.3),
        acceleration=scaled(size, 2, 1, -1.5),
        angular_acceleration=scaled(1, 1, -2, 1.5),
        force=scaled(mass, 1, -2, 3),
        moment=scaled(mass * size, 0.5, 1, -0.5),
    )
    best = int(np.argmin(inverse_kinematics(mechanism, motion).condition))
    return motion[best : best + 1]


def _listed(values: Array) -> str:
    return ", ".join(map(_number, values.tolist()))


def _number(value: float) -> str:
    """Returns a number as C has it, to the last bit."""
    return repr(value) if np.isfinite(value) else "NAN"


def _check_replaceable(path: Path) -> None:
    """Raises OutputError where a file stands that is not of this command, like somebody's own example.c."""
    if not path.is_file():
        return
    try:
        with path.open("rb") as file:
            mine = _MARK in file.read(_MARKED)
    except OSError:
        mine = False
    if not mine:
        found = "a file that sixsps has not written"
        raise OutputError("output", found, "a folder without it", str(path))


_EXAMPLE = """
#include <math.h>
#include <stdio.h>

#include "{header}"
#include "{numbers}"

int main(void)
{{
{given}
    const double expected[6] = {{
        {expected}}};
    const double allowed = {allowed};
    double forces[6], lengths[6], rates[6], accelerations[6];
    int status, leg, wrong = 0;

    status = hexapod_leg_forces(
        hexapod_parameters, position, quaternion, velocity, angular_velocity,
        acceleration, angular_acceleration, force, moment, forces);
    if (status == HEXAPOD_OK)
        status = hexapod_leg_motion(
            hexapod_parameters, position, quaternion, velocity, angular_velocity,
            acceleration, angular_acceleration, lengths, rates, accelerations);
    if (status != HEXAPOD_OK) {{
        printf("no result, status %d\\n", status);
        return 1;
    }}
    printf("leg       length [m]        force [N]    by sixsps [N]\\n");
    for (leg = 0; leg < 6; leg++) {{
        printf("%3d %16.9g %16.9g %16.9g\\n", leg + 1, lengths[leg], forces[leg], expected[leg]);
        wrong += !(fabs(forces[leg] - expected[leg]) <= allowed);
    }}
    printf("%d of 6 forces are further apart than rounding allows, %g N\\n", wrong, allowed);
    return wrong ? 1 : 0;
}}
"""
