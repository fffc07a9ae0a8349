"""`sixsps.compile`: its results against the other formulations, and whatever else users pass to it."""

import copy
import dataclasses
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from cases import random_mechanism, random_motion, scaled
from hypothesis import given
from hypothesis import strategies as st

import sixsps
from sixsps.errors import InputError
from sixsps.kernels.compiled import kernel
from sixsps.kernels.signatures import FORCES
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2


@pytest.fixture(scope="module")
def model():
    return sixsps.compile(random_mechanism(1), threads=2)


def bound(mechanism, motion, expected):
    """Rounding of two backward stable solves; 20 as between `kane` and any other formulation."""
    growth = inverse_kinematics(mechanism, motion).error_growth
    return 20 * UNIT_ROUNDOFF * growth * np.abs(expected).max(axis=1)


@given(seed=st.integers(0, 10_000))
def test_forces_agree_with_kane(seed):
    mechanism = random_mechanism(seed % 40)
    motion = random_motion(mechanism, seed, samples=7)
    forces = sixsps.compile(mechanism).inverse_dynamics(motion)
    expected = sixsps.inverse_dynamics(mechanism, motion)
    assert np.all(np.abs(forces - expected).max(axis=1) <= bound(mechanism, motion, expected))


def test_leg_motion_agrees_with_inverse_kinematics(mechanism):
    motion = bundled("sinusoids", mechanism, 50)
    found = sixsps.compile(mechanism).inverse_kinematics(motion)
    expected = inverse_kinematics(mechanism, motion)
    for name in ("lengths", "length_rates", "length_accelerations"):
        wanted = getattr(expected, name)
        assert np.abs(getattr(found, name) - wanted).max() <= 1e-13 * np.abs(wanted).max(), name


def test_equations_are_those_of_kane(mechanism):
    from sixsps.formulations.kane import actuator_wrench

    motion = bundled("sinusoids", mechanism, 50)
    J, C = sixsps.compile(mechanism).equations(motion)
    legs = inverse_kinematics(mechanism, motion)
    expected = actuator_wrench(mechanism, motion, legs)
    assert np.abs(J - legs.jacobian.swapaxes(1, 2)).max() <= 1e-14 * np.abs(legs.jacobian).max()
    # Rounding of the sum that C is: of its largest terms, weights and inertia forces.
    assert np.abs(C - expected).max() <= 1e-13 * np.abs(expected).max()


def test_derivatives_come_with_the_forces_of_the_other_method(model):
    motion = random_motion(model.mechanism, 1, samples=20)
    found, forces = model.inverse_dynamics_derivatives(motion), model.inverse_dynamics(motion)
    assert found.forces.shape == (20, 6)
    assert np.all(np.abs(found.forces - forces).max(axis=1) <= bound(model.mechanism, motion, forces))
    for name in ("by_pose", "by_twist", "by_acceleration", "by_wrench"):
        assert getattr(found, name).shape == (20, 6, 6)
    assert model.parameter_derivatives(motion).shape == (20, 6, 97)


def fixed(array):
    array.setflags(write=False)
    return array


NO_RESULTS = {
    "float32": lambda: np.zeros((5, 6), np.float32),
    "other byte order": lambda: np.zeros((5, 6), ">f8"),
    "four rows": lambda: np.zeros((4, 6)),
    "six rows": lambda: np.zeros((6, 6)),
    "flat": lambda: np.zeros(30),
    "columns": lambda: np.zeros((6, 5)).T,
    "every other column": lambda: np.zeros((5, 12))[:, ::2],
    "read-only": lambda: fixed(np.zeros((5, 6))),
    "list": lambda: [[0.0] * 6] * 5,
    "deeper": lambda: np.zeros((5, 6, 1)),
}


@pytest.mark.parametrize("case", NO_RESULTS)
def test_an_out_that_cannot_take_a_motion_is_refused(model, case):
    motion = random_motion(model.mechanism, 1, samples=5)
    with pytest.raises(InputError, match=r"^out: .*float64.*shape \(5, 6\)"):
        model.inverse_dynamics(motion, out=NO_RESULTS[case]())
    assert np.isfinite(model.inverse_dynamics(motion)).all()


def test_an_unaligned_out_is_filled_or_refused(model):
    motion = random_motion(model.mechanism, 1, samples=2)
    out = np.zeros(97, np.uint8)[1:].view(np.float64).reshape(2, 6)
    try:
        model.inverse_dynamics(motion, out)
    except InputError:
        return
    assert out.tobytes() == model.inverse_dynamics(motion).tobytes()


