"""Machine code against the graph it was written from, bit by bit, and what it reads and writes."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from graphs import fused, run, unfused

import sixsps
from sixsps import symbolic
from sixsps.kernels import compiled, emission
from sixsps.kernels.compiled import DOUBTFUL, MISFIT, REGULAR, kernel
from sixsps.kernels.emission import CAPACITY
from sixsps.kernels.graph import program
from sixsps.kernels.signatures import (
    EQUATIONS,
    FORCE_DERIVATIVES,
    FORCES,
    LEG_MOTION,
    PARAMETER_DERIVATIVES,
    SIGNATURES,
)
from sixsps.parameters import parameter_vector
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

UNIT_ROUNDOFF = np.finfo(float).eps / 2
SENTINEL = -7.25e77
WIDTH = emission.host_width()


@pytest.fixture(params=SIGNATURES.values(), ids=SIGNATURES)
def signature(request):
    return request.param


def fixed(one, mechanism):
    """The constants of a mechanism, as a kernel takes them."""
    found = np.full(CAPACITY, np.nan)
    one.prepare(parameter_vector(mechanism), found)
    return found


def columns(signature, motion):
    return tuple(getattr(motion, name) for name in signature.arrays)


def blank(signature, rows):
    return tuple(np.full((rows, size), SENTINEL) for size in signature.sizes.values())


def in_batches(one, mechanism, motion, bounds):
    """Results of a motion, the samples between successive bounds at a time."""
    found, constants = blank(one.signature, len(motion)), fixed(one, mechanism)
    for start, stop in pairwise(bounds):
        assert one.batch(columns(one.signature, motion), constants, found, start, stop)
    return found


def one_by_one(one, mechanism, motion):
    """Results of a motion from the function for one sample, which uses no vectors."""
    found, constants = blank(one.signature, len(motion)), fixed(one, mechanism)
    for k in range(len(motion)):
        row = tuple(array[k] for array in columns(one.signature, motion))
        assert one.single(row, constants, tuple(array[k] for array in found)) == REGULAR
    return found


def assert_same_bits(found, expected):
    for a, b in zip(found, expected, strict=True):
        assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize("seed", range(2))
def test_machine_code_is_the_graph_bit_by_bit(signature, seed):
    """Plain Python, one float operation at a time, finds the same: nothing is reordered or fused anew."""
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed, samples=2)
    found = one_by_one(kernel(signature), mechanism, motion)
    fma = fused if emission._has_fma() else unfused
    for sample in range(2):
        expected = run(program(signature.name), mechanism, motion, sample, fma=fma)
        for output, array in zip(signature.outputs, found, strict=True):
            np.testing.assert_array_equal(array[sample], expected[output])


def test_machine_code_agrees_with_casadi(signature):
    mechanism = random_mechanism(5)
    motion = random_motion(mechanism, 5, samples=40)
    assert_agreement(signature, mechanism, motion, in_batches(kernel(signature), mechanism, motion, (0, 40)))


def assert_agreement(signature, mechanism, motion, found):
    """Rounds differently: unit roundoff times what coordinates and cond(J) make of it, once a solve."""
    growth = sixsps.inverse_kinematics(mechanism, motion).error_growth
    expected = symbolic.evaluate(getattr(symbolic, signature.name)(), mechanism, motion)
    for output, array in zip(signature.outputs, found, strict=True):
        wanted = expected[output].reshape(len(motion), -1)
        # 20 for a single solve; derivatives are a solve with a right-hand side from another.
        bound = 40 * UNIT_ROUNDOFF * growth * np.abs(wanted).max(axis=1)
        assert np.all(np.abs(array - wanted).max(axis=1) <= bound), output


def test_a_batch_has_the_bits_of_single_samples(signature):
    """Every length around the width of a vector, from every row: whole vectors and what is left of them."""
    one, mechanism = kernel(signature), random_mechanism(4)
    motion = random_motion(mechanism, 4, samples=2 * WIDTH + 3)
    expected, constants = one_by_one(one, mechanism, motion), fixed(one, mechanism)
    for start in range(WIDTH + 1):
        for stop in range(start, len(motion) + 1):
            found = blank(signature, len(motion))
            assert one.batch(columns(signature, motion), constants, found, start, stop)
            for array, wanted in zip(found, expected, strict=True):
                assert array[start:stop].tobytes() == wanted[start:stop].tobytes()
                assert np.all(array[:start] == SENTINEL)
                assert np.all(array[stop:] == SENTINEL)


@pytest.mark.parametrize("width", [1, 2, 4, 8])
@pytest.mark.parametrize(
    "signature", [LEG_MOTION, EQUATIONS, FORCES, FORCE_DERIVATIVES], ids=lambda one: one.name
)
def test_the_width_of_vectors_changes_no_bit(signature, width, monkeypatch):
    """Widths that this machine lacks are made of those it has."""
    monkeypatch.setattr(compiled, "host_width", lambda: width)
    one, mechanism = kernel.__wrapped__(signature), random_mechanism(6)
    for samples in (0, 1, width - 1, width, width + 1, 3 * width + 5):
        motion = random_motion(mechanism, 6, samples=samples)
        found = in_batches(one, mechanism, motion, (0, samples))
        assert_same_bits(found, one_by_one(kernel(signature), mechanism, motion))


@pytest.mark.parametrize("signature", [LEG_MOTION, FORCES], ids=lambda one: one.name)
def test_a_machine_without_fused_products_agrees_to_rounding(signature, monkeypatch):
    monkeypatch.setattr(emission, "_has_fma", lambda: False)
    named = f"unfused{compiled.source_digest()}"  # on disk beside the code for this machine
    monkeypatch.setattr(compiled, "source_digest", lambda: named)
    mechanism = random_mechanism(7)
    motion = random_motion(mechanism, 7, samples=WIDTH + 3)
    one = kernel.__wrapped__(signature)
    found = in_batches(one, mechanism, motion, (0, len(motion)))
    assert_same_bits(found, one_by_one(one, mechanism, motion))
    assert_agreement(signature, mechanism, motion, found)
    expected = run(program(signature.name), mechanism, motion, 1, fma=unfused)
    for output, array in zip(signature.outputs, found, strict=True):
        np.testing.assert_array_equal(array[1], expected[output])


CHUNK = 8192


@pytest.fixture(scope="module")
def long_motion():
    """Two chunks and a bit, of the states of one, each sample with its bits on its own."""
    mechanism = random_mechanism(8)
    motion = random_motion(mechanism, 8, samples=2 * CHUNK + 3)
    return mechanism, motion, one_by_one(kernel(FORCES), mechanism, motion)[0]


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("samples", [0, 1, 2, 3, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 3])
def test_neither_threads_nor_length_change_a_bit(long_motion, threads, samples):
    mechanism, motion, expected = long_motion
    guarded = np.full((samples + 2, 6), SENTINEL)
    model = sixsps.compile(mechanism, threads)
    assert model.inverse_dynamics(motion[:samples], out=guarded[1:-1]).base is guarded
    assert guarded[1:-1].tobytes() == expected[:samples].tobytes()
    assert np.all(guarded[[0, -1]] == SENTINEL)


def test_odd_splits_change_no_bit(signature):
    one, mechanism = kernel(signature), random_mechanism(9)
    motion = random_motion(mechanism, 9, samples=50)
    whole = in_batches(one, mechanism, motion, (0, 50))
    assert_same_bits(in_batches(one, mechanism, motion, (0, 1, 3, 10, 11, 24, 24, 37, 50)), whole)


FENCES = """
import ctypes, mmap, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from cases import random_mechanism, random_motion
from sixsps.kernels.compiled import kernel
from sixsps.kernels.emission import CAPACITY
from sixsps.kernels.signatures import SIGNATURES
from sixsps.parameters import parameter_vector

