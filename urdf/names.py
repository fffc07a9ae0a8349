"""Text of any kind made fit for file names, strict readers and comments."""

from __future__ import annotations

import re

_LONGEST_STEM = 60


def file_stem(name: str) -> str:
    """Returns a file name for a mechanism: no separators, no leading dot, nothing a shell expands."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._")[:_LONGEST_STEM]
    return stem or "hexapod"


def comment(text: str) -> str:
    """Returns text that stands in an XML comment without ending it, which two dashes would."""
    return re.sub("-(?=-)", "- ", text)
