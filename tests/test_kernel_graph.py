"""Graphs of kernels against the CasADi instructions that they were read from, digit by digit."""

import operator
from collections import Counter
from itertools import pairwise

import casadi as ca
import mpmath
import numpy as np
import pytest
from cases import random_mechanism, random_motion
from graphs import evaluated, run, unfused

import sixsps
from sixsps import symbolic
from sixsps.kernels.graph import FLOPS, OPERATIONS, graph, program, read
from sixsps.kernels.signatures import REGULARITY, SIGNATURES
from sixsps.parameters import MOTION_COLUMNS, PARAMETERS, parameter_vector

UNIT_ROUNDOFF = np.finfo(float).eps / 2
LEAVES = {"CONSTANT", "INPUT", "PARAMETER"}
FUSED = ("FMA", "FMS", "FNMA")
ARITY = {"NEG": 1, "SQRT": 1} | dict.fromkeys(FUSED, 3)


@pytest.fixture(params=SIGNATURES)
def name(request):
    return request.param


@pytest.fixture(params=[*SIGNATURES, "a leg's derivatives", "derivatives after the legs"])
def one(request):
    """Every graph that code is written from."""
    steps = program("force_derivatives")
    later = {"a leg's derivatives": steps[1], "derivatives after the legs": steps[2]}
    return later[request.param] if request.param in later else program(request.param)[0]


