"""The report's section on forward kinematics."""

from __future__ import annotations

from benchmarks.figures import Results, Spread
from benchmarks.tables import duration, number, spread, table


def forward_kinematics(results: Results) -> str:
    """Returns throughput, single calls, and what became of random poses of whole workspaces."""
    part = results["forward_kinematics"]
    return "\n\n".join([_followed(part), _calls(part), _workspaces(part)])


def _followed(part: Results) -> str:
    rows = []
    for entry in part["rows"]:
        rate = Spread.of([1e3 / ns for ns in entry["ns_per_sample"]])
        rows.append(
            (entry["name"], str(entry["samples"]), spread(Spread.of(entry["ns_per_sample"])), spread(rate))
        )
    header = ("", "samples", "ns a sample", "million poses a second")
    return (
        f"{table(header, rows)}\n\nLengths each millisecond of a motion of two seconds, forth and back; "
        "each pose from the one before, the first from home."
    )


def _calls(part: Results) -> str:
    rows = [
        (entry["name"], entry["what"], str(entry["calls"]), *(duration(ns) for ns in entry["ns"].values()))
        for entry in part["calls"]
    ]
    header = ("one call", "what", "calls", "median", "99 % within", "99.9 % within", "all within")
    return table(header, rows, words=2)


def _workspaces(part: Results) -> str:
    rows = []
    for entry in part["workspaces"]:
        counts = [str(count) for count in entry["status"].values()]
        figures = (f"{entry[name]:.1e}" for name in ("error", "residual"))
        median, most = entry["iterations"]
        rest = (number(entry["condition"]), number(entry["error_over_condition"]), f"{median:g}, {most}")
        rows.append(
            (
                f"`{entry['mechanism']}`",
                entry["guess"],
                str(entry["poses"]),
                *counts,
                str(entry["others"]),
                *figures,
                *rest,
            )
        )
    statuses = tuple(part["workspaces"][0]["status"])
    header = ("", "from", "poses", *statuses, "another pose", "error", "residual", "cond(J) up to")
    drawn = ", ".join(
        f"{number(100 * share)} % for `{name}`"
        for name, share in {row["mechanism"]: row["share_of_drawn"] for row in part["workspaces"]}.items()
    )
    return (
        f"{table((*header, 'error over cond(J) x roundoff', 'iterations'), rows, words=2)}\n\n"
        "Random poses with all legs within their strokes: positions evenly from a cube of two strokes about "
        "home, turned by angles evenly up to half a radian about even axes, kept where a straight way from "
        "home keeps the sign and a hundredth of det J. Of what was drawn that left "
        f"{drawn}. Error: largest distance of a pose that is ok from the one drawn, in sizes of the platform "
        "(root mean square distance of its anchors) and radians; residual in sizes. Another pose: ok, and "
        "further than 1e-6. A warm start is the pose at 19 twentieths of the straight way from home. "
        "Iterations: median, most."
    )
