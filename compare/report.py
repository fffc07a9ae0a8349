"""`results.json` to a Markdown report and a table for the terminal; computes nothing itself."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from compare.certification import CHOICE
from sixsps.errors import printable

_MOST_SINGULAR_SHOWN = 5
_NO_FIGURE = 'Without a picture: matplotlib is not installed (`pip install "sixsps[figures]"`).'
_LIMITATIONS = (
    "The reference of the table is one of the formulations that are compared, in double precision: an error "
    "smaller than its bound cannot be told from the reference's own. True errors are proven, by ball "
    "arithmetic from a derivation of its own, at some samples only: " + CHOICE + ".",
    "Legs are rigid, symmetric about their axes and do not spin; joints have no friction and no play.",
    "Length limits never change the forces of a given motion, samples outside are flagged; bundled motions "
    "and --fit are sized by them.",
    "Which samples are singular is decided by the leg kinematics of `kane`; no engine is given those.",
    "The power balance takes the rate of energy from the CasADi model.",
)


def answer(results: dict[str, Any]) -> str:
    """Returns the outcome of a comparison in one sentence."""
    engines, reference = results["engines"], results["reference"]["engine"]
    compared = {
        name: entry
        for name, entry in engines.items()
        if entry["max_rel_error"] is not None and name != reference
    }
    wrong = [name for name, entry in engines.items() if entry["within_tolerance"] is False]
    failed = [name for name, entry in engines.items() if entry["status"] == "failed"]
    missing = [name for name, entry in engines.items() if entry["status"] == "unavailable"]
    parts = []
    if wrong:
        parts.append(f"{_list(wrong)} {'disagrees' if len(wrong) == 1 else 'disagree'} with {reference}")
    elif compared:
        worst = max(entry["max_rel_error"] for entry in compared.values())
        count = len(compared) + 1
        who = f"{count} engines agree" if count > 2 else f"{_list(compared)} agrees with {reference}"
        parts.append(f"{who} to {worst:.1e} of the largest leg force")
    else:
        parts.append("nothing was compared")
    if failed:
        parts.append(f"{_list(failed)} failed")
    if missing:
        parts.append(f"{_list(missing)} not available")
    singular = results["singular_samples"]
    if singular:
        count = len(singular)
        parts.append(f"{count} singular sample{'s' if count > 1 else ''} without forces")
    return "; ".join(parts) + "."


def _list(names: Iterable[str]) -> str:
    return ", ".join(names)


def terminal(results: dict[str, Any]) -> Group:
    """Returns what a person at a terminal sees: the engines, then the mechanism, in 80 columns."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column("engine", no_wrap=True)
    for heading in ("digits", "relative", "error N", "t [s]", "leg", "us"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("version", no_wrap=True)
    table.add_column("", no_wrap=True)
    notes = []
    for name, entry in results["engines"].items():
        figures = _figures(entry, name == results["reference"]["engine"])
        word, style = _VERDICTS[_verdict(entry)]
        table.add_row(name, *figures, entry["version"] or "", Text(word, style=style))
        if entry["reason"]:
            notes.append(Text(f"{name}: {printable(entry['reason'])}"))
    lines = [Text(line) for line in _summary(results)]
    return Group(table, Text(), *notes, *lines)


_VERDICTS = {
    "ok": ("ok", "green"),
    "wrong": ("WRONG", "bold red"),
    "failed": ("FAILED", "bold red"),
    "unavailable": ("absent", "yellow"),
}


def _verdict(entry: dict[str, Any]) -> str:
    wrong = entry["status"] == "ok" and entry["within_tolerance"] is False
    return "wrong" if wrong else str(entry["status"])


def _figures(entry: dict[str, Any], is_reference: bool) -> list[str]:
    """Returns digits, relative and absolute error, time and leg of the largest, time per sample."""
    if entry["max_rel_error"] is None:
        return [""] * 6
    cost = entry["microseconds_per_sample"]
    spent = f"{cost:.1f}" if cost is not None else ""
    if is_reference:
        return ["ref.", "", "", "", "", spent]
    worst = entry["worst"]
    errors = [f"{entry['max_rel_error']:.1e}", f"{entry['max_abs_error_N']:.1e}"]
    return [f"{entry['digits']:.1f}", *errors, f"{worst['t']:.5g}", str(worst["leg"]), spent]


def _summary(results: dict[str, Any]) -> list[str]:
    legs, condition = results["legs"], results["max_condition"]
    shortest, longest = _extremes(legs, "length_min_m"), _extremes(legs, "length_max_m")
    lowest, highest = _extremes(legs, "force_min_N"), _extremes(legs, "force_max_N")
    balance = results["power_balance_reason"] or (
        f"{_number(results['power_balance_residual'])} of the power exchanged"
    )
    lines = [
        _certified_line(results["certified"]),
        f"leg lengths {_number(min(shortest, default=None))} to {_number(max(longest, default=None))} m, "
        f"forces {_number(min(lowest, default=None))} to {_number(max(highest, default=None))} N, "
        f"cond(J) up to {_number(condition['value'])}",
        f"power balance residual: {balance}",
    ]
    if results["mechanism"]["assumed"]:
        lines.append("assumed, not given by the source: " + ", ".join(results["mechanism"]["assumed"]))
    lines += [_violation_line(violation) for violation in results["limit_violations"]]
    return lines + singular_lines(results["singular_samples"])


def _certified_line(certified: dict[str, Any]) -> str:
    if certified["reason"]:
        return f"no certified errors: {printable(certified['reason'])}"
    errors = ", ".join(f"{name} {error:.1e}" for name, error in certified["engines"].items())
    return f"true errors at {certified['samples']} certified samples: {errors}"


def _violation_line(violation: dict[str, Any]) -> str:
    return (
        f"leg {violation['leg']} is outside its limit {violation['limit_m']:g} m at "
        f"{violation['samples']} samples, worst {violation['length_m']:.6g} m at t = {violation['t']:g} s"
    )


def _extremes(legs: list[dict[str, Any]], key: str) -> list[float]:
    return [leg[key] for leg in legs if leg[key] is not None]


def _number(value: float | None, digits: int = 4) -> str:
    return "none" if value is None else f"{value:.{digits}g}"


def _span(leg: dict[str, Any], name: str, unit: str) -> str:
    low, high = (_number(leg[f"{name}_{end}_{unit}"], 6) for end in ("min", "max"))
    return f"{low} to {high}"


def singular_lines(samples: list[dict[str, Any]]) -> list[str]:
    """Returns one line for each of the first singular samples, and how many more there are."""
    lines = []
    for sample in samples[:_MOST_SINGULAR_SHOWN]:
        condition = "infinite" if sample["condition"] is None else f"{sample['condition']:.1e}"
        lines.append(
            f"sample {sample['sample']} at t = {sample['t']:g} s is singular: "
            f"cond(J) is {condition}, no forces"
        )
    if len(samples) > _MOST_SINGULAR_SHOWN:
        lines.append(f"and {len(samples) - _MOST_SINGULAR_SHOWN} more singular samples")
    return lines


def markdown(results: dict[str, Any], figure: str | None = None) -> str:
    """Returns the report as Markdown.

    Args:
        results: content of `results.json`.
        figure: file name of a picture beside the report.
    """
    mechanism, motion = results["mechanism"], results["motion"]
    sections = [
        f"# Leg forces of {_escaped(mechanism['name'])} along {_escaped(motion['name'])}",
        f"**{_escaped(answer(results))}**",
        f"![Hexapod, leg forces and differences between engines]({figure})" if figure else _NO_FIGURE,
        _engines(results),
        _failures(results),
        "## How each engine works",
        _methods(results),
        "## The mechanism along the motion",
        _legs(results),
        "\n".join(f"- {_escaped(line)}" for line in _summary(results)),
        "## Inputs",
        _inputs(results),
        "## Known limitations",
        "\n".join(f"- {line}" for line in _LIMITATIONS),
        "## Reproduce",
        _reproduce(results),
    ]
    return "\n\n".join(section for section in sections if section) + "\n"


def _engines(results: dict[str, Any]) -> str:
    header = (
        "engine", "version", "digits", "relative error", "allowed", "largest error [N]", "at t [s]", "leg",
        "closure residual", "closure error [m]", "time per sample [us]", "status",
    )  # fmt: skip
    reference = results["reference"]
    rows = []
    for name, entry in results["engines"].items():
        digits, relative, absolute, when, leg, cost = _figures(entry, name == reference["engine"])
        verdict = _verdict(entry)
        rows.append(
            (
                name, entry["version"] or "", digits, relative, f"{entry['tolerance_rel']:.1e}", absolute,
                when, leg, _small(entry["closure_residual"]), _small(entry["closure_error_m"]), cost,
                "**disagrees**" if verdict == "wrong" else verdict,
            )
        )  # fmt: skip
    note = (
        f"Errors are against `{reference['engine']}`, whose own rounding error is below "
        f"{reference['bound']:.1e} relative ({reference['reason']}). Relative error: largest difference "
        "over all samples and legs, divided by the largest reference force; the verdict is made sample by "
        "sample, and `allowed` is the largest of the samples' tolerances. Closure residual: what actuator "
        "and closure forces leave of the open tree's generalised forces [N, N m]."
    )
    return _table(header, rows) + "\n\n" + note


def _small(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _failures(results: dict[str, Any]) -> str:
    reasons = [(name, entry["reason"]) for name, entry in results["engines"].items() if entry["reason"]]
    return "\n".join(f"- {name}: {_escaped(reason)}" for name, reason in reasons)


def _methods(results: dict[str, Any]) -> str:
    header = ("engine", "formulation", "loops", "shares with others")
    rows = [
        (name, entry["formulation"] or "", entry["loops"] or "", entry["shares"] or "")
        for name, entry in results["engines"].items()
    ]
    return _table(header, rows)


def _legs(results: dict[str, Any]) -> str:
    header = ("leg", "length [m]", "length rate [m/s]", "force [N]")
    rows = [
        (
            str(leg["leg"]),
            _span(leg, "length", "m"),
            _span(leg, "length_rate", "m_s"),
            _span(leg, "force", "N"),
        )
        for leg in results["legs"]
    ]
    condition = results["max_condition"]
    note = (
        f"Largest cond(J): {_number(condition['value'])} at t = {condition['t']:g} s, moments divided "
        f"by {condition['characteristic_length_m']:.4g} m."
    )
    return _table(header, rows) + "\n\n" + note


def _inputs(results: dict[str, Any]) -> str:
    mechanism, motion = results["mechanism"], results["motion"]
    lines = [f"- Mechanism `{_code(mechanism['name'])}`, SHA-256 of its numbers `{mechanism['sha256']}`."]
    if mechanism["source"]:
        lines.append(f"- Given by: {_escaped(mechanism['source'])}.")
    for key, why in mechanism["assumed"].items():
        lines.append(f"- Assumed, not given: `{_code(key)}`: {_escaped(why)}.")
    lines.append(
        f"- Motion `{_code(motion['name'])}`, {motion['samples']} samples from {motion['start_s']:g} to "
        f"{motion['end_s']:g} s, SHA-256 of its numbers `{motion['sha256']}`."
    )
    lines += [f"- Changed: {_escaped(change)}." for change in motion["changes"]]
    for quantity, how in motion["estimated"].items():
        lines.append(f"- Estimated from the poses, not given: {quantity}: {_escaped(how)}.")
    return "\n".join(lines)


def _reproduce(results: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in results["versions"].items())
    machine = results["machine"]
    lines = [f"    {results['command']}"] if results.get("command") else []
    lines.append(
        f"{results['created']}, {versions}; {machine['system']}, {machine['architecture']}, "
        f"{machine['cores']} cores."
    )
    return "\n\n".join(lines)


def _table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(header)
    lines = [head, ["---"] * len(head), *(list(row) for row in rows)]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in lines)


def _cell(text: str) -> str:
    return text if text == "---" or text.startswith("**") else _escaped(text)


def _escaped(text: str) -> str:
    """Returns text that Markdown and HTML show as it is."""
    safe = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|#])", r"\\\1", safe)


def _code(text: str) -> str:
    """Returns text that is safe between single backticks."""
    return text.replace("`", "'").replace("|", "\\|")