protect = ctypes.CDLL(None, use_errno=True).mprotect
held = []


def fenced(values, at_the_end):
    '''A copy of an array with a page before and after it that nobody may touch.'''
    pages = -(-values.nbytes // mmap.PAGESIZE)
    memory = mmap.mmap(-1, (pages + 2) * mmap.PAGESIZE)
    held.append(memory)
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    offset = mmap.PAGESIZE + (pages * mmap.PAGESIZE - values.nbytes if at_the_end else 0)
    copy = np.frombuffer(memory, np.float64, values.size, offset).reshape(values.shape)
    copy[...] = values
    for page in (0, pages + 1):
        assert protect(ctypes.c_void_p(start + page * mmap.PAGESIZE), mmap.PAGESIZE, 0) == 0
    return copy


mechanism = random_mechanism(1)
for signature in SIGNATURES.values():
    one = kernel(signature)
    for at_the_end in (False, True):
        constants = fenced(np.zeros(CAPACITY), at_the_end)
        one.prepare(fenced(parameter_vector(mechanism), at_the_end), constants)
        for n in (1, 2, 3, 4, 5, 7, 8, 9, 11):
            motion = random_motion(mechanism, n, samples=n)
            given = [fenced(getattr(motion, name), at_the_end) for name in signature.arrays]
            found = [fenced(np.zeros((n, size)), at_the_end) for size in signature.sizes.values()]
            one.batch(tuple(given), constants, tuple(found), 0, n)
            if n == 1:
                one.single(tuple(a[0] for a in given), constants, tuple(a[0] for a in found))
print("inside")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="mprotect is POSIX")
def test_no_kernel_touches_memory_outside_its_arrays():
    """Loads are wider than a row: one past the end of an array would end the process here."""
    command = [sys.executable, "-c", FENCES, str(Path(__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stdout == "inside\n", f"status {done.returncode}: {done.stderr}"


def test_constants_of_a_mechanism_stay_in_their_array(signature):
    one = kernel(signature)
    guarded = np.full(CAPACITY + 8, SENTINEL)
    one.prepare(parameter_vector(random_mechanism(1)), guarded[:CAPACITY])
    used = len(program(signature.name)[0].constants)
    assert np.all(guarded[used:] == SENTINEL)
    assert np.all(guarded[:used] != SENTINEL)


def test_one_sample_in_arrays_of_another_length_is_refused_and_nothing_is_written(signature):
    one, mechanism = kernel(signature), random_mechanism(1)
    motion, constants = random_motion(mechanism, 1, samples=1), fixed(one, mechanism)
    given = tuple(array[0] for array in columns(signature, motion))
    found = tuple(array[0] for array in blank(signature, 1))
    for place in range(len(given)):
        for size in (0, given[place].size - 1, given[place].size + 1):
            wrong = (*given[:place], np.ones(size), *given[place + 1 :])
            assert one.single(wrong, constants, found) == MISFIT
    for place in range(len(found)):
        for size in (0, found[place].size - 1, found[place].size + 1):
            wrong = (*found[:place], np.full(size, SENTINEL), *found[place + 1 :])
            assert one.single(given, constants, wrong) == MISFIT
            assert np.all(wrong[place] == SENTINEL)
    assert all(np.all(array == SENTINEL) for array in found)


JUDGING = (FORCES, FORCE_DERIVATIVES, PARAMETER_DERIVATIVES)


@pytest.mark.parametrize("signature", JUDGING, ids=lambda one: one.name)
def test_a_doubt_in_any_lane_is_told(signature):
    """A NaN in one sample, wherever it stands in a vector, and whichever entry of the pose it is in."""
    one, mechanism = kernel(signature), random_mechanism(2)
    motion, constants = random_motion(mechanism, 2, samples=2 * WIDTH + 1), fixed(one, mechanism)
    given = tuple(np.array(array) for array in columns(signature, motion))
    found = blank(signature, len(motion))
    assert one.batch(given, constants, found, 0, len(motion))
    for sample in range(len(motion)):
        array = sample % 2
        column = sample % given[array].shape[1]
        kept, given[array][sample, column] = given[array][sample, column], np.nan
        assert not one.batch(given, constants, found, 0, len(motion))
        assert one.batch(given, constants, found, 0, sample)
        assert one.batch(given, constants, found, sample + 1, len(motion))
        given[array][sample, column] = kept


@pytest.mark.parametrize("signature", JUDGING, ids=lambda one: one.name)
@pytest.mark.parametrize(
    ("array", "value"), [(0, np.nan), (0, np.inf), (0, 1e200), (0, -1e308), (1, np.nan), (1, np.inf)]
)
def test_a_pose_that_is_no_pose_is_never_regular(signature, array, value):
    one, mechanism = kernel(signature), random_mechanism(2)
    motion, constants = random_motion(mechanism, 2, samples=1), fixed(one, mechanism)
    for column in range(3 + array):
        given = [np.array(row[0]) for row in columns(signature, motion)]
        given[array][column] = value
        found = tuple(row[0] for row in blank(signature, 1))
        assert one.single(tuple(given), constants, found) == DOUBTFUL


def nearly_dependent(seed):
    """A mechanism at rest whose sixth leg is off the others' span by 1e-14 to 1e-6.

    Flat platforms, origins far off, legs of very different lengths, and nearly coincident joints too.
    """
    rng = np.random.default_rng(seed)
    kind = seed % 5
    joints, lengths = rng.standard_normal((6, 3)), 10 ** rng.uniform(-1, 1, 6)
    if kind == 1:
        joints += 10 ** rng.uniform(0, 4) * rng.standard_normal(3)
    elif kind == 2:
        lengths = 10 ** rng.uniform(-8, 5, 6)
    elif kind == 3:
        joints[:, 2] *= 10 ** rng.uniform(-8, 0)
    elif kind == 4:
        joints[1] = joints[0] + 10 ** rng.uniform(-10, -1) * rng.standard_normal(3)
    directions = rng.standard_normal((6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    wrenches = np.hstack([directions, np.cross(joints, directions)])
    # det J is linear in the sixth direction: across this normal it vanishes.
    normal = [
        np.linalg.det(np.vstack([wrenches[:5], np.hstack([axis, np.cross(joints[5], axis)])]))
        for axis in np.eye(3)
    ]
    normal = normal / np.linalg.norm(normal)
    across = directions[5] - normal * (normal @ directions[5])
    last = across / np.linalg.norm(across) + 10 ** rng.uniform(-14, -6) * normal
    directions[5] = last / np.linalg.norm(last)
    base = joints - lengths[:, None] * directions
    return base, joints, at_rest(np.zeros(3))


def test_no_singular_pose_passes_for_regular():
    """The bound in the machine code stands in for the definition: cond(J) above 1e12."""
    forces, equations, template = kernel(FORCES), kernel(EQUATIONS), random_mechanism(0)
    regular = singular = 0
    for seed in range(1500):
        base, joints, motion = nearly_dependent(seed)
        parameters = parameter_vector(template)
        parameters[3:39] = np.concatenate([base.ravel(), joints.ravel()])
        constants, found = np.empty(CAPACITY), blank(EQUATIONS, 1)
        given = columns(FORCES, motion)
        forces.prepare(parameters, constants)
        passed = forces.batch(given, constants, blank(FORCES, 1), 0, 1)
        equations.prepare(parameters, constants)
        equations.batch(given, constants, found, 0, 1)
        legs = joints - base
        lengths = np.linalg.norm(legs, axis=1, keepdims=True)
        directions = legs / lengths
        jacobians = np.stack(
            [found[0].reshape(6, 6).T, np.hstack([directions, np.cross(joints, directions)])]
        )
        radius = np.sqrt(np.mean(np.sum(joints**2, axis=1)))
        conditions = condition_numbers(jacobians, np.vstack([lengths.T] * 2), radius)
        if lengths.min() < 1e-2 * radius:
            conditions = conditions[:1]  # rounding of coordinates makes another J of it
        assert not (passed and (conditions > SINGULAR_CONDITION).any()), seed
        regular, singular = regular + passed, singular + (conditions[0] > SINGULAR_CONDITION)
    assert min(regular, singular) > 200  # the draw has enough of both
