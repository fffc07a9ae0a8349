"""Graphs written out as straight-line LLVM code on vectors, one sample a lane.

The code is the body of a Numba intrinsic: it is compiled into whatever Numba function calls it. Which
product is fused with which sum is settled in the graph, so that a sample has the same bits whatever the
width of the vectors that it is computed in.
"""

from __future__ import annotations

import platform
from typing import TYPE_CHECKING, Any

import llvmlite.binding
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from sixsps.kernels.signatures import REGULARITY, SIGNATURES
from sixsps.singularity import REGULAR_CONDITION

if TYPE_CHECKING:
    from sixsps.kernels.graph import Graph, Node

CAPACITY = 1024
"""Room for the constants of a mechanism."""

_LEGS = 6
_OF_LEGS = ("legs", "rows")
_RENAMED = {"total": "sums"}
_REGULAR = REGULAR_CONDITION**-2
_tools: Any = cgutils  # untyped in Numba
_DOUBLE, _INDEX, _LANE = ir.DoubleType(), ir.IntType(64), ir.IntType(32)


def host_width() -> int:
    """Returns how many doubles a vector register of this machine holds."""
    features = llvmlite.binding.get_host_cpu_features()
    return 8 if features.get("avx512f") else 4 if features.get("avx") else 2


def host() -> str:
    """Returns name and features of this machine's processor."""
    features = llvmlite.binding.get_host_cpu_features()
    return f"{llvmlite.binding.get_host_cpu_name()} {features.flatten()}"


def _has_fma() -> bool:
    if platform.machine().lower() in ("arm64", "aarch64"):
        return True
    return bool(llvmlite.binding.get_host_cpu_features().get("fma"))


@intrinsic(prefer_literal=True)
def samples(_context: Any, name: Any, width: Any, inputs: Any, constants: Any, outputs: Any, row: Any) -> Any:
    """Evaluates a function of `sixsps.symbolic` at `width` samples.

    Args:
        name: literal; its first word is the function.
        width: literal, number of samples, a power of two.
        inputs: tuple of C-contiguous arrays, in the order of `Signature.arrays`.
        constants: (CAPACITY,) of the mechanism, see `constants`.
        outputs: tuple of C-contiguous arrays, in the order of `Signature.outputs`.
        row: first sample.

    Returns:
        Whether all of them are certainly regular; true for functions that have no regularity.
    """
    signature = types.boolean(name, width, inputs, constants, outputs, row)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds, values = signature.args, arguments
        function, row = name.literal_value.split()[0], values[5]
        arrays, outputs = SIGNATURES[function].arrays, SIGNATURES[function].outputs
        first, *others = _program(function)
        memory = _Memory(builder, width.literal_value)
        writer = _Writer(builder, first, width.literal_value)
        sources = _pointers(context, builder, kinds[2], values[2])
        for (array, columns), source in zip(arrays.items(), sources, strict=True):
            writer.read_samples(array, columns, source, row)
        writer.read_constants(_pointer(context, builder, kinds[3], values[3]))
        writer.compute(first.per_sample)
        targets = dict(zip(outputs, _pointers(context, builder, kinds[4], values[4]), strict=True))
        memory.keep(writer, targets, row)
        if others:
            leg, tail = others
            with _tools.for_range(builder, ir.Constant(_INDEX, _LEGS)) as loop:
                memory.evaluated(leg, loop.index)
            memory.keep(memory.evaluated(tail), targets, row)
        return writer.all_regular()

    return signature, generate


@intrinsic(prefer_literal=True)
def constants(_context: Any, name: Any, parameters: Any, out: Any) -> Any:
    """Computes what a function of `sixsps.symbolic` needs of the mechanism at every sample.

    Args:
        name: literal; its first word is the function.
        parameters: (97,) in the order of `sixsps.parameters.PARAMETERS`.
        out: (CAPACITY,) what `samples` takes.
    """
    signature = types.void(name, parameters, out)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        writer = _Writer(builder, _program(name.literal_value.split()[0])[0], 1)
        if len(writer.graph.constants) > CAPACITY:
            raise NotImplementedError(f"{len(writer.graph.constants)} constants of a mechanism")
        writer.read_parameters(_pointer(context, builder, signature.args[1], arguments[1]))
        writer.compute(writer.graph.per_mechanism)
        target = _pointer(context, builder, signature.args[2], arguments[2])
        writer.write(writer.graph.constants, target, ir.Constant(_INDEX, 0))
        return context.get_dummy_value()

    return signature, generate


def _program(function: str) -> tuple[Graph, ...]:
    from sixsps.kernels.graph import program  # only where there is something to compile: it takes CasADi

    return program(function)


