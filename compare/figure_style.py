"""How all figures of this project look and are written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sixsps.errors import OutputError
from sixsps.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe & Ito's colours, told apart with any colour vision: one a leg.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
# What each format writes of the date and the program, so that the same data make the same bytes.
_METADATA: dict[str, dict[str, None]] = {
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    ".png": {"Software": None},
}
_STYLE: dict[Any, Any] = {
    # Text as text, and the same bytes for the same data.
    "svg.fonttype": "none",
    "svg.hashsalt": "sixsps",
    "font.size": 9,
    "axes.grid": True,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


@contextmanager
def styled(changes: dict[Any, Any] | None = None) -> Iterator[None]:
    """Draws figures in this project's style, changed by settings in the names of matplotlib."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE | (changes or {})):
        yield


def check_suffix(path: Path) -> None:
    """Raises OutputError unless `path` ends in the suffix of a format that figures are written in."""
    if path.suffix not in _METADATA:
        raise OutputError("figure", path.suffix or "no suffix", ".svg, .pdf or .png", str(path))


def save(figure: Figure, path: Path, dpi: int = 200) -> Path:
    """Writes a figure in the format of the path's suffix; returns the path.

    Args:
        figure: drawn in `styled`, which has to be in force still.
        path: in an existing folder, ending in .svg, .pdf or .png.
        dpi: dots per inch of a PNG.

    Raises:
        OutputError: it cannot be written, or has another suffix.
    """
    check_suffix(path)
    with write_atomically(path) as temporary:
        figure.savefig(temporary, format=path.suffix[1:], metadata=_METADATA[path.suffix], dpi=dpi)
    return path
