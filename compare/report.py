"""`results.json` to a Markdown report; computes nothing itself."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from compare.summary import answer, counted, figures, number, reasons, summary, verdict
from sixsps.errors import printable

_NO_FIGURE = 'Without a picture: matplotlib is not installed (`pip install "sixsps[figures]"`).'
_UPRIGHT = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
_LIMITATIONS = (
    "Legs are rigid, symmetric about their axes and do not spin; joints have no friction and no play.",
    "Length limits never change the forces of a given motion, samples outside are flagged; bundled motions "
    "and --fit are sized by them.",
    "Which samples are singular is decided by the leg kinematics of `kane`; no engine is given those.",
    "The power balance takes the rate of energy from the CasADi model.",
)
_UPS = (
    "Legs on universal joints are another mechanism. A leg on ball joints that does not spin about its axis "
    "never will; a universal joint makes it turn about its axis as it swings, and exerts the moment that its "
    "axial inertia needs for that. This moment is square to both axes of the joint, not along the leg: a "
    "part of it bends the leg and reaches the actuators. The difference is therefore physical, and in "
    "proportion to the axial inertia. The errors in the table are against legs that do not spin; an "
    "engine is also held to what is left of them when the spin's forces, known in closed form, are taken off."
)

_RIGID = (
    "The payload and the platform are one rigid body: their masses, centres of mass and inertias are "
    "combined before any engine is given the mechanism, and the external wrench of the motion is restated "
    "at the common centre of mass."
)
_ROBOT = (
    "The robot's wrench on the platform is computed once, by Pinocchio's RNEA of the robot alone on a base "
    "that moves with the platform, and added to the external wrench of the motion. This is what all engines "
    "of the mechanism are given, and what the certified forces are certified for. "
)
_WRENCH_CHECKED = (
    "Only `pinocchio-payload` is given no such wrench: to it hexapod and robot are one tree. Its agreement "
    "is the check of the wrench."
)
_WRENCH_UNCHECKED = (
    "Nothing here checks the wrench itself: that would be `pinocchio-payload`, to which hexapod and robot "
    "are one tree."
)


def markdown(results: dict[str, Any], figure: str | None = None) -> str:
    """Returns the report as Markdown.

    Args:
        results: content of `results.json`.
        figure: file name of a picture beside the report.
    """
    mechanism, motion, payload = results["mechanism"], results["motion"], results["payload"]
    carrying = f" with {_escaped(payload['name'])} aboard" if payload else ""
    sections = [
        f"# Leg forces of {_escaped(mechanism['name'])} along {_escaped(motion['name'])}{carrying}",
        f"**{_escaped(answer(results))}**",
        f"![Hexapod, leg forces and differences between engines]({figure})" if figure else _NO_FIGURE,
        _engines(results),
        _failures(results),
        _payload(payload, results["engines"]),
        _universal_joints(results),
        _traps(results),
        "## How each engine works",
        _methods(results),
        "## The mechanism along the motion",
        _legs(results),
        "\n".join(f"- {_escaped(line)}" for line in summary(results)),
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
    reference, motion = results["reference"], results["motion"]
    rows = []
    for name, entry in results["engines"].items():
        digits, relative, absolute, when, leg, cost = figures(entry, name == reference["engine"], motion)
        judged = verdict(entry)
        rows.append(
            (
                name, entry["version"] or "", digits, relative, f"{entry['tolerance_rel']:.1e}", absolute,
                when, leg, _small(entry["closure_residual"]), _small(entry["closure_error_m"]), cost,
                "**disagrees**" if judged == "wrong" else judged,
            )
        )  # fmt: skip
    return _table(header, rows) + "\n\n" + _note(reference)


def _note(reference: dict[str, Any]) -> str:
    if reference["missing"]:
        whose = (
            f"Errors are against `{reference['engine']}` at all samples, whose own rounding error is below "
            f"{reference['bound']:.1e} relative ({reference['reason']}). Nothing is certified: "
            f"{_escaped(reference['missing'])}."
        )
    else:
        whose = (
            f"Errors are true errors: at {reference['samples']} samples ({reference['choice']}) the forces "
            f"are enclosed in ball arithmetic to {reference['bound']:.0e} of the sample's largest, from "
            "positions alone, by a derivation that shares no formula with `kane`. Digits are correct "
            f"digits. {_elsewhere(reference['stand_in'])}"
        )
    return (
        f"{whose} Relative error: largest error over samples and legs, divided by the largest force of the "
        "motion; the verdict is made sample by sample, and `allowed` is the largest of the samples' "
        "tolerances. Closure residual: what actuator and closure forces leave of the open tree's generalised "
        "forces [N, N m]."
    )


def _elsewhere(stand_in: str) -> str:
    if not stand_in:
        return "They confirm no engine, so that nothing is said of the other samples."
    return f"At the other samples the verdict is against `{stand_in}`, which the certified ones confirm."


def _traps(results: dict[str, Any]) -> str:
    if not results["traps"]:
        return ""
    rows = []
    for name, entry in results["traps"].items():
        _, relative, absolute, when, leg, _ = figures(entry, False, results["motion"])
        shown = entry["why"] + (" On this motion it does no harm." if entry["within_tolerance"] else "")
        if entry["status"] != "ok":
            shown = f"{entry['status']}: {entry['reason']}"
        rows.append((name, entry["version"] or "", relative, absolute, when, leg, shown))
    header = ("call", "version", "relative error", "largest error [N]", "at t [s]", "leg", "why")
    intro = "Calls that people reach for, wrong without a word. They count for nothing in the verdict."
    return "## Traps\n\n" + intro + "\n\n" + _table(header, rows)


def _universal_joints(results: dict[str, Any]) -> str:
    if results["leg_type"] != "ups":
        return ""
    joints = results["universal_joints"]
    cost = (
        f"Along this motion the spin costs up to {joints['spin_abs_N']:.1e} N, {joints['spin_rel']:.1e} of "
    )
    cost += "the largest force."
    if joints["unexplained_rel"] is not None:
        cost += f" Without it the largest error is {joints['unexplained_rel']:.1e}."
    return f"## Universal joints\n\n{_UPS} {cost}"


def _payload(payload: dict[str, Any] | None, engines: dict[str, Any]) -> str:
    if payload is None:
        return ""
    if payload["kind"] == "rigid body":
        return f"## Payload\n\n{_RIGID}"
    checked = engines.get("pinocchio-payload", {}).get("max_rel_error") is not None
    return f"## Payload\n\n{_ROBOT}{_WRENCH_CHECKED if checked else _WRENCH_UNCHECKED}"


def _small(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _failures(results: dict[str, Any]) -> str:
    return "\n".join(f"- {_escaped(line)}" for line in reasons(results["engines"], results["motion"]))


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
        f"Largest cond(J): {number(condition['value'])} at t = {condition['t']:g} s, moments divided "
        f"by {condition['characteristic_length_m']:.4g} m."
    )
    return _table(header, rows) + "\n\n" + note


def _span(leg: dict[str, Any], name: str, unit: str) -> str:
    low, high = (number(leg[f"{name}_{end}_{unit}"], 6) for end in ("min", "max"))
    return f"{low} to {high}"


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
    lines += _payload_inputs(results["payload"])
    lines += [f"- Changed: {_escaped(change)}." for change in motion["changes"]]
    for quantity, how in motion["estimated"].items():
        lines.append(f"- Estimated from the poses, not given: {quantity}: {_escaped(how)}.")
    return "\n".join(lines)


def _payload_inputs(payload: dict[str, Any] | None) -> list[str]:
    if payload is None:
        return []
    line = f"- Payload `{_code(payload['name'])}`, {payload['mass_kg']:.6g} kg, "
    if payload["kind"] == "rigid body":
        return [f"{line}a rigid body, SHA-256 of its numbers `{payload['sha256']}`."]
    motion = payload["motion"]
    x, y, z = payload["mount"]["position_m"]
    turned = ", turned" if payload["mount"]["rotation"] != _UPRIGHT else ""
    joints = counted(payload["joints"], "joint")
    lines = [
        f"{line}a robot of {joints} with its base at {x:g}, {y:g}, {z:g} m in the platform frame"
        f"{turned}; SHA-256 of its URDF file `{payload['sha256']}`.",
        f"- Motion of its joints: {_escaped(motion['name'])}, SHA-256 of its samples `{motion['sha256']}`.",
    ]
    if motion["estimated"]:
        lines.append(f"- Estimated from its joint positions: {_escaped(motion['estimated'])}.")
    return lines


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
    """Returns text that Markdown and HTML show as it is, on one line."""
    safe = printable(" ".join(text.split())).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", safe)


def _code(text: str) -> str:
    """Returns text that is safe between single backticks."""
    return printable(text).replace("`", "'").replace("|", "\\|")