def instructions(function, inputs, number, sqrt):
    """A CasADi function evaluated instruction by instruction; output -> matrix of numbers."""
    does = {
        ca.OP_ADD: operator.add,
        ca.OP_SUB: operator.sub,
        ca.OP_MUL: operator.mul,
        ca.OP_DIV: operator.truediv,
        ca.OP_FMIN: min,
        ca.OP_NEG: operator.neg,
        ca.OP_SQRT: sqrt,
        ca.OP_SQ: lambda a: a * a,
        ca.OP_TWICE: lambda a: a + a,
        ca.OP_INV: lambda a: 1 / a,
    }
    found = [np.zeros(function.size_out(i), dtype=object) for i in range(function.n_out())]
    work = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            work[target[0]] = number(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            work[target[0]] = number(inputs[function.name_in(source[0])][source[1]])
        elif operation == ca.OP_OUTPUT:
            matrix = found[target[0]]  # CasADi counts down the columns
            matrix[target[1] % len(matrix), target[1] // len(matrix)] = work[source[0]]
        else:
            work[target[0]] = does[operation](*(work[place] for place in source))
    return {function.name_out(i): found[i] for i in range(function.n_out())}


@pytest.mark.parametrize("seed", range(2))
def test_graph_is_the_same_function_as_the_instructions_to_forty_digits(name, seed):
    """Shared reciprocals, merged values and products put in another order change rounding only."""
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed, samples=1)
    columns = {key: value[:, 0] for key, value in symbolic.motion_columns(motion).items()}
    columns["parameters"] = parameter_vector(mechanism)
    with mpmath.workdps(60):
        expected = instructions(getattr(symbolic, name)(), columns, mpmath.mpf, mpmath.sqrt)
        arithmetic = {"number": mpmath.mpf, "sqrt": mpmath.sqrt, "fma": unfused}
        for found in (
            evaluated(graph(name), mechanism, motion, **arithmetic),
            run(program(name), mechanism, motion, **arithmetic),
        ):
            for output, matrix in expected.items():
                wanted = matrix.ravel().tolist()
                errors = [abs(a - b) for a, b in zip(found[output], wanted, strict=True)]
                # 60 digits, less those that a condition number of up to 1e10 takes twice.
                assert max(errors) <= mpmath.mpf(10) ** -40 * max(map(abs, wanted)), output


def test_graph_in_floats_agrees_with_casadi(name):
    """Both round, differently: errors of unit roundoff times what coordinates and cond(J) make of it."""
    mechanism = random_mechanism(3)
    motion = random_motion(mechanism, 3, samples=2)
    growth = sixsps.inverse_kinematics(mechanism, motion).error_growth
    expected = symbolic.evaluate(getattr(symbolic, name)(), mechanism, motion)
    for sample in range(2):
        found = run(program(name), mechanism, motion, sample)
        for output, values in expected.items():
            wanted = values[sample].ravel()
            # 20 for a single solve; derivatives are a solve with a right-hand side from another.
            bound = 40 * UNIT_ROUNDOFF * growth[sample] * np.abs(wanted).max()
            assert np.abs(np.array(found[output]) - wanted).max() <= bound, output


def test_arguments_come_first_and_are_as_many_as_the_operation_takes(one):
    for number, node in enumerate(one.nodes):
        assert node.operation in OPERATIONS | LEAVES
        assert all(argument < number for argument in node.arguments)
        assert len(node.arguments) == (0 if node.operation in LEAVES else ARITY.get(node.operation, 2))


def test_every_value_is_computed_once_before_it_is_used(one):
    """In the order of the kernel: mechanism first, then constants are all that a sample has of it."""
    done = set()
    for number in one.per_mechanism:
        assert done.issuperset(one.nodes[number].arguments)
        assert number not in done
        done.add(number)
    assert done.issuperset(one.constants)
    assert len(set(one.constants)) == len(one.constants)
    done = set(one.constants)
    for number in one.per_sample:
        assert done.issuperset(one.nodes[number].arguments)
        assert number not in done
        done.add(number)
    assert done.issuperset(number for entries in one.outputs.values() for number in entries)


def test_what_is_computed_once_a_mechanism_depends_on_no_sample(one):
    of_sample = [False] * len(one.nodes)
    for number, node in enumerate(one.nodes):
        of_sample[number] = node.operation == "INPUT" or any(of_sample[k] for k in node.arguments)
    assert not any(of_sample[number] for number in (*one.per_mechanism, *one.constants))
    assert all(of_sample[number] for number in one.per_sample)


def test_inputs_are_columns_of_the_arrays_of_the_signature(name):
    one, arrays = program(name)[0], SIGNATURES[name].arrays
    for node in one.nodes:
        if node.operation == "INPUT":
            assert 0 <= node.column < arrays[node.array]
        if node.operation == "PARAMETER":
            assert 0 <= node.column < len(PARAMETERS)


def test_outputs_are_those_of_the_signature(name):
    sizes = {output: len(entries) for output, entries in graph(name).outputs.items()}
    assert sizes.pop(REGULARITY, 1) == 1
    assert sizes == SIGNATURES[name].sizes


def test_operations_and_flops_are_those_of_the_values_of_a_sample(one):
    counted = Counter(one.nodes[number].operation for number in one.per_sample)
    del counted["INPUT"]
    assert one.operations == counted
    assert one.flops == sum(counted.values()) + sum(counted[operation] for operation in FUSED)
    assert set(FLOPS) == set(FUSED)


def test_no_more_is_done_than_casadi_would_do(name):
    assert graph(name).flops <= getattr(symbolic, name)().n_instructions()


def test_later_steps_have_no_constants_but_numbers():
    """Code for them makes numbers, and computes nothing of the mechanism."""
    for step in program("force_derivatives")[1:]:
        assert {step.nodes[number].operation for number in step.per_mechanism} <= {"CONSTANT"}


def test_no_product_is_computed_twice(one):
    """A product that two sums use is made once; to fuse it into both would make it twice."""
    nodes = [one.nodes[number] for number in one.per_sample]
    products = Counter(
        tuple(sorted(node.arguments[:2])) for node in nodes if node.operation in ("MUL", *FUSED)
    )
    assert max(products.values()) == 1


def test_no_value_is_dead(one):
    used = {number for entries in one.outputs.values() for number in entries}
    used |= {argument for node in one.nodes for argument in node.arguments}
    assert used == {*one.per_sample, *one.per_mechanism}


def test_a_doubt_in_the_determinant_is_on_the_left_of_every_minimum(name):
    """Kernels keep the NaN of a left argument only; a squared leg length is no NaN where the rest is."""
    one = program(name)[0]
    minima = [number for number in one.per_sample if one.nodes[number].operation == "FMIN"]
    if REGULARITY in one.outputs:
        assert len(minima) == 6
        assert one.outputs[REGULARITY] == (minima[-1],)
    for earlier, number in pairwise(minima):
        assert one.nodes[number].arguments[0] == earlier


POSE, WRENCH = (ca.SX.sym(key, sum(width for _, width in MOTION_COLUMNS[key])) for key in ("pose", "wrench"))
PARAMETER = ca.SX.sym("parameters", len(PARAMETERS))


def small(*outputs):
    """The graph of a function of pose, wrench and parameters."""
    return read(
        ca.Function(
            "f",
            [POSE, WRENCH, PARAMETER],
            list(outputs),
            ["pose", "wrench", "parameters"],
            [f"y{k}" for k in range(len(outputs))],
        )
    )


def test_entries_of_an_output_are_in_rows():
    matrix = ca.vertcat(ca.horzcat(POSE[0], POSE[1], POSE[2]), ca.horzcat(WRENCH[3], WRENCH[4], PARAMETER[7]))
    one = small(matrix)
    read_from = [(one.nodes[k].array, one.nodes[k].column) for k in one.outputs["y0"]]
    position = [("position", column) for column in range(3)]
    assert read_from == [*position, ("moment", 0), ("moment", 1), ("", 7)]


def test_columns_of_an_input_are_those_of_the_arrays_it_is_made_of():
    one = small(POSE, WRENCH)
    found = [(one.nodes[k].array, one.nodes[k].column) for k in one.outputs["y0"] + one.outputs["y1"]]
    expected = [
        (array, column) for key in ("pose", "wrench") for array, width in MOTION_COLUMNS[key]
        for column in range(width)
    ]  # fmt: skip
    assert found == expected


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (POSE[0] * POSE[1], POSE[1] * POSE[0]),
        (POSE[0] + POSE[1], POSE[1] + POSE[0]),
        (ca.fmin(POSE[0], POSE[1]), ca.fmin(POSE[0], POSE[1])),
        (ca.sqrt(POSE[0] * POSE[1]), ca.sqrt(POSE[1] * POSE[0])),
        (POSE[0] * POSE[0], POSE[0] ** 2),
        (1 / POSE[0], POSE[0] ** -1),
    ],
)
def test_equal_values_are_numbered_once(one, other):
    outputs = small(one, other).outputs
    assert outputs["y0"] == outputs["y1"]


