"""Functions written for Numba by hand: parts that become part of others, and entries kept on disk.

Numba compares an entry's own file with its machine code, not the files of the parts that it took in. The
name that an entry is given adds a digest of them all, so that an edit of any compiles anew.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache

from sixsps import sources

_cache_of: Any = FunctionCache  # untyped in Numba

# A product may be fused with a sum; nothing is reordered.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


def part(function: Callable[..., Any]) -> Any:
    """Returns a function that entries may call; compiled as part of them."""
    return njit(**_OPTIONS)(function)


def entry(signature: str, *places: str) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator for a function that Python calls; it releases Python's lock.

    Args:
        signature: types of what it returns and takes, as Numba writes them.
        places: files of this package that its code comes from.
    """
    digest = sources.digest(*places)[:16]

    def decorated(function: Callable[..., Any]) -> Any:
        function.__qualname__ = f"{function.__name__}_{digest}"

        def made(cache: bool) -> Any:
            return njit(signature, cache=cache, **_OPTIONS)(function)

        # No folder to write to, no room, or files that are broken; reading those may raise anything.
        with suppress(Exception):
            return made(cache=True)
        with suppress(Exception):
            _cache_of(function).flush()
            return made(cache=True)
        return made(cache=False)

    return decorated
