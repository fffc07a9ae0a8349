"""What a person at a terminal sees of a comparison, in 80 columns."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from compare.summary import figures, listed, reasons, summary, verdict
from sixsps.errors import printable

_VERDICTS = {
    "ok": ("ok", "green"),
    "wrong": ("WRONG", "bold red"),
    "failed": ("FAILED", "bold red"),
    "unavailable": ("absent", "yellow"),
}


def terminal(results: dict[str, Any]) -> Group:
    """Returns what a person at a terminal sees: the engines, then the mechanism, in 80 columns."""
    motion, reference = results["motion"], results["reference"]["engine"]
    parts = _engines(results["engines"], reference, motion)
    if results["traps"]:
        parts += [Text(), Text("traps, wrong without a word:"), *_engines(results["traps"], "", motion)]
    return Group(*parts, Text(), *(Text(line) for line in summary(results)))


def _engines(entries: dict[str, Any], reference: str, motion: dict[str, Any]) -> list[RenderableType]:
    here = {name: entry for name, entry in entries.items() if not _just_absent(entry)}
    notes = reasons(here, motion) if reference else reasons(here, motion, errors=False)
    absent = [name for name in entries if name not in here]
    if absent:
        notes.append(f"not here: {listed(absent)} (sixsps engines says why)")
    return [_table(here, reference, motion), *map(Text, notes)]


def _table(entries: dict[str, Any], reference: str, motion: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column("engine", no_wrap=True)
    for heading in ("digits", "relative", "error N", "t [s]", "leg", "us"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("version", no_wrap=True, max_width=16)
    table.add_column("", no_wrap=True)
    for name, entry in entries.items():
        word, style = _VERDICTS[verdict(entry)]
        row = figures(entry, name == reference, motion)
        version = printable(entry["version"] or "")
        table.add_row(name, *row, version, Text(word, style=style))
    return table


def _just_absent(entry: dict[str, Any]) -> bool:
    return entry["status"] == "unavailable" and not entry["requested"] and "not installed" in entry["reason"]
