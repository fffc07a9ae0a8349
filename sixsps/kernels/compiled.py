"""Kernels compiled by Numba: the loops around the straight-line code, and their machine code on disk.

Numba keeps the machine code of the loops by its own rules (`__pycache__` beside this file, or the user's
cache folder, or NUMBA_CACHE_DIR), for this processor and its own version. The name that the loops are
given adds a digest of everything else that the code comes from, so that a change compiles anew.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache, cached_property
from importlib.metadata import version
from typing import Any

import numpy as np
from numba import types

from sixsps import sources
from sixsps.arrays import Array
from sixsps.kernels.emission import constants, host, host_width, samples
from sixsps.kernels.signatures import Signature
from sixsps.machine_code import kept

_COMPILERS = ("casadi", "llvmlite")
REGULAR, DOUBTFUL, MISFIT = 0, 1, 2
Arrays = tuple[Array, ...]
# Called as Numba calls them, which is not how Python would.
_constants: Any = constants
_samples: Any = samples
_KERNELS = sources.digest(
    "machine_code.py", *(f"kernels/{name}.py" for name in ("compiled", "emission", "graph", "signatures"))
)


@cache
def source_digest() -> str:
    """Returns a digest of the sources of graphs and kernels, of what compiles them, and for which processor.

    Of the sources that this process runs: a file that is edited while it does is not yet one of them.
    """
    loaded = sys.modules.get("sixsps.symbolic")
    model = loaded.SOURCE_DIGEST if loaded else sources.digest(*sources.MODEL)
    versions = " ".join(version(package) for package in _COMPILERS)
    return hashlib.sha256(f"{_KERNELS} {model} {versions} {host()}".encode()).hexdigest()[:16]


class Kernel:
    """Functions of one signature; what is compiled releases Python's lock.

    Attributes:
        signature: arrays in and out.
        prepare: (parameters (97,), constants (CAPACITY,)) fills the constants of a mechanism.
    """

    def __init__(self, signature: Signature) -> None:
        self.signature = signature
        self._name, self._width = f"{signature.name} {source_digest()}", host_width()
        self.prepare = self._prepare()
        self._wide = self._of_vectors()

    def batch(self, inputs: Arrays, fixed: Array, outputs: Arrays, start: int, stop: int) -> bool:
        """Evaluates the samples from start to stop; returns whether all are certainly regular.

        Args:
            inputs: (n, width) each, C-contiguous.
            fixed: (CAPACITY,) constants of the mechanism.
            outputs: (n, size) each, C-contiguous; nothing is written before start or from stop on.
            start: first sample.
            stop: sample after the last.
        """
        if start >= stop:
            return True
        if stop - start >= self._width:
            return bool(self._wide(inputs, fixed, outputs, start, stop))
        # Fewer than a vector: the last sample makes up for those that are missing.
        lanes = np.minimum(np.arange(start, start + self._width), stop - 1)
        found = tuple(np.empty((self._width, array.shape[1])) for array in outputs)
        regular = self._wide(tuple(array[lanes] for array in inputs), fixed, found, 0, self._width)
        for array, rows in zip(outputs, found, strict=True):
            array[start:stop] = rows[: stop - start]
        return bool(regular)

    @cached_property
    def single(self) -> Callable[[Arrays, Array, Arrays], int]:
        """(inputs, fixed, outputs) evaluates one sample from arrays (width,).

        Returns REGULAR, DOUBTFUL, or MISFIT where an array has another length and nothing was done.
        """
        name, signature = self._name, self.signature
        widths, sizes = tuple(signature.arrays.values()), tuple(signature.sizes.values())

        def single(inputs, fixed, outputs):  # type: ignore[no-untyped-def]
            for k in range(len(inputs)):
                if inputs[k].size != widths[k]:
                    return MISFIT
            for k in range(len(outputs)):
                if outputs[k].size != sizes[k]:
                    return MISFIT
            return REGULAR if _samples(name, 1, inputs, fixed, outputs, 0) else DOUBTFUL

        inputs, outputs = _types(1, signature)
        return self._compiled(single, types.intp(inputs, _array(1, False), outputs))

    def _of_vectors(self) -> Callable[..., bool]:
        name, width = self._name, self._width

        def wide(inputs, fixed, outputs, start, stop):  # type: ignore[no-untyped-def]
            regular = True
            row = start
            while row < stop:
                row = min(row, stop - width)  # the last vector takes in samples of the one before
                regular &= _samples(name, width, inputs, fixed, outputs, row)
                row += width
            return regular

        inputs, outputs = _types(2, self.signature)
        return self._compiled(wide, types.boolean(inputs, _array(1, False), outputs, types.intp, types.intp))

    def _prepare(self) -> Callable[[Array, Array], None]:
        name = self._name

        def prepare(parameters, out):  # type: ignore[no-untyped-def]
            _constants(name, parameters, out)

        return self._compiled(prepare, types.void(_array(1, False), _array(1, True)))

    def _compiled(self, function: Callable[..., Any], signature: Any) -> Callable[..., Any]:
        function.__qualname__ = "_".join([*self._name.split(), str(self._width), function.__name__])

        return kept(function, signature)


@cache
def kernel(signature: Signature) -> Kernel:
    """Returns a kernel, compiled now or read from disk."""
    return Kernel(signature)


def _types(dimensions: int, signature: Signature) -> tuple[Any, Any]:
    """Returns the types of a kernel's arrays in and out."""
    ends = ((signature.arrays, False), (signature.outputs, True))
    inputs, outputs = ([_array(dimensions, written)] * len(names) for names, written in ends)
    return types.Tuple(inputs), types.Tuple(outputs)  # type: ignore[no-untyped-call]


def _array(dimensions: int, written: bool) -> Any:
    return types.Array(types.float64, dimensions, "C", readonly=not written)
