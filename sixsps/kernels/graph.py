"""Functions of `sixsps.symbolic` as graphs of scalar operations, ready to be written out.

Reading a function numbers equal values once, divides by multiplying with a shared reciprocal, fuses
products into sums, and sets apart what depends on the mechanism alone: it is computed once a mechanism
and not once a sample.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca

from sixsps import symbolic
from sixsps.parameters import MOTION_COLUMNS

_PARAMETERS = "parameters"
_NAMES = {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}
_COMMUTATIVE = {"ADD", "MUL"}  # a minimum keeps a NaN on its left only
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
        array: that an input is read from, a name of `Motion`, or an output of the step before.
        column: in that array, rows first, or in the parameter vector.
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


@cache
def graph(name: str) -> Graph:
    """Returns the graph of the function of this name in `sixsps.symbolic`."""
    return read(getattr(symbolic, name)())


@cache
def program(name: str) -> tuple[Graph, ...]:
    """Returns the graphs that evaluate a function of `sixsps.symbolic` one after the other.

    One, or three of which the second is for each leg: before the legs, one leg, after the legs. Code that
    loops over the legs is a third as long, and fits into the processor's cache of instructions.
    """
    if name == "force_derivatives":
        return tuple(read(step) for step in symbolic.force_derivative_steps())
    return (graph(name),)


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
                place = _by_rows(function.size_out(outputs[0]), outputs[1])
                found[outputs[0]][place] = work[inputs[0]]
            elif name == "INPUT":
                work[outputs[0]] = self._number(_input(function, *inputs))
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


def _by_rows(size: tuple[int, int], entry: int) -> int:
    rows, columns = size
    return entry % rows * columns + entry // rows


def _input(function: ca.Function, index: int, entry: int) -> Node:
    name = function.name_in(index)
    if name == _PARAMETERS:
        return Node("PARAMETER", column=entry)
    for array, width in MOTION_COLUMNS.get(name, ()):
        if entry < width:
            return Node("INPUT", array=array, column=entry)
        entry -= width
    return Node("INPUT", array=name, column=_by_rows(function.size_in(index), entry))


def _finished(nodes: list[Node], outputs: dict[str, tuple[int, ...]]) -> Graph:
    fused = _Fusion(nodes, outputs)
    nodes, outputs = fused.nodes, fused.outputs
    alone = _alone(nodes)
    wanted = {number for entries in outputs.values() for number in entries}
    per_sample = tuple(number for number in range(len(nodes)) if not alone[number])
    read = wanted | {argument for number in per_sample for argument in nodes[number].arguments}
    return Graph(
        tuple(nodes),
        outputs,
        tuple(sorted(number for number in read if alone[number])),
        per_sample,
        tuple(number for number in range(len(nodes)) if alone[number]),
    )


def _alone(nodes: list[Node]) -> list[bool]:
    """Returns for every value whether it depends on the mechanism alone."""
    alone: list[bool] = []
    for node in nodes:
        alone.append(node.operation != "INPUT" and all(alone[argument] for argument in node.arguments))
    return alone


def _live(nodes: list[Node], wanted: set[int]) -> list[int]:
    """Returns the numbers of the values that the wanted ones are made from, and theirs."""
    for number in reversed(range(len(nodes))):
        if number in wanted:
            wanted |= set(nodes[number].arguments)
    return sorted(wanted)


_Product = tuple[bool, int, int]
"""Whether it is subtracted, and its two factors."""


class _Fusion:
    """A graph without its dead values, products fused into the sums that they are terms of.

    A sum of products x1 y1 + x2 y2 + .. that is used once, in another sum, is added to that sum's other
    term product by product: as many fused operations as there are products, and no plain addition.
    Sums of two such sums are left alone: they were written in pairs to be short.
    """

    def __init__(self, nodes: list[Node], outputs: dict[str, tuple[int, ...]]) -> None:
        self.nodes: list[Node] = []
        self._old, self._new = nodes, dict[int, int]()
        self._alone = _alone(nodes)
        wanted = {number for entries in outputs.values() for number in entries}
        live = _live(nodes, set(wanted))
        users: dict[int, list[int]] = {number: [] for number in live}
        for number in live:
            for argument in nodes[number].arguments:
                users[argument].append(number)
        self._once = {number for number in live if number not in wanted and self._in_one_sum(users[number])}
        self._sums: dict[int, list[_Product]] = {}
        for number in live:
            self._take(number)
        self.outputs = {
            name: tuple(self._new[number] for number in entries) for name, entries in outputs.items()
        }

    def _in_one_sum(self, users: list[int]) -> bool:
        if len(users) != 1 or self._alone[users[0]]:
            return False
        return self._old[users[0]].operation in ("ADD", "SUB")

    def _take(self, number: int) -> None:
        node = self._old[number]
        if node.operation == "MUL" and number in self._once and not self._alone[number]:
            left, right = (self._new[argument] for argument in node.arguments)
            self._sums[number] = [(False, left, right)]
        elif node.operation in ("ADD", "SUB") and not self._alone[number]:
            self._take_sum(number, node.operation == "SUB", *node.arguments)
        else:
            arguments = tuple(self._new[argument] for argument in node.arguments)
            self._new[number] = self._made(replace(node, arguments=arguments))

    def _take_sum(self, number: int, subtracts: bool, left: int, right: int) -> None:
        products = [self._sums.get(term, []) for term in (left, right)]
        if products[0] and products[1] and min(map(len, products)) == 1:
            self._sums[number] = products[0] + _signed(products[1], subtracts)
            if number not in self._once:
                self._new[number] = self._sum(self._sums.pop(number))
        elif products[0] and products[1]:
            terms = tuple(self._sum(one) for one in products)
            self._new[number] = self._made(Node("SUB" if subtracts else "ADD", terms))
        elif products[1]:
            self._new[number] = self._sum(_signed(products[1], subtracts), self._new[left])
        elif products[0]:
            self._new[number] = self._sum(products[0], self._new[right], subtracts)
        else:
            name = "SUB" if subtracts else "ADD"
            self._new[number] = self._made(Node(name, (self._new[left], self._new[right])))

    def _sum(self, products: list[_Product], plain: int | None = None, negated: bool = False) -> int:
        """Makes a sum of products, and of a plain value that may be subtracted."""
        total = plain
        for subtracts, *factors in products:
            if total is None:
                total = self._made(Node("MUL", tuple(factors)))
            elif negated:
                total, negated = self._made(Node("FMS", (*factors, total))), False
            else:
                total = self._made(Node("FNMA" if subtracts else "FMA", (*factors, total)))
        assert total is not None  # noqa: S101
        return total

    def _made(self, node: Node) -> int:
        self.nodes.append(node)
        return len(self.nodes) - 1


def _signed(products: list[_Product], subtracts: bool) -> list[_Product]:
    return [(sign != subtracts, a, b) for sign, a, b in products]
