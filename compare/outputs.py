"""The folder that a comparison leaves behind."""

from __future__ import annotations

from pathlib import Path

from compare import figures
from compare.comparison import Comparison
from compare.report import markdown
from compare.results import write_forces, write_results
from sixsps.files import write_atomically
from sixsps.mechanism import Mechanism

REPORT = "report.md"


def write_outputs(comparison: Comparison, mechanism: Mechanism, folder: Path) -> Path:
    """Writes forces, results, picture and report into `folder`.

    Args:
        comparison: what to write.
        mechanism: what moved, for the picture.
        folder: existing folder.

    Returns:
        Path of the report.

    Raises:
        OutputError: a file cannot be written; those before it are complete.
    """
    write_forces(comparison, folder)
    write_results(comparison.results, folder)
    figure = figures.write_figure(comparison, mechanism, folder).name if figures.available() else None
    report = folder / REPORT
    with write_atomically(report) as temporary:
        temporary.write_text(markdown(comparison.results, figure), encoding="utf-8")
    return report