def _pointer(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return context.make_array(kind)(context, builder, array).data


def _pointers(context: Any, builder: Any, kind: Any, arrays: Any) -> list[Any]:
    pairs = zip(kind, _tools.unpack_tuple(builder, arrays, len(kind)), strict=True)
    return [_pointer(context, builder, one, array) for one, array in pairs]


class _Memory:
    """What one step of a program leaves on the stack for the next, a vector a value."""

    def __init__(self, builder: Any, width: int) -> None:
        self._builder, self._width = builder, width
        self._type = ir.VectorType(_DOUBLE, width) if width > 1 else _DOUBLE
        self._places: dict[str, Any] = {}
        self._sizes: dict[str, int] = {}

    def keep(self, writer: _Writer, targets: dict[str, Any], row: Any) -> None:
        """Stores what a step has made: a row a lane where it has a target, else for the next step."""
        for name, numbers in writer.graph.outputs.items():
            if name in targets:
                writer.write(numbers, targets[name], row)
            elif name != REGULARITY:
                self._store(name, [writer.values[number] for number in numbers])

    def evaluated(self, graph: Graph, leg: Any = None) -> _Writer:
        """Evaluates a later step, that of one leg with this number and its rows of what is kept."""
        writer = _Writer(self._builder, graph, self._width)
        for number in graph.per_sample:
            node = graph.nodes[number]
            if node.operation == "INPUT":
                of_leg = leg is not None and node.array in _OF_LEGS
                size = self._sizes[node.array] // _LEGS if of_leg else 0
                writer.values[number] = self._builder.load(
                    self._place(node.array, node.column, size, leg), typ=self._type
                )
        writer.read_numbers()
        writer.compute(graph.per_sample)
        if leg is not None:
            for name, numbers in graph.outputs.items():
                self._store(name, [writer.values[number] for number in numbers], leg)
        return writer

    def _store(self, name: str, values: list[Any], leg: Any = None) -> None:
        name = _RENAMED.get(name, name)
        of_leg = leg is not None and name in _OF_LEGS
        if name not in self._places:
            self._sizes[name] = len(values) * (_LEGS if of_leg else 1)
            self._places[name] = _tools.alloca_once(self._builder, self._type, size=self._sizes[name])
        for column, value in enumerate(values):
            place = self._place(name, column, len(values) if of_leg else 0, leg)
            self._builder.store(value, place)

    def _place(self, name: str, column: int, size: int, leg: Any) -> Any:
        place = ir.Constant(_INDEX, column)
        if size:
            place = self._builder.add(self._builder.mul(leg, ir.Constant(_INDEX, size)), place)
        return self._builder.gep(self._places[name], [place], source_etype=self._type)


class _Writer:
    """Writes out a graph.

    Attributes:
        graph: to be written.
        values: number -> LLVM value, a vector of as many lanes as there are samples.
    """

    def __init__(self, builder: Any, graph: Graph, width: int) -> None:
        self.graph = graph
        self._builder, self._width, self._fma = builder, width, _has_fma()
        self._type = self._vector(width) if width > 1 else _DOUBLE
        # Most values visit the stack, where LLVM by itself lets half of the vectors straddle cache lines.
        builder.function.attributes.add("nounwind")  # without one, llvmlite does not write the next
        builder.function.attributes.alignstack = 64
        self.values: dict[int, Any] = {}

    def read_samples(self, array: str, columns: int, source: Any, row: Any) -> None:
        """Makes the inputs that come from an array of `columns` columns: one load, then one shuffle each."""
        wide = self._vector(self._width * columns)
        rows = self._load(source, self._builder.mul(row, ir.Constant(_INDEX, columns)), wide)
        for number in self.graph.per_sample:
            node = self.graph.nodes[number]
            if node.operation == "INPUT" and node.array == array:
                lanes = range(node.column, self._width * columns, columns)
                self.values[number] = self._picked(rows, rows, list(lanes))

    def read_constants(self, source: Any) -> None:
        """Makes the constants of the mechanism, the same in every lane."""
        for place, number in enumerate(self.graph.constants):
            node = self.graph.nodes[number]
            if node.operation == "CONSTANT":
                self.values[number] = self._constant(node.value)
            else:
                scalar = self._load(source, ir.Constant(_INDEX, place), self._vector(1))
                self.values[number] = self._picked(scalar, scalar, [0] * self._width)

    def read_numbers(self) -> None:
        """Makes plain numbers, where nothing else is constant."""
        for number in self.graph.per_mechanism:
            node = self.graph.nodes[number]
            if node.operation != "CONSTANT":
                raise NotImplementedError(f"{node.operation} of plain numbers in a later step")
            self.values[number] = self._constant(node.value)

    def read_parameters(self, source: Any) -> None:
        """Makes the entries of the parameter vector and plain numbers."""
        for number in self.graph.per_mechanism:
            node = self.graph.nodes[number]
            if node.operation == "CONSTANT":
                self.values[number] = self._constant(node.value)
            elif node.operation == "PARAMETER":
                scalar = self._load(source, ir.Constant(_INDEX, node.column), self._vector(1))
                self.values[number] = self._picked(scalar, scalar, [0])

    def compute(self, numbers: tuple[int, ...]) -> None:
        """Makes all values that are not read."""
        for number in numbers:
            if number not in self.values:
                self.values[number] = self._operation(self.graph.nodes[number])

    def write(self, numbers: tuple[int, ...], target: Any, row: Any) -> None:
        """Stores values as a row a lane."""
        start = self._builder.mul(row, ir.Constant(_INDEX, len(numbers)))
        values = [self.values[number] for number in numbers]
        for first in range(0, len(values), self._width):
            block = values[first : first + self._width]
            for lane, entries in enumerate(self._transposed(block)):
                place = self._builder.add(start, ir.Constant(_INDEX, lane * len(values) + first))
                self._store(entries, target, place)

    def all_regular(self) -> Any:
        """Returns whether the regularity of every lane is large enough; a NaN is not."""
        entries = self.graph.outputs.get(REGULARITY)
        if entries is None:
            return ir.Constant(ir.IntType(1), 1)
        regular = self._builder.fcmp_ordered(">=", self.values[entries[0]], self._constant(_REGULAR))
        if self._width == 1:
            return regular
        lanes = ir.IntType(self._width)
        return self._builder.icmp_unsigned(
            "==", self._builder.bitcast(regular, lanes), ir.Constant(lanes, -1)
        )

    def _operation(self, node: Node) -> Any:
        a, b, c = (*(self.values[number] for number in node.arguments), None, None)[:3]
        build = self._builder
        match node.operation:
            case "ADD":
                return build.fadd(a, b)
            case "SUB":
                return build.fsub(a, b)
            case "MUL":
                return build.fmul(a, b)
            case "DIV":
                return build.fdiv(a, b)
            case "NEG":
                return build.fneg(a)
            case "SQRT":
                return self._call("sqrt", a)
            case "FMIN":
                # A NaN on the left stays, unlike in llvm.minnum: a doubt is not to be lost.
                return build.select(build.fcmp_unordered("<", a, b), a, b)
            case "FMA":
                return self._fused(a, b, c)
            case "FMS":
                return self._fused(a, b, build.fneg(c))
            case "FNMA":
                return self._fused(build.fneg(a), b, c)
        raise NotImplementedError(f"operation {node.operation}")

    def _fused(self, a: Any, b: Any, c: Any) -> Any:
        if self._fma:
            return self._call("fma", a, b, c)
        return self._builder.fadd(self._builder.fmul(a, b), c)

    def _call(self, name: str, *arguments: Any) -> Any:
        suffix = "f64" if self._width == 1 else f"v{self._width}f64"
        kind = ir.FunctionType(self._type, [self._type] * len(arguments))
        module = self._builder.module
        function = _tools.get_or_insert_function(module, kind, f"llvm.{name}.{suffix}")
        return self._builder.call(function, arguments)

    def _transposed(self, columns: list[Any]) -> list[Any]:
        """Returns as vectors what each lane has of up to `width` values (Eklundh's method)."""
        if self._width == 1:
            return columns
        missing = [ir.Constant(self._type, ir.Undefined)] * (self._width - len(columns))
        rows, width = columns + missing, self._width
        step = 1
        while step < width:
            for upper in (k for k in range(width) if not k & step):
                a, b = rows[upper], rows[upper + step]
                low = [k if not k & step else width + k - step for k in range(width)]
                high = [k + step if not k & step else width + k for k in range(width)]
                rows[upper], rows[upper + step] = self._picked(a, b, low), self._picked(a, b, high)
            step *= 2
        return [self._picked(row, row, list(range(len(columns)))) for row in rows]

    def _picked(self, a: Any, b: Any, lanes: list[int]) -> Any:
        """Returns the entries of two vectors, one after the other, at `lanes`; a scalar if it is one."""
        if self._width == 1:
            return self._builder.extract_element(a, ir.Constant(_LANE, lanes[0]))
        return self._builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_LANE, len(lanes)), lanes))

    def _load(self, source: Any, place: Any, kind: Any) -> Any:
        loaded = self._builder.load(self._address(source, place, kind), typ=kind)
        loaded.align = 8
        return loaded

    def _store(self, value: Any, target: Any, place: Any) -> None:
        self._builder.store(value, self._address(target, place, value.type)).align = 8

    def _address(self, pointer: Any, place: Any, kind: Any) -> Any:
        entry = self._builder.gep(pointer, [place], source_etype=_DOUBLE)
        return self._builder.bitcast(entry, kind.as_pointer())

    def _constant(self, value: float) -> Any:
        return ir.Constant(self._type, value if self._width == 1 else [value] * self._width)

    @staticmethod
    def _vector(width: int) -> Any:
        return ir.VectorType(_DOUBLE, width)
