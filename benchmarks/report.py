"""`results.json` to a Markdown report; measures nothing itself."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks import sections
from benchmarks.figures import Results, Spread, all_threads, noise, ratios, row
from benchmarks.limits import LIMITS
from benchmarks.naming import FAST, KANE, ONE_BY_ONE, PINOCCHIO, RNEA, VECTORISED, on_threads
from benchmarks.tables import duration, spread, table
from sixsps.errors import InputError
from sixsps.files import check_readable

# The full table comes after it.
_SHOWN = (FAST, VECTORISED, KANE, "casadi", RNEA, PINOCCHIO, "mujoco", "drake")
_QUICK = "A quick run shows that everything works; its figures are not to be quoted."


def read(path: Path) -> Results:
    """Returns the results in a file.

    Raises:
        InputError: the file is missing, or is no such file.
    """
    check_readable(path, "--report", InputError)
    try:
        results = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError("--report", str(error), "JSON", str(path)) from None
    wanted = ("plan", "machine", "disturbance", *(name for name, _ in sections.ALL.values()))
    for part in wanted:
        if not isinstance(results, dict) or part not in results:
            raise InputError("--report", f"no entry {part}", "results of a benchmark", str(path))
    return dict(results)


def markdown(results: Results) -> str:
    """Returns the report."""
    parts = ["# Speed of sixsps", *([_QUICK] if results["plan"] == "quick" else []), conditions(results)]
    parts += ["## In short", short(results), "## What is asked for", asked(results)]
    for heading, (_, section) in sections.ALL.items():
        parts += [f"## {heading}", section(results)]
    return "\n\n".join(parts) + "\n"


def conditions(results: Results) -> str:
    """Returns what was measured on what, and how undisturbed it was."""
    machine, turn = results["machine"], f"{results['turn_s']:g} s"
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    lines = [
        f"{machine['date']}; {machine['processor']}, {machine['processors']} processors for this run, "
        f"{machine['vector_bits']}-bit vectors, last cache {_size(machine['last_cache_bytes'])}, memory "
        f"{_size(machine['memory_bytes'])}; {machine['system']}",
        f"{versions}; digest of the kernels' sources {machine['sources']}",
        f"motion `{results['motion']}` of `{results['mechanism']}`, float64, no singular pose; engines have "
        "one thread each and share a process, but for OpenSim, which cannot share it with CasADi",
        f"{results['rounds']} rounds, in which all have their turn of at least {turn}; medians, in "
        "parentheses the range over the rounds; ratios are taken within a round",
        f"noise: the loop of vector arithmetic on one thread took {spread(noise(results))} times its fastest "
        f"over the run; {_busy(results['disturbance'])}",
    ]
    return "\n".join(f"- {line}" for line in lines)


def _size(count: int | None) -> str:
    return f"{count / 2**20:.0f} MiB" if count else "unknown"


def _busy(disturbance: Results) -> str:
    if disturbance["others_share"] is None:
        return "how busy others kept the machine is not known"
    others, stolen = (100 * disturbance[f"{whose}_share"] for whose in ("others", "stolen"))
    before, after = (disturbance[f"load_average_{when}"][0] for when in ("before", "after"))
    return (
        f"other processes took {others:.0f} % of the processors, other machines on the same host "
        f"{stolen:.1f} %; load average {before:.1f} before, {after:.1f} after"
    )


def short(results: Results) -> str:
    """Returns the table that the README shows."""
    fastest = row(results, "batch", on_threads(FAST, all_threads(results)))["ns_per_sample"]
    one = row(results, "latency", FAST)
    calls = {entry["name"]: entry for entry in results["latency"]["rows"] if "reason" not in entry}
    renamed = {on_threads(FAST, 1): FAST, ONE_BY_ONE: "casadi"}
    rows = []
    for entry in results["batch"]["rows"]:
        if "reason" in entry or entry["name"].split(",")[0] not in _SHOWN:
            continue
        times = entry["ns_per_sample"]
        cells: tuple[str, ...] = ()
        call = calls.get(renamed.get(entry["name"], entry["name"]))
        if call:
            ratio = spread(ratios(call["median_ns"], one["median_ns"]))
            cells = (duration(call["ns"]["50 %"]), duration(call["ns"]["99.9 %"]), ratio)
        along = (duration(Spread.of(times).median), spread(ratios(times, fastest)))
        rows.append((f"`{entry['name']}`", entry["what"], *along, *cells))
    most = on_threads("`fast`", all_threads(results))
    header = ("", "what", "a sample of a motion", f"over {most}", "one call", "99.9 % within", "over `fast`")
    return table(header, rows, words=2)


def asked(results: Results) -> str:
    """Returns the table of what the design asks for."""
    rows = []
    for limit in LIMITS:
        figure = limit.figure(results)
        bound = f"{'at most' if limit.most else 'at least'} {limit.bound:g} {limit.unit}".rstrip()
        if isinstance(figure, str):
            rows.append((limit.what, bound, f"not measured: {figure}", ""))
        else:
            rows.append((limit.what, bound, spread(figure), "yes" if limit.met(figure) else "**no**"))
    return table(("", "asked", "measured", "met"), rows)
