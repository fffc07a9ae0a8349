"""Kernels compiled by Numba: the loops around the straight-line code, and their machine code on disk.

Numba keeps the machine code of the loops by its own rules (`__pycache__` beside this file, or the user's
cache folder, or NUMBA_CACHE_DIR), for this processor and its own version. The name that the loops are
given adds a digest of everything else that the code comes from, so that a change compiles anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from numba import njit, types

from sixsps.kernels.emission import constants, host_width, samples
from sixsps.kernels.signatures import Signature

_SOURCES = ("symbolic", "kernels", "parameters.py")
_COMPILERS = ("casadi", "llvmlite")
REGULAR, DOUBTFUL, MISFIT = 0, 1, 2
# Called as Numba calls them, which is not how Python would.
_constants: Any = constants
_samples: Any = samples


@dataclass(frozen=True, eq=False)
class Kernel:
    """Compiled functions of one signature; all release Python's lock.

    Attributes:
        signature: arrays in and out.
        prepare: (parameters (97,), constants (CAPACITY,)) fills the constants of a mechanism.
        batch: (inputs, constants, outputs, start, stop) evaluates the samples from start to stop, and
            returns whether all are certainly regular; arrays are (n, width).
        single: (inputs, constants, outputs) evaluates one sample from arrays (width,), and returns
            REGULAR, DOUBTFUL, or MISFIT where an array has another length and nothing was done.
    """

    signature: Signature
    prepare: Callable[..., None]
    batch: Callable[..., bool]
    single: Callable[..., int]


@cache
def source_digest() -> str:
    """Returns a digest of the sources of graphs and kernels, and of the versions that compile them."""
    digest = hashlib.sha256()
    for place in _SOURCES:
        path = files("sixsps") / place
        parts = [path] if path.is_file() else sorted(path.iterdir(), key=lambda part: part.name)
        for part in parts:
            if part.name.endswith(".py"):
                digest.update(part.read_bytes())
    digest.update(" ".join(version(package) for package in _COMPILERS).encode())
    return digest.hexdigest()[:16]


@cache
def kernel(signature: Signature) -> Kernel:
    """Returns a kernel, compiled now or read from disk."""
    name, width = f"{signature.name} {source_digest()}", host_width()
    widths, sizes = tuple(signature.arrays.values()), tuple(signature.sizes.values())
    given = _array(1, False)

    def prepare(parameters, out):  # type: ignore[no-untyped-def]
        _constants(name, parameters, out)

    def batch(inputs, fixed, outputs, start, stop):  # type: ignore[no-untyped-def]
        regular = True
        row = start
        while row + width <= stop:
            regular &= _samples(name, width, inputs, fixed, outputs, row)
            row += width
        while row < stop:
            regular &= _samples(name, 1, inputs, fixed, outputs, row)
            row += 1
        return regular

    def single(inputs, fixed, outputs):  # type: ignore[no-untyped-def]
        for k in range(len(inputs)):
            if inputs[k].size != widths[k]:
                return MISFIT
        for k in range(len(outputs)):
            if outputs[k].size != sizes[k]:
                return MISFIT
        return REGULAR if _samples(name, 1, inputs, fixed, outputs, 0) else DOUBTFUL

    one, many = (_arrays(dimensions, signature) for dimensions in (1, 2))
    return Kernel(
        signature,
        _compiled(prepare, types.void(given, _array(1, True))),
        _compiled(batch, types.boolean(many[0], given, many[1], types.intp, types.intp)),
        _compiled(single, types.intp(one[0], given, one[1])),
    )


def _arrays(dimensions: int, signature: Signature) -> tuple[Any, Any]:
    """Returns the types of a kernel's arrays in and out."""
    ends = ((signature.arrays, False), (signature.outputs, True))
    inputs, outputs = ([_array(dimensions, written)] * len(names) for names, written in ends)
    return types.Tuple(inputs), types.Tuple(outputs)  # type: ignore[no-untyped-call]


def _array(dimensions: int, written: bool) -> Any:
    return types.Array(types.float64, dimensions, "C", readonly=not written)


def _compiled(function: Callable[..., Any], signature: Any) -> Callable[..., Any]:
    def made(cache: bool) -> Any:
        return njit(signature, cache=cache, nogil=True, error_model="numpy")(function)

    try:
        return made(cache=True)
    except RuntimeError:  # no folder to keep machine code in
        return made(cache=False)
