"""The same symbolic graph as `fast`, evaluated by NumPy: what its operations cost without a compiler.

Every operation of `sixsps.kernels.graph` becomes one call on a block of samples, a fused one becomes two.
Results go into buffers that are taken over as soon as nobody reads them any more, and all calls are
written down before the first sample: what is left is the arithmetic and half a microsecond a call.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from sixsps.arrays import Array
from sixsps.kernels.graph import Graph, graph
from sixsps.kernels.signatures import SIGNATURES
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.parameters import parameter_vector

BLOCKS = (2048, 4096, 8192, 16384)
"""Samples a call that are worth trying: fewer are spent on calls, more leave the cache."""

Call = tuple[Callable[..., Any], tuple[Any, ...]]


def _minimum(a: Any, b: Any, out: Array) -> Any:
    return np.minimum(a, b, out=out)  # unlike the others it takes no third array by position


_UFUNCS: dict[str, Callable[..., Any]] = {
    "ADD": np.add,
    "SUB": np.subtract,
    "MUL": np.multiply,
    "DIV": np.divide,
    "NEG": np.negative,
    "SQRT": np.sqrt,
    "FMIN": _minimum,
}


class VectorisedGraph:
    """A function of `sixsps.symbolic` for one mechanism, block by block in NumPy.

    Args:
        mechanism: geometry and inertia.
        name: of the function, one of `sixsps.kernels.signatures.SIGNATURES`.
        block: samples a call.
    """

    def __init__(self, mechanism: Mechanism, name: str = "forces", block: int = BLOCKS[1]) -> None:
        self.graph = graph(name)
        self._arrays = tuple(SIGNATURES[name].arrays)
        self.block = block
        self._fixed = _constants(self.graph, parameter_vector(mechanism))
        self._places, rows = buffer_places(self.graph)
        self._buffers = np.empty((rows, block))
        self._program = cache(self._written)

    def evaluate(self, motion: Motion) -> dict[str, Array]:
        """Returns output name -> (n, entries) along a motion; singular poses like any other."""
        outputs = self.graph.outputs
        found = {name: np.empty((len(motion), len(entries))) for name, entries in outputs.items()}
        for start in range(0, len(motion), self.block):
            block = slice(start, min(start + self.block, len(motion)))
            reads, calls, values = self._program(block.stop - block.start)
            columns = {name: getattr(motion, name)[block].T for name in self._arrays}
            for array, column, buffer in reads:
                buffer[:] = columns[array][column]
            for call, arguments in calls:
                call(*arguments)
            for name, entries in outputs.items():
                for column, number in enumerate(entries):
                    found[name][block, column] = values[number]
        return found

    def inverse_dynamics(self, motion: Motion) -> Array:
        """Returns the (n, 6) leg forces along a motion [N]; the function has to be `forces`."""
        return self.evaluate(motion)["F"]

    def _written(self, samples: int) -> tuple[list[tuple[str, int, Array]], list[Call], list[Any]]:
        """Returns columns to read, calls in order, and the value by number, for a block of this length."""
        values, reads, calls = list(self._fixed), [], []
        for number in self.graph.per_sample:
            node = self.graph.nodes[number]
            values[number] = out = self._buffers[self._places[number], :samples]
            if node.operation == "INPUT":
                reads.append((node.array, node.column, out))
            else:
                calls += _calls(node.operation, [values[argument] for argument in node.arguments], out)
        return reads, calls, values


def _calls(operation: str, given: list[Any], out: Array) -> list[Call]:
    """Returns the calls of NumPy that do one operation of a graph."""
    if operation in _UFUNCS:
        return [(_UFUNCS[operation], (*given, out))]
    a, b, c = given
    last: Call = {
        "FMA": (np.add, (out, c, out)),
        "FMS": (np.subtract, (out, c, out)),
        "FNMA": (np.subtract, (c, out, out)),
    }[operation]
    return [(np.multiply, (a, b, out)), last]


def _constants(graph: Graph, parameters: Array) -> list[Any]:
    """Returns value by number, arrays without axes, for what depends on the mechanism alone; else None."""
    values: list[Any] = [None] * len(graph.nodes)
    for number in graph.per_mechanism:
        node = graph.nodes[number]
        values[number] = np.array(parameters[node.column] if node.operation == "PARAMETER" else node.value)
        if node.arguments:
            for ufunc, arguments in _calls(
                node.operation, [values[k] for k in node.arguments], values[number]
            ):
                ufunc(*arguments)
    return values


def buffer_places(graph: Graph) -> tuple[dict[int, int], int]:
    """Returns value -> row of the buffers that holds it while it is needed, and how many rows that takes."""
    last = {argument: number for number in graph.per_sample for argument in graph.nodes[number].arguments}
    kept = {number for entries in graph.outputs.values() for number in entries}
    places: dict[int, int] = {}
    free: list[int] = []
    rows = 0
    # Inputs are copied before the first operation.
    for number in sorted(graph.per_sample, key=lambda one: graph.nodes[one].operation != "INPUT"):
        arguments = graph.nodes[number].arguments
        done = {one for one in arguments if one in places and last[one] == number and one not in kept}
        # The product of a fused operation is written before its third argument is read.
        late = done & set(arguments[2:])
        free += sorted(places[one] for one in done - late)
        if not free:
            free, rows = [rows], rows + 1
        places[number] = free.pop()
        free += sorted(places[one] for one in late)
    return places, rows
