"""What the terminal and the report both say of a comparison; computes nothing itself."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from compare.reference import CERTIFIED
from sixsps.errors import printable

_MOST_SINGULAR_SHOWN = 5
# An upper bound of no error is the smallest float, not zero.
_NOTHING = 1e-300
# Beyond so many durations from zero, as with clock time, a time is shown from the start.
_FAR = 1000


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
    asked = [
        name for name, entry in engines.items() if entry["status"] == "unavailable" and entry["requested"]
    ]
    parts = []
    if wrong:
        verb = "disagrees" if len(wrong) == 1 else "disagree"
        parts.append(f"{listed(wrong)} {verb} with {_of_whom(reference)}")
    elif compared and results["universal_joints"]:
        parts.append(_agreement_on_universal_joints(len(compared), results["universal_joints"]))
    elif compared:
        parts.append(_agreement(compared, reference))
    else:
        parts.append("nothing was compared")
    if failed:
        parts.append(f"{listed(failed)} failed")
    if asked:
        parts.append(f"{listed(asked)} not available")
    singular = results["singular_samples"]
    if singular:
        count = len(singular)
        parts.append(f"{count} singular sample{'s' if count > 1 else ''} without forces")
    return "; ".join(parts) + "."


def _agreement(compared: dict[str, Any], reference: str) -> str:
    worst = max(entry["max_rel_error"] for entry in compared.values())
    # The engine that stands in for certified forces agrees with itself.
    count = len(compared) + (reference != CERTIFIED)
    who = f"{count} engines agree" if count > 2 or len(compared) > 1 else f"{listed(compared)} agrees"
    if worst < _NOTHING:
        return f"{who} with {_of_whom(reference)} exactly"
    return f"{who} with {_of_whom(reference)} to {worst:.1e} of the largest leg force"


def _agreement_on_universal_joints(count: int, joints: dict[str, Any]) -> str:
    who = (
        "1 engine on universal joints agrees" if count == 1 else f"{count} engines on universal joints agree"
    )
    left = f"{joints['unexplained_rel']:.1e} of the largest leg force"
    return f"{who} with the reference and the spin of the legs to {left}"


def _of_whom(reference: str) -> str:
    return "the certified forces" if reference == CERTIFIED else reference


def listed(names: Iterable[str]) -> str:
    """Returns names as a list in a sentence."""
    return ", ".join(names)


def verdict(entry: dict[str, Any]) -> str:
    """Returns the status of an engine, or "wrong" where it gave forces outside its tolerance."""
    wrong = entry["status"] == "ok" and entry["within_tolerance"] is False
    return "wrong" if wrong else str(entry["status"])


def reasons(entries: dict[str, Any], motion: dict[str, Any], *, errors: bool = True) -> list[str]:
    """Returns why engines gave nothing and, with `errors`, where they are furthest out of tolerance."""
    lines = [f"{name}: {printable(entry['reason'])}" for name, entry in entries.items() if entry["reason"]]
    for name, entry in entries.items():
        if errors and verdict(entry) == "wrong":
            worst = entry["worst_of_allowed"]
            times = "infinitely many" if worst["ratio"] is None else f"{worst['ratio']:.2g}"
            place = f"at t = {when(worst['t'], motion)} s in leg {worst['leg']}"
            if worst["ratio"] is None or worst["ratio"] > 1:
                lines.append(f"{name}: {place} the error is {times} times what is allowed there")
            else:
                lines.append(f"{name}: more than the spin of its legs explains")
    return lines


def when(time: float, motion: dict[str, Any]) -> str:
    """Returns a time [s], from the start of a motion whose times are far from zero."""
    start, duration = motion["start_s"], motion["end_s"] - motion["start_s"]
    far = abs(start) > _FAR * duration > 0
    return f"+{time - start:.5g}" if far else f"{time:.5g}"


def figures(entry: dict[str, Any], is_reference: bool, motion: dict[str, Any]) -> list[str]:
    """Returns digits, relative and absolute error, time and leg of the largest, time per sample."""
    if entry["max_rel_error"] is None:
        return [""] * 6
    cost = entry["microseconds_per_sample"]
    spent = f"{cost:.1f}" if cost is not None else ""
    if is_reference:
        return ["ref.", "", "", "", "", spent]
    worst = entry["worst"]
    errors = [f"{entry['max_rel_error']:.1e}", f"{entry['max_abs_error_N']:.1e}"]
    return [f"{entry['digits']:.1f}", *errors, when(worst["t"], motion), str(worst["leg"]), spent]


def summary(results: dict[str, Any]) -> list[str]:
    """Returns what is said of the reference and of the mechanism along the motion, line by line."""
    legs, condition = results["legs"], results["max_condition"]
    shortest, longest = _extremes(legs, "length_min_m"), _extremes(legs, "length_max_m")
    lowest, highest = _extremes(legs, "force_min_N"), _extremes(legs, "force_max_N")
    balance = results["power_balance_reason"] or (
        f"{number(results['power_balance_residual'])} of the power exchanged"
    )
    lines = [
        *_payload_lines(results["payload"]),
        _reference_line(results["reference"]),
        f"leg lengths {number(min(shortest, default=None))} to {number(max(longest, default=None))} m, "
        f"forces {number(min(lowest, default=None))} to {number(max(highest, default=None))} N, "
        f"cond(J) up to {number(condition['value'])}",
        f"power balance residual: {balance}",
    ]
    if results["universal_joints"]:
        lines.append(_spin_line(results["universal_joints"]))
    if results["mechanism"]["assumed"]:
        assumed = ", ".join(map(printable, results["mechanism"]["assumed"]))
        lines.append(f"assumed, not given by the source: {assumed}")
    lines += [_violation_line(violation) for violation in results["limit_violations"]]
    return lines + singular_lines(results["singular_samples"])


def _payload_lines(payload: dict[str, Any] | None) -> list[str]:
    if payload is None:
        return []
    what = f"payload: {printable(payload['name'])}, {payload['mass_kg']:.4g} kg"
    if payload["kind"] == "rigid body":
        return [f"{what}, a rigid body that is part of the platform"]
    warnings = [f"payload: {printable(warning)}" for warning in payload["warnings"]]
    force, moment = number(payload["largest_force_N"]), number(payload["largest_moment_Nm"])
    moving = f"{counted(payload['joints'], 'joint')}: {printable(payload['motion']['name'])}"
    return [
        f"{what}, {moving}; its wrench on the platform, up to {force} N and {moment} N m, "
        "is part of the external wrench",
        *warnings,
    ]


def _reference_line(reference: dict[str, Any]) -> str:
    if reference["missing"]:
        return f"errors are against {reference['engine']}, not certified: {printable(reference['missing'])}"
    line = f"errors are true ones, certified at {reference['samples']} samples: {reference['choice']}"
    if not reference["stand_in"]:
        line += "; they confirm no engine, so that nothing is said of the other samples"
    return line


def _spin_line(joints: dict[str, Any]) -> str:
    if joints["spin_abs_N"] is None:
        return "errors are against legs that do not spin; what the spin costs is not known along a first axis"
    cost = f"{joints['spin_abs_N']:.1e} N, {joints['spin_rel']:.1e} of the largest force"
    line = f"errors are against legs that do not spin: on universal joints they do, which costs {cost}"
    if joints["unexplained_rel"] is not None:
        line += f"; without that the errors are {joints['unexplained_rel']:.1e}"
    return line


def _violation_line(violation: dict[str, Any]) -> str:
    return (
        f"leg {violation['leg']} is outside its limit {violation['limit_m']:g} m at "
        f"{violation['samples']} samples, worst {violation['length_m']:.6g} m at t = {violation['t']:.10g} s"
    )


def _extremes(legs: list[dict[str, Any]], key: str) -> list[float]:
    return [leg[key] for leg in legs if leg[key] is not None]


def number(value: float | None, digits: int = 4) -> str:
    """Returns a number with so many digits, or "none"."""
    return "none" if value is None else f"{value:.{digits}g}"


def counted(count: int, thing: str) -> str:
    """Returns a number of things in words, as "1 joint" or "2 joints"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def singular_lines(samples: list[dict[str, Any]]) -> list[str]:
    """Returns one line for each of the first singular samples, and how many more there are."""
    lines = []
    for sample in samples[:_MOST_SINGULAR_SHOWN]:
        condition = "infinite" if sample["condition"] is None else f"{sample['condition']:.1e}"
        lines.append(
            f"sample {sample['sample']} at t = {sample['t']:.10g} s is singular: "
            f"cond(J) is {condition}, no forces"
        )
    if len(samples) > _MOST_SINGULAR_SHOWN:
        lines.append(f"and {len(samples) - _MOST_SINGULAR_SHOWN} more singular samples")
    return lines
