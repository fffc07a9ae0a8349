"""The report's sections, one a part of the results."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.figures import (
    Results,
    Spread,
    all_threads,
    ratios,
    row,
    share_allowed,
    share_of_arithmetic,
    slots,
)
from benchmarks.limits import START_UP
from benchmarks.naming import EXACT, FAST, FORCES, MEMORY, PEAK, TRIAD, on_threads
from benchmarks.pose_section import forward_kinematics
from benchmarks.tables import duration, missing, number, percent, spread, table

_STEPS = {
    "import": "import",
    "load": "`Mechanism.load`",
    "compile": "`sixsps.compile`",
    "first": "first `leg_forces`",
}


def batch(results: Results) -> str:
    """Returns throughput."""
    one, most = (
        row(results, "batch", on_threads(FAST, n))["ns_per_sample"] for n in (1, all_threads(results))
    )
    rows: list[tuple[str, ...]] = []
    for entry in results["batch"]["rows"]:
        if "reason" in entry:
            rows.append(missing(entry))
            continue
        times, difference = entry["ns_per_sample"], entry["difference"]
        words = (f"`{entry['name']}`", entry["what"], entry["version"], str(entry["samples"]))
        compared = (spread(ratios(times, one)), spread(ratios(times, most)))
        shown = "" if difference is None else f"{difference:.1e}"
        rows.append((*words, spread(Spread.of(times)), *compared, shown))
    header = (
        "",
        "what",
        "version",
        "samples",
        "ns a sample",
        "over `fast`, 1 thread",
        "over `fast`, all threads",
    )
    return (
        f"{table((*header, 'difference'), rows, words=3)}\n\n"
        "From the arrays of a motion to a new array of forces; samples evenly spread over the same motion. "
        "The difference is the largest from `kane` over the largest force."
    )


def latency(results: Results) -> str:
    """Returns how long single calls take."""
    fast = row(results, "latency", FAST)["median_ns"]
    rows = []
    for entry in results["latency"]["rows"]:
        if "reason" in entry:
            rows.append(missing(entry))
            continue
        times = [duration(ns) for ns in entry["ns"].values()]
        ratio = spread(ratios(entry["median_ns"], fast))
        rows.append((f"`{entry['name']}`", entry["what"], str(entry["calls"]), *times, ratio))
    header = ("", "what", "calls", "median", "99 % within", "99.9 % within", "all within", "over `fast`")
    clock = duration(results["latency"]["clock_ns"])
    return f"{table(header, rows, words=2)}\n\nTo read the clock takes {clock}; it is left in."


def derivatives(results: Results) -> str:
    """Returns what exact derivatives cost."""
    part = results["derivatives"]
    forces, exact = (row(results, "derivatives", name)["ns_per_sample"] for name in (FORCES, EXACT))
    rows = []
    for entry in part["rows"]:
        times = entry["ns_per_sample"]
        ratio = (spread(ratios(times, forces)), spread(ratios(times, exact)))
        rows.append((entry["name"], entry["what"], str(entry["samples"]), spread(Spread.of(times)), *ratio))
    flops, header = part["flops"], ("", "what", "samples", "ns a sample", "over forces", "over exact")
    return (
        f"{table(header, rows, words=2)}\n\n"
        "One thread; exact ones with the forces. New arrays may have to be fetched from the system page by "
        "page, 1200 bytes a sample for forces and derivatives. "
        f"Operations of a sample: {flops['force_derivatives']}, of the forces {flops['forces']}. "
        f"The differences miss the exact derivatives by {part['difference']:.1e} of the largest."
    )


def scaling(results: Results) -> str:
    """Returns the cost per sample along the number of samples and of threads."""
    rows = []
    for entry in sorted(results["scaling"]["rows"], key=lambda one: int(one["samples"])):
        passes = f" in {entry['passes']} passes" if entry["passes"] > 1 else ""
        words = (f"{entry['samples']}{passes}", str(entry["threads"]), "reused" if entry["reused"] else "new")
        here = "reason" not in entry
        cost = spread(Spread.of(entry["ns_per_sample"])) if here else f"not here: {entry['reason']}"
        rows.append((*words, cost))
    return (
        f"{table(('samples', 'threads', 'array of the forces', 'ns a sample'), rows, words=0)}\n\n"
        "Beyond a million samples the motion is repeated in arrays of their full length; with passes, the "
        "same arrays are gone over again."
    )


def kernels(results: Results) -> str:
    """Returns each kernel beside what arithmetic and memory allow."""
    part = results["kernels"]
    units = part["ns_per_unit"]
    rows = []
    for entry in part["rows"]:
        counts, times, threads = part["counts"][entry["kernel"]], entry["ns_per_sample"], entry["threads"]
        peak = units[on_threads(PEAK, threads)]
        moved = [counts["bytes"] * ns for ns in units[on_threads(TRIAD, threads)]]
        shares = (
            percent(share_of_arithmetic(counts["flops"], peak, times)),
            percent(share_of_arithmetic(slots(counts["operations"]), peak, times)),
            percent(ratios(moved, times)) if entry["place"] == MEMORY else "",
            percent(share_allowed(entry, counts, units)),
        )
        rows.append((entry["kernel"], entry["place"], str(threads), spread(Spread.of(times)), *shares))
    header = (
        "kernel",
        "arrays in",
        "threads",
        "ns a sample",
        "% of arithmetic",
        "% of issue",
        "% of bandwidth",
    )
    return "\n\n".join(
        [
            f"This machine: {'; '.join(_peaks(results))}; triad over arrays of "
            f"{part['triad_array_bytes'] / 2**20:.0f} MiB.",
            table((*header, "% of what both allow"), rows, words=2),
            "Arithmetic: floating-point operations over those of a loop of fused multiply-adds, which count "
            "as two; all others count as one, divisions and roots among them. Issue: each instruction counts "
            "as two, as a sum or a product alone takes the place of a fused one. Bandwidth: bytes of the "
            "arrays over those of the triad. Arrays in the cache fit into the second one, and are gone over "
            "again and again.",
            "A sample takes, equal values counted once whatever the code does:\n\n"
            + "\n".join(_counts(part["counts"])),
        ]
    )


def _peaks(results: Results) -> list[str]:
    units = results["kernels"]["ns_per_unit"]
    found = []
    for threads in dict.fromkeys((1, all_threads(results))):
        flops, moved = (1 / Spread.of(units[on_threads(name, threads)]).median for name in (PEAK, TRIAD))
        found.append(f"{on_threads(f'{number(flops)} GFLOP/s and {number(moved)} GB/s', threads)}")
    return found


def _counts(counts: dict[str, Results]) -> list[str]:
    lines = []
    for name, one in counts.items():
        kinds = ", ".join(f"{count} {kind}" for kind, count in one["operations"].items())
        total = f"{one['flops']} floating-point operations in {sum(one['operations'].values())} instructions"
        lines.append(f"- `{name}`: {total} ({kinds}), {one['bytes']} bytes")
    return lines


def memory(results: Results) -> str:
    """Returns the memory of a batch."""
    rows: list[tuple[str, ...]] = []
    for entry in results["memory"]["rows"]:
        if "reason" in entry:
            rows.append(missing(entry))
            continue
        before, peak = entry["before"], entry["peak"]
        cells = (before / 2**20, peak / 2**20, (peak - before) / entry["samples"])
        rows.append((f"`{entry['name']}`", str(entry["samples"]), *map(number, cells)))
    return (
        f"{table(('', 'samples', 'MiB before', 'MiB at most', 'rise, bytes a sample'), rows)}\n\n"
        "Resident set of a process of its own. Before: the libraries and the motion, 208 bytes a sample and "
        "72 of rotation matrices. The forces take 48 bytes a sample."
    )


def startup(results: Results) -> str:
    """Returns how long it takes until something can be done."""
    part = results["startup"]
    rows = [
        (
            f"`{name}`, the whole process",
            spread(Spread.of(times)),
            f"{START_UP[name]:g}" if name in START_UP else "",
        )
        for name, times in part["seconds"].items()
    ]
    for how, words in (("cold", "nothing on disk"), ("warm", "machine code on disk")):
        for step, name in _STEPS.items():
            rows.append((f"{name}, {words}", spread(Spread.of([one[step] for one in part[how]])), ""))
    loaded = [f"- `{name}` loads {', '.join(found)}" for name, found in part["loaded"].items()]
    return "\n\n".join([table(("", "s", "at most"), rows), "\n".join(loaded)])


ALL: dict[str, tuple[str, Callable[[Results], str]]] = {
    "Along a motion": ("batch", batch),
    "One sample at a time": ("latency", latency),
    "Exact derivatives": ("derivatives", derivatives),
    "Forward kinematics": ("forward_kinematics", forward_kinematics),
    "Along the number of samples": ("scaling", scaling),
    "Kernels beside what the machine allows": ("kernels", kernels),
    "Memory of a batch": ("memory", memory),
    "Start-up": ("startup", startup),
}
"""Heading -> the part of the results, and its section."""
