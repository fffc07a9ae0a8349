"""What a person at a terminal sees of a comparison, in 80 columns."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from compare.summary import figures, listed, summary, verdict
from sixsps.errors import printable

_VERDICTS = {
    "ok": ("ok", "green"),
    "wrong": ("WRONG", "bold red"),
    "failed": ("FAILED", "bold red"),
    "unavailable": ("absent", "yellow"),
}


def terminal(results: dict[str, Any]) -> Group:
    """Returns what a person at a terminal sees: the engines, then the mechanism, in 80 columns."""
    here = {name: entry for name, entry in results["engines"].items() if not _just_absent(entry)}
    absent = [name for name in results["engines"] if name not in here]
    notes = [Text(f"{name}: {printable(entry['reason'])}") for name, entry in here.items() if entry["reason"]]
    if absent:
        notes.append(Text(f"not here: {listed(absent)} (sixsps engines says why)"))
    parts: list[RenderableType] = [_terminal_table(here, results["reference"]["engine"]), *notes]
    if results["traps"]:
        parts += [Text(), Text("traps, wrong without a word:"), _terminal_table(results["traps"], "")]
        parts += [
            Text(f"{name}: {printable(entry['reason'])}")
            for name, entry in results["traps"].items()
            if entry["reason"]
        ]
    return Group(*parts, Text(), *(Text(line) for line in summary(results)))


def _terminal_table(entries: dict[str, Any], reference: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column("engine", no_wrap=True)
    for heading in ("digits", "relative", "error N", "t [s]", "leg", "us"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("version", no_wrap=True)
    table.add_column("", no_wrap=True)
    for name, entry in entries.items():
        word, style = _VERDICTS[verdict(entry)]
        row = figures(entry, name == reference)
        table.add_row(name, *row, entry["version"] or "", Text(word, style=style))
    return table


def _just_absent(entry: dict[str, Any]) -> bool:
    return entry["status"] == "unavailable" and not entry["requested"]
