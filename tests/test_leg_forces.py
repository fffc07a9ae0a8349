"""Leg forces of one sample: any form of numbers, and whatever else users pass to a control loop."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from hypothesis import given
from hypothesis import strategies as st

import sixsps
from sixsps.errors import InputError
from sixsps.kernels.compiled import kernel
from sixsps.kernels.signatures import FORCES
from sixsps.kinematics import inverse_kinematics

UNIT_ROUNDOFF = np.finfo(float).eps / 2
ARRAYS = tuple(FORCES.arrays)


@pytest.fixture(scope="module")
def model():
    return sixsps.compile(random_mechanism(1), threads=1)


@pytest.fixture(scope="module")
def motion():
    return random_motion(random_mechanism(1), 1, samples=1)


@pytest.fixture(scope="module")
def sample(motion):
    """Arguments of `leg_forces`, for the mechanism of `model`."""
    return {name: np.array(getattr(motion, name)[0]) for name in ARRAYS}


def bound(mechanism, motion, expected):
    """Rounding of a backward stable solve, as between `kane` and any other formulation."""
    growth = inverse_kinematics(mechanism, motion).error_growth
    return 20 * UNIT_ROUNDOFF * growth * np.abs(expected).max(axis=1)


def test_one_sample_has_the_bits_of_a_batch(model):
    motion = random_motion(model.mechanism, 3, samples=13)
    batch = model.inverse_dynamics(motion)
    for k in range(13):
        one = model.leg_forces(*(getattr(motion, name)[k] for name in ARRAYS))
        assert one.tobytes() == batch[k].tobytes()


def test_what_is_not_given_is_at_rest_and_without_load(model, sample):
    at = at_rest(sample["position"], sample["quaternion"])
    one = model.leg_forces(sample["position"], sample["quaternion"])
    assert one.tobytes() == model.inverse_dynamics(at)[0].tobytes()
    for name in ARRAYS[2:]:
        alone = model.leg_forces(sample["position"], sample["quaternion"], **{name: sample[name]})
        moving = dataclasses.replace(at, **{name: sample[name][None]})
        assert alone.tobytes() == model.inverse_dynamics(moving)[0].tobytes()


def unaligned(array):
    buffer = np.zeros(array.nbytes + 1, np.uint8)
    shifted = buffer[1:].view(np.float64)
    shifted[:] = array
    assert not shifted.flags.aligned
    return shifted


def strided(array):
    wide = np.full((len(array), 3), np.nan)
    wide[:, 1] = array
    return wide[:, 1]


def fixed(array):
    copied = array.copy()
    copied.setflags(write=False)
    return copied


SAME = {
    "list": lambda a: a.tolist(),
    "tuple": tuple,
    "list of scalars": list,
    "read-only": fixed,
    "strided": strided,
    "reversed": lambda a: a[::-1].copy()[::-1],
    "other byte order": lambda a: a.astype(">f8"),
    "unaligned": unaligned,
    "long double": lambda a: a.astype(np.longdouble),
}


@pytest.mark.parametrize("form", SAME)
def test_numbers_in_any_form_are_the_same_numbers(model, sample, form):
    expected = model.leg_forces(**sample)
    for name in ARRAYS:
        found = model.leg_forces(**sample | {name: SAME[form](sample[name])})
        assert found.tobytes() == expected.tobytes()


@pytest.mark.parametrize("kind", [np.float32, np.float16, np.int64, np.int8, np.uint16])
def test_numbers_of_other_kinds_are_read_exactly(model, sample, kind):
    values = np.array([1, 2, 3], kind)
    expected = model.leg_forces(**sample | {"position": [1.0, 2.0, 3.0]})
    assert model.leg_forces(**sample | {"position": values}).tobytes() == expected.tobytes()


WRONG = {
    "column": np.zeros((3, 1)),
    "row": np.zeros((1, 3)),
    "two": np.zeros(2),
    "five": np.zeros(5),
    "none": np.zeros(0),
    "scalar": 1.0,
    "nothing": None,
    "text": "abc",
    "numbers as text": "1 2 3",
    "list of text": ["1", "2", "3"],
    "bytes": b"abc",
    "ragged": [[1.0], [2.0, 3.0]],
    "mapping": {},
    "complex list": [1j, 0, 0],
    "complex": np.array([1j, 0, 0, 0]),
    "no imaginary part": np.zeros(3, complex),
    "dates": np.zeros(3, "M8[D]"),
    "durations": np.zeros(3, "m8[s]"),
    "too large": [10**400, 0, 0],
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_not_a_vector_of_numbers_is_named(model, sample, case):
    for name in ARRAYS:
        with pytest.raises(InputError) as raised:
            model.leg_forces(**sample | {name: WRONG[case]})
        assert str(raised.value).startswith(f"{name}: ")
        assert "\n" not in str(raised.value)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_gives_nan(model, sample, value):
    for name in ARRAYS:
        for column in range(len(sample[name])):
            broken = sample[name].copy()
            broken[column] = value
            assert not np.isfinite(model.leg_forces(**sample | {name: broken})).any()
            assert np.isfinite(model.leg_forces(**sample)).all()


@given(exponent=st.integers(-150, 150), sign=st.sampled_from([-1.0, 1.0]))
def test_the_length_of_the_quaternion_does_not_matter(model, sample, motion, exponent, sign):
    """Its components are rounded once more, no worse than coordinates are."""
    forces = model.leg_forces(**sample)
    other = model.leg_forces(**sample | {"quaternion": sign * 10.0**exponent * sample["quaternion"]})
    assert np.abs(other - forces).max() <= bound(model.mechanism, motion, forces[None])[0]


@pytest.mark.parametrize("size", [0.0, 1e-165, 1e-200, 1e-320, 1e160, 1e300])
def test_a_quaternion_beyond_all_bounds_gives_the_forces_or_nan(model, sample, size):
    """Its squared length underflows or overflows; a wrong rotation must not come of it."""
    forces = model.leg_forces(**sample | {"quaternion": size * sample["quaternion"]})
    if not np.isnan(forces).all():
        np.testing.assert_allclose(forces, model.leg_forces(**sample), rtol=1e-9)


def test_the_result_is_in_out(model, sample):
    expected, out = model.leg_forces(**sample), np.full(8, -1.0)
    found = model.leg_forces(**sample, out=out[1:7])
    assert np.shares_memory(found, out)
    assert out[1:7].tobytes() == expected.tobytes()
    assert np.all(out[[0, 7]] == -1)


NO_RESULT = {
    "float32": lambda: np.zeros(6, np.float32),
    "integers": lambda: np.zeros(6, int),
    "complex": lambda: np.zeros(6, complex),
    "other byte order": lambda: np.zeros(6, ">f8"),
    "five": lambda: np.zeros(5),
    "seven": lambda: np.zeros(7),
    "row": lambda: np.zeros((1, 6)),
    "column": lambda: np.zeros((6, 1)),
    "strided": lambda: np.zeros(12)[::2],
    "read-only": lambda: fixed(np.zeros(6)),
    "list": lambda: [0.0] * 6,
    "number": lambda: 0.0,
    "text": lambda: "abcdef",
}


@pytest.mark.parametrize("case", NO_RESULT)
def test_an_out_that_cannot_take_one_sample_is_refused(model, sample, case):
    out = NO_RESULT[case]()
    with pytest.raises(InputError, match=r"^out: .*float64.*shape \(6,\)"):
        model.leg_forces(**sample, out=out)
    assert np.isfinite(model.leg_forces(**sample)).all()  # and does no harm to what comes after


@pytest.mark.parametrize("shift", [0, 1, 3])
def test_out_may_lie_where_an_input_is(model, sample, shift):
    expected = model.leg_forces(**sample)
    for name in ARRAYS:
        memory = np.zeros(16)
        place = memory[3 : 3 + len(sample[name])]
        place[:] = sample[name]
        out = memory[shift : shift + 6]
        found = model.leg_forces(**sample | {name: place}, out=out)
        assert found.tobytes() == expected.tobytes()


def test_an_unaligned_out_is_filled_or_refused(model, sample):
    expected = model.leg_forces(**sample)
    out = unaligned(np.zeros(6))
    try:
        model.leg_forces(**sample, out=out)
    except InputError:
        return
    assert out.tobytes() == expected.tobytes()


def test_with_out_a_call_leaves_no_memory_behind(model, sample):
    out, arguments = np.empty(6), tuple(sample.values())
    for _ in range(100):
        model.leg_forces(*arguments, out)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(10_000):
            model.leg_forces(*arguments, out)
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # A kept object a call would be hundreds of kilobytes; at any time there are a few tuples.
    assert after - before < 4096
    assert peak - before < 65536


def test_a_leg_without_length_gives_nan_and_does_no_harm(model, sample):
    mechanism = model.mechanism
    shut = mechanism.base_anchors[2] - mechanism.platform_anchors[2]
    out = np.zeros(6)
    for _ in range(2):
        given = sample | {"position": shut, "quaternion": [1, 0, 0, 0]}
        assert model.leg_forces(**given, out=out) is out
        assert np.isnan(out).all()
        assert np.isfinite(model.leg_forces(**sample, out=out)).all()


def test_a_singular_pose_has_nothing_left_to_compile(sample):
    """In a control loop: seconds on a new machine, tens of milliseconds where there is machine code."""
    kernel.cache_clear()
    model = sixsps.compile(random_mechanism(1))
    before = kernel.cache_info().misses
    shut = model.mechanism.base_anchors[0] - model.mechanism.platform_anchors[0]
    assert np.isnan(model.leg_forces(shut, [1, 0, 0, 0])).all()
    assert kernel.cache_info().misses == before