@pytest.mark.parametrize("samples", [0, 1])
def test_motions_of_no_and_of_one_sample(model, samples):
    motion = random_motion(model.mechanism, 1, samples=samples)
    derivatives = model.inverse_dynamics_derivatives(motion)
    J, C = model.equations(motion)
    legs = model.inverse_kinematics(motion)
    shapes = {
        (6,): (model.inverse_dynamics(motion), model.inverse_dynamics(motion, np.empty((samples, 6))),
               derivatives.forces, C, legs.lengths, legs.length_rates, legs.length_accelerations),
        (6, 6): (derivatives.by_pose, derivatives.by_twist, derivatives.by_acceleration,
                 derivatives.by_wrench, J),
        (6, 97): (model.parameter_derivatives(motion),),
    }  # fmt: skip
    for shape, arrays in shapes.items():
        for array in arrays:
            assert array.shape == (samples, *shape)
            assert np.isfinite(array).all()


@pytest.mark.parametrize("threads", [0, -1, 1.5, 2.0, True, "2", [1], np.nan])
def test_threads_that_cannot_be_are_refused(threads):
    with pytest.raises(InputError, match=r"^threads: .*positive whole number"):
        sixsps.compile(random_mechanism(1), threads)


@pytest.mark.parametrize("threads", [None, 1, 2, 64])
def test_any_number_of_threads_will_do(threads):
    mechanism = random_mechanism(1)
    motion = random_motion(mechanism, 1, samples=9)
    found = sixsps.compile(mechanism, threads).inverse_dynamics(motion)
    assert found.tobytes() == sixsps.compile(mechanism, 1).inverse_dynamics(motion).tobytes()


def test_parameters_are_inputs_of_the_kernel():
    """Mechanisms take turns: each has its own forces, and nothing is compiled for the next one."""
    mechanisms = [random_mechanism(seed) for seed in range(3)]
    models = [sixsps.compile(mechanism) for mechanism in mechanisms]
    motions = [random_motion(mechanism, 5, samples=3) for mechanism in mechanisms]
    forces = [model.inverse_dynamics(motion) for model, motion in zip(models, motions, strict=True)]
    before = kernel.cache_info().misses
    for k in (2, 0, 1, 1, 0, 2):
        assert models[k].inverse_dynamics(motions[k]).tobytes() == forces[k].tobytes()
        expected = sixsps.inverse_dynamics(mechanisms[k], motions[k])
        assert np.all(np.abs(forces[k] - expected).max(axis=1) <= bound(mechanisms[k], motions[k], expected))
    other = sixsps.compile(scaled(mechanisms[0], 3.0, 2.0)).inverse_dynamics(motions[0])
    assert np.abs(other - forces[0]).max() > 0.01 * np.abs(forces[0]).max()
    assert kernel.cache_info().misses == before


CHUNK = 8192


@pytest.fixture(scope="module")
def broken(model):
    """A motion of two chunks with singular samples in it, and where they are."""
    mechanism = model.mechanism
    motion = random_motion(mechanism, 1, samples=2 * CHUNK + 7)
    position, quaternion = np.array(motion.position), np.array(motion.quaternion)
    places = [0, 1, 4099, CHUNK - 1, CHUNK + 5, len(motion) - 1]
    for leg, k in enumerate(places):
        position[k] = mechanism.base_anchors[leg] - mechanism.platform_anchors[leg]
        quaternion[k] = [1, 0, 0, 0]
    singular = np.zeros(len(motion), bool)
    singular[places] = True
    return dataclasses.replace(motion, position=position, quaternion=quaternion), singular


def test_singular_samples_are_nan_and_their_neighbours_are_not(model, broken):
    motion, singular = broken
    forces = model.inverse_dynamics(motion)
    assert np.array_equal(np.isnan(forces).all(axis=1), singular)
    assert np.isfinite(forces[~singular]).all()
    regular = motion[~singular]
    assert forces[~singular].tobytes() == model.inverse_dynamics(regular).tobytes()


def test_singular_samples_are_nan_in_every_derivative(model, broken):
    motion, singular = broken
    kept = np.arange(CHUNK - 40, CHUNK + 40)
    motion, singular = motion[kept], singular[kept]
    found = model.inverse_dynamics_derivatives(motion)
    arrays = [getattr(found, field.name) for field in dataclasses.fields(found)]
    for array in (*arrays, model.parameter_derivatives(motion)):
        flat = array.reshape(len(motion), -1)
        assert np.array_equal(np.isnan(flat).all(axis=1), singular)
        assert np.isfinite(flat[~singular]).all()


