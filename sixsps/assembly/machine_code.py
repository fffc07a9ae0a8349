"""Functions compiled by Numba: small ones that become part of others, and entries kept on disk.

Numba compares an entry's file on disk with its machine code, not the files of the functions that it took
in. The name that an entry is given adds a digest of every source of this package, so that an edit of any
compiles anew.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache

from sixsps import sources

_DIGEST = sources.digest("assembly")[:16]
_cache_of: Any = FunctionCache  # untyped in Numba

# Rounding to nearest, and a product may be fused with a sum; nothing is reordered.
_CONTRACT = {"contract"}


def part(function: Callable[..., Any]) -> Any:
    """Returns a function that entries may call; compiled as part of them."""
    return njit(nogil=True, error_model="numpy", fastmath=_CONTRACT)(function)


def section(function: Callable[..., Any]) -> Any:
    """Returns a function that becomes part of the one entry that calls it, and is not compiled by itself.

    Machine code is optimised anew in every function that it is taken into; of sections, only in the entry.
    """
    return njit(inline="always")(function)


def exact_part(function: Callable[..., Any]) -> Any:
    """Returns a function that entries may call, every operation of which is rounded as it is written."""
    return njit(nogil=True, error_model="numpy")(function)


def entry(signature: str, exact: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator for a function that Python calls; it releases Python's lock.

    Args:
        signature: types of what it returns and takes, as Numba writes them.
        exact: whether its own operations are rounded one by one.
    """

    def decorated(function: Callable[..., Any]) -> Any:
        function.__qualname__ = f"{function.__name__}_{_DIGEST}"

        def made(cache: bool) -> Any:
            flags = set() if exact else _CONTRACT
            return njit(signature, cache=cache, nogil=True, error_model="numpy", fastmath=flags)(function)

        # No folder to write to, no room, or files that are broken; reading those may raise anything.
        with suppress(Exception):
            return made(cache=True)
        with suppress(Exception):
            _cache_of(function).flush()
            return made(cache=True)
        return made(cache=False)

    return decorated
