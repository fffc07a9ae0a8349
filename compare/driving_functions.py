"""Driving functions as other programs read them: ADAMS, MATLAB, a table, JSON."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path

from sixsps.arrays import Array
from sixsps.driving_functions import DrivingFunctions, Interpolation
from sixsps.errors import OutputError, printable
from sixsps.files import write_atomically

_SUFFIXES = {"adams": ".adm", "matlab": ".m", "csv": ".csv", "json": ".json"}
_WIDTH = 78
# Neither a keyword of the language nor a function that the file itself calls.
_MATLAB_NAME = re.compile(
    r"(?!(?:break|case|catch|classdef|continue|else|elseif|end|for|function|global|if|otherwise|parfor"
    r"|persistent|return|spmd|switch|try|while|cell|isempty|mkpp|numel|ppval|zeros)$)[A-Za-z][A-Za-z0-9_]{0,62}"
)
_THROUGH = {
    Interpolation.linear: "straight lines",
    Interpolation.akima: "Akima's method of 1970, a piecewise cubic,",
    Interpolation.quintic: "a quintic spline",
}


def interpolation(format: str, everywhere: bool) -> Interpolation:  # noqa: A002  the option's name
    """Returns how a format gets from knots to forces.

    Args:
        format: adams, matlab, csv or json.
        everywhere: whether the motion can be sampled anywhere.
    """
    if format == "csv":
        return Interpolation.linear
    if format == "adams" or not everywhere:
        return Interpolation.akima
    return Interpolation.quintic


def check_output(format: str, output: Path) -> None:  # noqa: A002
    """Raises OutputError unless the program that reads `format` can use a file named `output`."""
    if output.suffix != _SUFFIXES[format]:
        allowed = f"{_SUFFIXES[format]} for {format}"
        raise OutputError("output", output.suffix or "no suffix", allowed, str(output))
    if format == "matlab" and not _MATLAB_NAME.fullmatch(output.stem):
        allowed = "a letter, then letters, digits and _, and no word that MATLAB or the file itself uses"
        raise OutputError("output", output.stem, allowed, str(output))


def write(functions: DrivingFunctions, format: str, output: Path) -> None:  # noqa: A002
    """Writes driving functions in one step.

    Args:
        functions: made with the interpolation of the format.
        format: adams, matlab, csv or json.
        output: file to write, as `check_output` wants it.

    Raises:
        OutputError: `output` cannot be written.
    """
    text = _RENDERERS[format](functions, output.stem)
    with write_atomically(output) as temporary:
        temporary.write_text(text, encoding="ascii")


def summary(functions: DrivingFunctions) -> str:
    """Returns in one line what the file holds."""
    where = "everywhere" if functions.everywhere else "at the motion's samples"
    figures = f"error {functions.error:.2g} N within {functions.bound:.2g} N"
    return f"{len(functions.time)} knots, {figures} {where}"


def _statements(functions: DrivingFunctions) -> list[str]:
    """Returns what every format says first."""
    first, last = functions.time[[0, -1]].tolist()
    if functions.everywhere:
        covered = f"The bound holds all along the motion; checked at {functions.checked} times."
    else:
        covered = (
            f"The bound holds at the {functions.checked} samples of the motion; between them the motion is "
            "not known, and the curve goes through the forces at the knots."
        )
    return [
        f"Leg forces of {functions.mechanism} along {functions.motion}, by sixsps {version('sixsps')}.",
        f"Forces [N] over time [s] from {first!r} to {last!r} s, positive when the actuator pushes, which "
        "extends the leg.",
        f"Interpolation: {_THROUGH[functions.interpolation]} through {len(functions.time)} knots.",
        f"Interpolation error: bound {functions.bound!r} N, {functions.tolerance:g} of the largest force "
        f"{functions.largest_force:.6g} N; largest found {functions.error:.3g} N.",
        covered,
    ]


def _comment(sign: str, statements: Iterable[str]) -> list[str]:
    """Returns comment lines of ASCII, whatever characters the names hold."""
    plain = (printable(text).encode("ascii", "backslashreplace").decode() for text in statements)
    return [f"{sign} {line}" for text in plain for line in textwrap.wrap(text, _WIDTH - len(sign))]


def _adams(functions: DrivingFunctions, _name: str) -> str:
    statements = [
        *_statements(functions),
        "Statements for an ADAMS/Solver dataset in newtons and seconds, to be put before END. The markers "
        "are examples: I=101 to 601 on the upper links at the platform joints, J=102 to 602 on the lower "
        "links at the base joints. A positive SFORCE pushes them apart.",
    ]
    lines = _comment("!", statements)
    times = _packed("X", functions.time)
    for leg in range(1, 7):
        lines += ["!", f"SPLINE/{leg}", *times, *_packed("Y", functions.forces[:, leg - 1])]
    for leg in range(1, 7):
        lines += ["!", f"SFORCE/{leg}, I={leg}01, J={leg}02", ", TRANSLATION"]
        lines += [f", FUNCTION=AKISPL(TIME, 0, {leg}, 0)"]
    return "\n".join(lines) + "\n"


def _packed(name: str, values: Array) -> list[str]:
    """Returns continuation lines of an ADAMS statement: a comma first, no line too long."""
    numbers = f"{name}=" + ", ".join(map(repr, values.tolist()))
    lines = textwrap.wrap(numbers, _WIDTH, break_long_words=False, break_on_hyphens=False)
    return [f", {line.rstrip(',')}" for line in lines]


def _matlab(functions: DrivingFunctions, name: str) -> str:
    first, last = functions.breaks[[0, -1]].tolist()
    use = f"f = {name}(t) returns numel(t)-by-6 forces [N] at times t [s], NaN beyond the ends."
    lines = [f"function f = {name}(t)", *_comment("%", [use, *_statements(functions)])]
    lines += ["persistent curves", "if isempty(curves)", "    breaks = ["]
    lines += [*_rows(functions.breaks[:, None]), "    ];", "    curves = cell(1, 6);"]
    for leg in range(6):
        lines += [f"    curves{{{leg + 1}}} = mkpp(breaks, ["]
        lines += [*_rows(functions.coefficients[:, :, leg].T), "    ]);"]
    lines += ["end", "t = t(:);", "f = zeros(numel(t), 6);", "for leg = 1:6"]
    lines += ["    f(:, leg) = ppval(curves{leg}, t);", "end"]
    lines += [f"f(t < {first!r} | t > {last!r}, :) = NaN;", "end"]
    return "\n".join(lines) + "\n"


def _rows(matrix: Array) -> list[str]:
    return ["        " + " ".join(map(repr, row)) for row in matrix.tolist()]


def _csv(functions: DrivingFunctions, _name: str) -> str:
    table = [
        [time, *row] for time, row in zip(functions.time.tolist(), functions.forces.tolist(), strict=True)
    ]
    lines = _comment("#", _statements(functions))
    lines += ["t,f1,f2,f3,f4,f5,f6", *(",".join(map(repr, row)) for row in table)]
    return "\n".join(lines) + "\n"


def _json(functions: DrivingFunctions, _name: str) -> str:
    content = {
        "about": " ".join(_statements(functions)),
        "mechanism": functions.mechanism,
        "motion": functions.motion,
        "units": {"time": "s", "force": "N"},
        "interpolation": str(functions.interpolation),
        "order": len(functions.coefficients),
        "tolerance_rel": functions.tolerance,
        "largest_force_N": functions.largest_force,
        "bound_N": functions.bound,
        "error_N": functions.error,
        "checked_times": functions.checked,
        "bound_holds": "everywhere" if functions.everywhere else "at the samples of the motion",
        "coefficients_are": "[leg][piece][power], highest power first, of t minus the break before",
        "breaks": functions.breaks.tolist(),
        "coefficients": functions.coefficients.transpose(2, 1, 0).tolist(),
    }
    return json.dumps(content, indent=1) + "\n"


_RENDERERS: dict[str, Callable[[DrivingFunctions, str], str]] = {
    "adams": _adams,
    "matlab": _matlab,
    "csv": _csv,
    "json": _json,
}