def test_out_is_nan_where_the_pose_is_singular(model, broken):
    motion, singular = broken
    out = np.zeros((len(motion), 6))
    assert model.inverse_dynamics(motion, out) is out
    assert np.array_equal(np.isnan(out).all(axis=1), singular)


def test_python_threads_share_a_model(model, broken):
    """Kernels release the lock: calls run at once, each with the result it has alone."""
    motion, _ = broken
    names = tuple(FORCES.arrays)
    whole, slopes = model.inverse_dynamics(motion), model.inverse_dynamics_derivatives(motion[:50]).by_pose

    def work(turn):
        if turn % 4 == 0:
            return model.inverse_dynamics(motion).tobytes() == whole.tobytes()
        if turn % 4 == 1:
            found = model.inverse_dynamics_derivatives(motion[:50]).by_pose
            return found.tobytes() == slopes.tobytes()
        out, right = np.empty(6), True
        for k in range(turn, 4000, 37):
            model.leg_forces(*(getattr(motion, name)[k] for name in names), out=out)
            right &= out.tobytes() == whole[k].tobytes()
        return right

    with ThreadPoolExecutor(6) as pool:
        assert all(pool.map(work, range(24)))


def test_threads_that_compile_at_once_get_the_same_kernels():
    mechanism = random_mechanism(2)
    motion = random_motion(mechanism, 2, samples=5)
    kernel.cache_clear()
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: sixsps.compile(mechanism).inverse_dynamics(motion), range(4)))
    assert len({forces.tobytes() for forces in found}) == 1


INHERITED = {}


def inherited_forces():
    """In a forked process: by the model that it has from its parent."""
    return INHERITED["model"].inverse_dynamics(INHERITED["motion"])


def forces_of(model, motion):
    return model.inverse_dynamics(motion)


def recompiled(mechanism, motion):
    return sixsps.compile(mechanism).inverse_dynamics(motion)


def processes(method):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} here")
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(method))


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_model_works_after_a_fork(model, broken):
    motion, _ = broken
    expected = model.inverse_dynamics(motion)
    INHERITED.update(model=model, motion=motion)
    with processes("fork") as pool:
        jobs = [pool.submit(inherited_forces), pool.submit(recompiled, model.mechanism, motion)]
        for job in jobs:
            assert job.result(timeout=300).tobytes() == expected.tobytes()


COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda model: pickle.loads(pickle.dumps(model)),
    "old pickle": lambda model: pickle.loads(pickle.dumps(model, protocol=2)),
}


@pytest.mark.parametrize("form", COPIES)
def test_a_copy_gives_the_same_forces(model, form):
    motion = random_motion(model.mechanism, 4, samples=6)
    copied = COPIES[form](model)
    assert copied.threads == model.threads
    assert copied.mechanism == model.mechanism
    assert copied.inverse_dynamics(motion).tobytes() == model.inverse_dynamics(motion).tobytes()
    assert copied.parameter_derivatives(motion).tobytes() == model.parameter_derivatives(motion).tobytes()


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_model_can_be_sent_to_another_process(model, method):
    motion = random_motion(model.mechanism, 4, samples=6)
    with processes(method) as pool:
        found = pool.submit(forces_of, model, motion).result(timeout=300)
    assert found.tobytes() == model.inverse_dynamics(motion).tobytes()


def test_a_pickled_model_is_small(model):
    """What it is made of, not its machine code."""
    assert len(pickle.dumps(model)) < 3 * len(pickle.dumps(model.mechanism))


def test_derivatives_go_where_they_are_asked_to():
    mechanism = random_mechanism(2)
    motion = random_motion(mechanism, 2, samples=11)
    model = sixsps.compile(mechanism)
    expected = model.inverse_dynamics_derivatives(motion)
    given = dataclasses.replace(
        expected, **{name: np.full_like(array, np.nan) for name, array in vars(expected).items()}
    )
    found = model.inverse_dynamics_derivatives(motion, out=given)
    for name, array in vars(expected).items():
        assert getattr(found, name) is getattr(given, name)
        assert getattr(found, name).tobytes() == array.tobytes()
    with pytest.raises(sixsps.InputError, match="out: "):
        model.inverse_dynamics_derivatives(motion[:10], out=given)
