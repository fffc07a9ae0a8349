"""What `sixsps check` shows a person, in 80 columns."""

from __future__ import annotations

import textwrap
from typing import Any

from compare.check import Check, Violation
from compare.check_report import BETWEEN, mapping
from compare.summary import when
from sixsps.errors import printable
from sixsps.margins import LIMITS

_MOST_SHOWN = 20
# Condition numbers of useful mechanisms are tens or hundreds in random poses; the anchors of an architecture
# singularity with three digits after the point come to thousands.
_NEARLY_SINGULAR = 1e4
_LEAST = {LIMITS[key] for key in ("min_length", "min_force", "clearance")}


def table(found: Check) -> str:
    """Returns the results for a reader, in 80 columns."""
    content = mapping(found)
    motion = content["motion"]
    first, last = (when(motion[end], motion) for end in ("start_s", "end_s"))
    what = f"{printable(found.mechanism.name)[:24]} along {printable(found.motion.name)[:24]}"
    lines = [f"{what}: {motion['samples']} samples, {first} to {last} s"]
    if first.startswith("+"):
        lines.append(f"times count from {motion['start_s']!r} s")
    lines += _margins(content) + _violations(content, found.violations) + _poses(content)
    lines += ["", *_wrapped(BETWEEN), _answer(found)]
    return "\n".join(lines) + "\n"


def _margins(content: dict[str, Any]) -> list[str]:
    limits, motion = content["limits"], content["motion"]
    checked = {key: entry for key, entry in limits.items() if entry["checked"]}
    lines = []
    if checked:
        heading = f"{'least margin to':<21}{'leg':>5}{'t [s]':>12}{'value':>12}{'allowed':>16}{'margin':>13}"
        lines += ["", heading]
    for entry in checked.values():
        name = f"{entry['name']} [{entry['unit']}]"
        if entry["least_margin"] is None:
            lines.append(f"{name:<21}{'no value at any sample':>24}")
            continue
        sign = ">=" if entry["name"] in _LEAST else "<="
        allowed = entry["allowed"][entry["legs"].index(entry["leg"])]
        lines.append(
            f"{name:<21}{entry['leg']:>5}{when(entry['t'], motion):>12}{entry['value']:>12.5g}"
            f"{sign:>4}{allowed:>12.5g}{entry['least_margin']:>13.4g}"
        )
    if content["forces_by"]:
        lines.append(f"forces by {content['forces_by']}")
    reasons: dict[str, list[str]] = {}
    for entry in limits.values():
        if not entry["checked"]:
            reasons.setdefault(entry["reason"], []).append(entry["name"])
    for reason, names in reasons.items():
        lines += _wrapped(f"not checked, {reason}: {', '.join(names)}")
    return lines


def _violations(content: dict[str, Any], violations: list[Violation]) -> list[str]:
    if not violations:
        return []
    motion = content["motion"]
    heading = f"{'violated':<17}{'leg':>4}{'from':>12}{'to':>12}{'worst at':>12}{'value':>11}{'allowed':>11}"
    lines = ["", heading]
    for violation in violations[:_MOST_SHOWN]:
        times = (when(t, motion) for t in (violation.start, violation.end, violation.worst))
        value = "none" if violation.value is None else f"{violation.value:.4g}"
        shown = "".join(f"{t:>12}" for t in times) + f"{value:>11}{violation.allowed:>11.4g}"
        lines.append(f"{LIMITS[violation.limit]:<17}{violation.leg:>4}{shown}")
        if not violation.samples:
            lines.append(f"{'between samples':>79}")
    others = len(violations) - _MOST_SHOWN
    return lines + ([f"and {others} more, which --output FILE.csv lists"] if others > 0 else [])


def _poses(content: dict[str, Any]) -> list[str]:
    found, motion = content["singularity"], content["motion"]
    largest, size = found["largest_condition"], found["characteristic_length_m"]
    condition = "infinite" if largest is None else f"{largest:.5g}"
    at = when(found["largest_condition_t"], motion)
    text = f"condition number up to {condition} at t = {at} s, characteristic length {size:.4g} m"
    lines = ["", *_wrapped(text)]
    for run in found["singular_samples"][:_MOST_SHOWN]:
        start, end = when(run["start"], motion), when(run["end"], motion)
        lines.append(f"SINGULAR at {run['samples']} samples, t = {start} to {end} s")
    for crossing in found["crossings"][:_MOST_SHOWN]:
        sample = crossing["after_sample"]
        lines.append(f"SINGULAR POSE CROSSED at t = {when(crossing['t'], motion)} s, after sample {sample}")
    for run in found["not_ruled_out"][:_MOST_SHOWN]:
        start, end = when(run["start"], motion), when(run["end"], motion)
        lines.append(f"touching a singular pose is not ruled out from t = {start} to {end} s")
    best = found["best_random_condition"]
    if best > _NEARLY_SINGULAR:
        lines += _wrapped(
            f"NEARLY SINGULAR IN EVERY POSE by its anchors: {best:.2g} in the best of random ones"
        )
    if found["least_distance_m"] is None:
        return [*lines, "no singular pose was found"]
    at, free = when(found["least_distance_t"], motion), found["none_within_m"]
    text = (
        f"nearest singular pose found: {found['least_distance_m']:.4g} m away at t = {at} s, none within "
        f"{free:.4g} m of there "
        f"(rotations times the characteristic length; sought at {found['distance_samples']} samples)"
    )
    return lines + _wrapped(text)


def _answer(found: Check) -> str:
    parts = []
    if found.violations:
        number = len(found.violations)
        parts.append(f"{number} violation{'s' if number > 1 else ''}")
    crossed = len(found.crossings.time)
    if crossed:
        parts.append(f"{crossed} singular pose{'s' if crossed > 1 else ''} crossed")
    if len(found.crossings.singular_samples):
        count = len(found.crossings.singular_samples)
        parts.append(f"{count} singular sample{'s' if count > 1 else ''}")
    near = len(found.crossings.undecided)
    if near:
        parts.append(f"{near} step{'s' if near > 1 else ''} between samples too close to a singular pose")
    if parts:
        return "; ".join(parts) + "."
    return "All limits that are given are kept." if found.margins.limits else "No limits are given."


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, 79, subsequent_indent="  ", break_on_hyphens=False)