def test_differences_and_quotients_are_not_commutative():
    outputs = small(POSE[0] - POSE[1], POSE[1] - POSE[0], POSE[0] / POSE[1], POSE[1] / POSE[0]).outputs
    assert len(set(outputs.values())) == 4


def test_one_division_serves_every_quotient_by_the_same_number():
    one = small(POSE[0] / POSE[2], POSE[1] / POSE[2], 1 / POSE[2])
    assert one.operations == {"DIV": 1, "MUL": 2}


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (POSE[0] * POSE[1] + POSE[2], {"FMA": 1}),
        (POSE[2] + POSE[0] * POSE[1], {"FMA": 1}),
        (POSE[0] * POSE[1] - POSE[2], {"FMS": 1}),
        (POSE[2] - POSE[0] * POSE[1], {"FNMA": 1}),
        (POSE[0] * POSE[1] + POSE[2] * POSE[3], {"MUL": 1, "FMA": 1}),
        (POSE[0] * POSE[1] + PARAMETER[0] * PARAMETER[1], {"FMA": 1}),
        (PARAMETER[0] * PARAMETER[1] + PARAMETER[2], {}),
        (2 * POSE[0], {"ADD": 1}),
    ],
)
def test_products_are_fused_into_sums(expression, expected):
    one = small(expression)
    assert one.operations == expected
    assert one.flops == sum(FLOPS.get(name, 1) * count for name, count in expected.items())


def test_a_product_that_is_used_twice_is_not_fused():
    product = POSE[0] * POSE[1]
    assert small(product + POSE[2], product + POSE[3]).operations == {"MUL": 1, "ADD": 2}
    assert small(product, product + POSE[3]).operations == {"MUL": 1, "ADD": 1}
    assert small(product + product).operations == {"MUL": 1, "ADD": 1}


def test_a_value_of_the_mechanism_can_be_an_output():
    one = small(ca.vertcat(PARAMETER[0] * PARAMETER[1], 3.5, POSE[0]))
    assert [one.nodes[number].operation for number in one.outputs["y0"]] == ["MUL", "CONSTANT", "INPUT"]
    assert one.operations == {}


@pytest.mark.parametrize(
    "expression",
    [
        ca.sin(POSE[0]),
        ca.fmax(POSE[0], POSE[1]),
        ca.fabs(POSE[0]),
        ca.if_else(POSE[0] > 0, POSE[1], POSE[2]),
        ca.atan2(POSE[0], POSE[1]),
    ],
)
def test_an_operation_without_a_kernel_is_refused(expression):
    with pytest.raises(NotImplementedError, match=r"operation [A-Z0-9_]+"):
        small(expression)
