"""Graphs of kernels evaluated in plain Python, one operation at a time."""

import math
from fractions import Fraction

from sixsps.parameters import MOTION_COLUMNS, parameter_vector

_ARRAYS = [array for arrays in MOTION_COLUMNS.values() for array, _ in arrays]


def fused(a, b, c):
    """a b + c of floats, rounded once."""
    if hasattr(math, "fma"):
        return math.fma(a, b, c)
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    return float(exact) if exact else a * b + c  # where it vanishes, its sign is that of the float


def unfused(a, b, c):
    """a b + c, rounded twice for floats."""
    return a * b + c


def operations(sqrt, fma):
    """Operation -> what it does, as its name in `sixsps.kernels.graph.OPERATIONS` says."""
    return {
        "ADD": lambda a, b: a + b,
        "SUB": lambda a, b: a - b,
        "MUL": lambda a, b: a * b,
        "DIV": lambda a, b: a / b,
        "NEG": lambda a: -a,
        "SQRT": sqrt,
        "FMIN": min,
        "FMA": fma,
        "FMS": lambda a, b, c: fma(a, b, -c),
        "FNMA": lambda a, b, c: fma(-a, b, c),
    }


def evaluated(graph, mechanism, motion, sample=0, **arithmetic):
    """Returns output -> entries of a graph at one sample.

    Args:
        graph: of a kernel.
        mechanism: gives the parameters.
        motion: gives the inputs.
        sample: which one.
        **arithmetic: number, a kind of number, made from a float; sqrt, its square root; fma of such numbers.
    """
    inputs = {name: getattr(motion, name)[sample].tolist() for name in _ARRAYS}
    return _step(graph, inputs, parameter_vector(mechanism).tolist(), **arithmetic)


def run(program, mechanism, motion, sample=0, **arithmetic):
    """Returns output -> entries of a program, one graph or those before, of and after the legs."""
    found = evaluated(program[0], mechanism, motion, sample, **arithmetic)
    if len(program) == 1:
        return found
    _, leg, tail = program
    width = len(found["legs"]) // 6
    rows = []
    for k in range(6):
        one = _step(leg, found | {"legs": found["legs"][k * width : (k + 1) * width]}, **arithmetic)
        found["sums"] = one["total"]
        rows += one["rows"]
    return found | _step(tail, found | {"rows": rows}, **arithmetic)


def _step(graph, inputs, parameters=(), number=float, sqrt=math.sqrt, fma=fused):
    does, found = operations(sqrt, fma), {}
    for index in sorted((*graph.per_mechanism, *graph.per_sample)):
        node = graph.nodes[index]
        if node.operation == "CONSTANT":
            found[index] = number(node.value)
        elif node.operation == "PARAMETER":
            found[index] = number(parameters[node.column])
        elif node.operation == "INPUT":
            found[index] = number(inputs[node.array][node.column])
        else:
            found[index] = does[node.operation](*(found[argument] for argument in node.arguments))
    return {name: [found[index] for index in entries] for name, entries in graph.outputs.items()}
