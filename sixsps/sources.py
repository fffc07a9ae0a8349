"""Digests of this package's own source, by which machine code on disk is known to be of today's."""

from __future__ import annotations

import hashlib
from importlib.resources import files

MODEL = ("symbolic", "parameters.py")
"""Where the symbolic model comes from."""


def digest(*places: str) -> str:
    """Returns a digest of the Python files at these places of the package, as they are on disk now."""
    found = hashlib.sha256()
    for place in places:
        path = files("sixsps") / place
        parts = [path] if path.is_file() else sorted(path.iterdir(), key=lambda part: part.name)
        for part in parts:
            if part.name.endswith(".py"):
                found.update(part.read_bytes())
    return found.hexdigest()
