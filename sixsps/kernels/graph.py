"""Functions of `sixsps.symbolic` as graphs of scalar operations, ready to be written out.

Reading a function numbers equal values once, divides by multiplying with a shared reciprocal, fuses
products into sums, and sets apart what depends on the mechanism alone: it is computed once a mechanism
and not once a sample.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from sixsps import symbolic
from sixsps.parameters import MOTION_COLUMNS

_PARAMETERS = "parameters"
_NAMES = {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}
_COMMUTATIVE = {"ADD", "MUL", "FMIN"}
OPERATIONS = frozenset({"ADD", "SUB", "MUL", "DIV", "NEG", "SQRT", "FMIN", "FMA", "FMS", "FNMA"})
"""Operations of a graph: a+b, a-b, a*b, a/b, -a, square root, minimum, a*b+c, a*b-c, c-a*b."""

FLOPS = {"FMA": 2, "FMS": 2, "FNMA": 2}
"""Floating-point operations of one operation, where it is not one."""


@dataclass(frozen=True)
class Node:
    """One value.

    Attributes:
        operation: one of `OPERATIONS`, or "CONSTANT", "INPUT", "PARAMETER".
        arguments: numbers of the values that it is made from.
        value: of a constant.
        array: that an input is read from, a name of `Motion`.
        column: in that array, or in the parameter vector.
    """

    operation: str
    arguments: tuple[int, ...] = ()
    value: float = 0.0
    array: str = ""
    column: int = 0


@dataclass(frozen=True, eq=False)
class Graph:
    """A function, its values numbered such that arguments come first.

    Attributes:
        nodes: number -> value.
        outputs: output -> numbers of its entries, rows first.
        constants: numbers of the values of the mechanism alone that a sample needs.
        per_sample: numbers of the values that are computed for every sample, in order.
        per_mechanism: numbers of those computed once, in order.
    """

    nodes: tuple[Node, ...]
    outputs: dict[str, tuple[int, ...]]
    constants: tuple[int, ...]
    per_sample: tuple[int, ...]
    per_mechanism: tuple[int, ...]

    @property
    def operations(self) -> Counter[str]:
        """How often each operation is done for a sample."""
        names = (self.nodes[number].operation for number in self.per_sample)
        return Counter(name for name in names if name in OPERATIONS)

    @property
    def flops(self) -> int:
        """Additions, subtractions, products, quotients, roots and minima of a sample."""
        return sum(FLOPS.get(name, 1) * count for name, count in self.operations.items())


@lru_cache(maxsize=None)
def graph(name: str) -> Graph:
    """Returns the graph of the function of this name in `sixsps.symbolic`."""
    return read(getattr(symbolic, name)())


def read(function: ca.Function) -> Graph:
    """Returns the graph of a CasADi function with inputs named as in `sixsps.symbolic`.

    Raises:
        NotImplementedError: it uses an operation that no kernel has.
    """
    reader = _Reader(function)
    return _finished(reader.nodes, reader.outputs)


class _Reader:
    """Walks the instructions of a function; equal values get the same number."""

    def __init__(self, function: ca.Function) -> None:
        self.nodes: list[Node] = []
        self._numbers: dict[Node, int] = {}
        sizes = [function.numel_out(i) for i in range(function.n_out())]
        found = [[0] * size for size in sizes]
        self._one = self._number(Node("CONSTANT", value=1.0))
        work: dict[int, int] = {}
        for k in range(function.n_instructions()):
            name = _NAMES[function.instruction_id(k)]
            inputs, outputs = function.instruction_input(k), function.instruction_output(k)
            if name == "OUTPUT":
                found[outputs[0]][_by_rows(function, *outputs)] = work[inputs[0]]
            elif name == "INPUT":
                work[outputs[0]] = self._number(_input(function.name_in(inputs[0]), inputs[1]))
            elif name == "CONST":
                work[outputs[0]] = self._number(Node("CONSTANT", value=function.instruction_constant(k)))
            else:
                work[outputs[0]] = self._operation(name, tuple(work[i] for i in inputs))
        self.outputs = {function.name_out(i): tuple(found[i]) for i in range(function.n_out())}

    def _number(self, node: Node) -> int:
        if node not in self._numbers:
            self._numbers[node] = len(self.nodes)
            self.nodes.append(node)
        return self._numbers[node]

    def _operation(self, name: str, arguments: tuple[int, ...]) -> int:
        if name == "SQ":
            return self._operation("MUL", arguments * 2)
        if name == "TWICE":
            return self._operation("ADD", arguments * 2)
        if name == "INV":
            return self._operation("DIV", (self._one, *arguments))
        if name == "DIV" and arguments[0] != self._one:
            # A division takes longer than a dozen products, and divisors come back.
            return self._operation("MUL", (arguments[0], self._operation("DIV", (self._one, arguments[1]))))
        if name not in OPERATIONS:
            raise NotImplementedError(f"operation {name} of CasADi")
        return self._number(Node(name, tuple(sorted(arguments)) if name in _COMMUTATIVE else arguments))


def _by_rows(function: ca.Function, output: int, entry: int) -> int:
    rows, columns = function.size_out(output)
    return entry % rows * columns + entry // rows


def _input(name: str, entry: int) -> Node:
    if name == _PARAMETERS:
        return Node("PARAMETER", column=entry)
    for array, width in MOTION_COLUMNS[name]:
        if entry < width:
            return Node("INPUT", array=array, column=entry)
        entry -= width
    raise IndexError(entry)


def _finished(nodes: list[Node], outputs: dict[str, tuple[int, ...]]) -> Graph:
    alone: list[bool] = []
    for node in nodes:
        alone.append(node.operation != "INPUT" and all(alone[argument] for argument in node.arguments))
    nodes = _fused(nodes, outputs, alone)
    needed = _needed(nodes, {number for entries in outputs.values() for number in entries})
    per_sample = tuple(number for number in needed if not alone[number])
    read = {argument for number in per_sample for argument in nodes[number].arguments}
    read |= {number for entries in outputs.values() for number in entries}
    return Graph(
        tuple(nodes),
        outputs,
        tuple(sorted(number for number in read if alone[number])),
        per_sample,
        tuple(number for number in needed if alone[number]),
    )


def _needed(nodes: list[Node], wanted: set[int]) -> list[int]:
    for number in reversed(range(len(nodes))):
        if number in wanted:
            wanted |= set(nodes[number].arguments)
    return sorted(wanted)


def _fused(nodes: list[Node], outputs: dict[str, tuple[int, ...]], alone: list[bool]) -> list[Node]:
    """Returns the nodes with every product that only one sum uses taken into that sum."""
    live = _needed(nodes, {number for entries in outputs.values() for number in entries})
    uses = Counter(argument for number in live for argument in nodes[number].arguments)
    uses.update(number for entries in outputs.values() for number in entries)
    fused = list(nodes)

    def product(number: int) -> bool:
        return fused[number].operation == "MUL" and uses[number] == 1 and not alone[number]

    for number in live:
        node = nodes[number]
        if node.operation not in ("ADD", "SUB") or alone[number] or len(set(node.arguments)) == 1:
            continue
        left, right = node.arguments
        if product(right):
            name = "FMA" if node.operation == "ADD" else "FNMA"
            fused[number] = Node(name, (*nodes[right].arguments, left))
        elif product(left):
            name = "FMA" if node.operation == "ADD" else "FMS"
            fused[number] = Node(name, (*nodes[left].arguments, right))
    return fused
