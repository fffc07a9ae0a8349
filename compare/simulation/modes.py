"""The ways to put forces into forward dynamics; imports nothing, for the command line."""

from __future__ import annotations

from enum import StrEnum


class Mode(StrEnum):
    """What `sixsps simulate` can be asked for."""

    recover = "recover"
    open_loop = "open-loop"
    feedforward = "feedforward"
