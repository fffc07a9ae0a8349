"""This machine's peak of vector arithmetic: fused multiply-adds that wait for nothing but the units.

Independent chains, one a vector register, hide the latency of the units; nothing is read or written
within the loop. Where there is no fused multiply-add a product and a sum stand for it.
"""

from __future__ import annotations

import platform
from typing import Any

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from benchmarks.workers import Workers
from sixsps.arrays import Array
from sixsps.kernels.emission import host_width

# Numbers from 1 to 2 creep towards 2.
FACTOR, TERM = 0.999999, 2e-6
# Whether Numba tells its types depends on its version; this module needs none of them.
_helpers: Any = cgutils
_DOUBLE, _INDEX = ir.DoubleType(), ir.IntType(64)


def chains() -> int:
    """Returns how many vectors the loop works on: they and two constants fit into the registers."""
    features = llvmlite.binding.get_host_cpu_features()
    return 24 if features.get("avx512f") or platform.machine() in ("aarch64", "arm64") else 12


def has_fma() -> bool:
    """Returns whether this machine multiplies and adds in one operation."""
    features = llvmlite.binding.get_host_cpu_features()
    return bool(features.get("fma") or features.get("neon"))


def _typed(_context: Any, steps: Any, factor: Any, term: Any, values: Any) -> Any:
    """Replaces each entry x of `values` (chains x width) by factor * x + term, `steps` times."""
    vector = ir.VectorType(_DOUBLE, host_width())

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[3])(context, builder, arguments[3]).data
        factors, terms = (_everywhere(builder, vector, scalar) for scalar in arguments[1:3])
        places, held = [], []
        for k in range(chains()):
            first = builder.gep(data, [ir.Constant(_INDEX, k * vector.count)], source_etype=_DOUBLE)
            places.append(builder.bitcast(first, vector.as_pointer()))
            start = builder.load(places[k], typ=vector)
            start.align = 8
            held.append(_helpers.alloca_once_value(builder, start))
        with _helpers.for_range(builder, arguments[0]):
            for chain in held:
                moved = _fused(builder, vector, builder.load(chain), factors, terms)
                builder.store(moved, chain)
        for place, chain in zip(places, held, strict=True):
            builder.store(builder.load(chain), place).align = 8
        return context.get_dummy_value()

    return types.void(steps, factor, term, values), generate


def _everywhere(builder: Any, vector: Any, scalar: Any) -> Any:
    lanes = ir.Constant(vector, ir.Undefined)
    for lane in range(vector.count):
        lanes = builder.insert_element(lanes, scalar, ir.Constant(ir.IntType(32), lane))
    return lanes


def _fused(builder: Any, vector: Any, a: Any, b: Any, c: Any) -> Any:
    if not has_fma():
        return builder.fadd(builder.fmul(a, b), c)
    kind = ir.FunctionType(vector, [vector] * 3)
    name = f"llvm.fma.v{vector.count}f64"
    return builder.call(_helpers.get_or_insert_function(builder.module, kind, name), (a, b, c))


_advance: Any = intrinsic(_typed)


@njit(nogil=True)
def advance(steps, factor, term, values):  # type: ignore[no-untyped-def]
    """Compiled form of `_advance`."""
    _advance(steps, factor, term, values)


def start_values() -> Array:
    """Returns (chains * width,) numbers, all different."""
    size = chains() * host_width()
    return 1.0 + np.arange(size) / size


class Peak:
    """The loop on a number of threads at once.

    Attributes:
        flops: of one pass, all threads together.

    Args:
        threads: number of them.
        steps: of each chain in one pass.
    """

    def __init__(self, threads: int, steps: int = 2_000_000) -> None:
        self._workers, self._steps = Workers(threads), steps
        self.flops = 2 * chains() * host_width() * steps * threads

    def run(self) -> list[Array]:
        """Returns the numbers at which the chains of each thread end."""
        return self._workers.share(lambda *_share: self._one(), self._workers.count)

    def _one(self) -> Array:
        values = start_values()
        advance(self._steps, FACTOR, TERM, values)
        return values
