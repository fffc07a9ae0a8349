"""Functions compiled by Numba: parts that become part of others, and entries kept on disk.

Numba keeps the machine code of an entry by its own rules (`__pycache__` beside the file, or the user's cache
folder, or NUMBA_CACHE_DIR), for this processor and its own version. It compares the entry's own file with
it, not the files of the parts that it took in: the name that an entry is given adds a digest of them all, so
that an edit of any compiles anew.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache

from sixsps import sources

_cache_of: Any = FunctionCache  # untyped in Numba

_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
# A product may be fused with a sum; nothing is reordered.
_FUSED = {"contract"}


def part(function: Callable[..., Any]) -> Any:
    """Returns a function that entries may call; compiled as part of them."""
    return njit(**_OPTIONS, fastmath=_FUSED)(function)


def exact_part(function: Callable[..., Any]) -> Any:
    """Returns a function that entries may call, every operation of which is rounded as it is written."""
    return njit(**_OPTIONS)(function)


def section(function: Callable[..., Any]) -> Any:
    """Returns a function that becomes part of the one entry that calls it, and is not compiled by itself.

    Machine code is optimised anew in every function that it is taken into; of sections, only in the entry.
    """
    return njit(inline="always")(function)


def entry(signature: str, *places: str, exact: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator for a function that Python calls; it releases Python's lock.

    Args:
        signature: types of what it returns and takes, as Numba writes them.
        places: files or folders of this package that its code comes from.
        exact: whether its own operations, and those of its sections, are rounded one by one.
    """
    digest = sources.digest("machine_code.py", *places)[:16]

    def decorated(function: Callable[..., Any]) -> Any:
        function.__qualname__ = f"{function.__name__}_{digest}"
        return kept(function, signature, fastmath=set() if exact else _FUSED)

    return decorated


def kept(function: Callable[..., Any], signature: Any, **options: Any) -> Any:
    """Returns a compiled function, its machine code from disk, or left there, where that can be done.

    Args:
        function: of a qualified name of its own: Numba numbers the files of functions of one name, and
            processes that compile at the same time would give theirs the same number.
        signature: types of what it returns and takes.
        options: of `numba.njit`.
    """

    def made(cache: bool) -> Any:
        return njit(signature, cache=cache, **_OPTIONS, **options)(function)

    # No folder to write to, no room, or files that are broken; reading those may raise anything.
    with suppress(Exception):
        return made(cache=True)
    with suppress(Exception):
        _cache_of(function).flush()
        return made(cache=True)
    return made(cache=False)
