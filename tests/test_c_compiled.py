"""The C files compiled, as strictly as a compiler can be told to, and run against the formulations."""

import ctypes
import os
import platform
import re
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism, random_motion
from scipy.spatial.transform import Rotation

from compare.c_export import export_c
from compare.tolerances import tolerance_of
from sixsps import symbolic
from sixsps.formulations import inverse_dynamics
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.parameters import parameter_vector
from sixsps.trajectories import bundled

STRICT = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-pedantic",
    "-Wconversion",
    "-Wshadow",
    "-Wmissing-prototypes",
]
STRICT_CPP = ["-std=c++11", "-Wall", "-Wextra", "-Werror", "-pedantic"]
OK, NOT_REGULAR, NOT_FINITE = 0, 1, 2
TWIST = ("velocity", "angular_velocity")
ACCELERATION = ("position", "quaternion", *TWIST, "acceleration", "angular_acceleration")
GIVEN = {
    "leg_forces": (*ACCELERATION, "force", "moment"),
    "leg_motion": ACCELERATION,
    "leg_force_derivatives": (*ACCELERATION, "force", "moment"),
}
SIZES = {"leg_forces": [6], "leg_motion": [6, 6, 6], "leg_force_derivatives": [6, 36, 36, 36, 36]}
UNTOUCHED = -12345.0
# C without contraction does what CasADi's virtual machine does, in the same order.
EXACT = platform.machine() in ("x86_64", "AMD64", "aarch64", "arm64")


def compilers():
    """Compilers of C on this machine, each once whatever its names."""
    found = {name: shutil.which(name) for name in ("gcc", "clang", "cc")}
    return {os.path.realpath(path): name for name, path in reversed(found.items()) if path}.values()


def needed(program):
    if shutil.which(program) is None:
        pytest.skip(f"there is no {program} on this machine")
    return program


def run(*arguments, **options):
    return subprocess.run([*map(str, arguments)], capture_output=True, text=True, **options)


def compiled(*arguments, **options):
    done = run(*arguments, **options)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.fixture(scope="module", params=list(compilers()) or ["cc"])
def compiler(request):
    return needed(request.param)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("exported")
    export_c(Mechanism.load("wu2012"), place, derivatives=True)
    return place


class Library:
    """The functions of a shared library, called as C would."""

    def __init__(self, path):
        self._library = ctypes.CDLL(str(path))

    def __call__(self, name, mechanism, sample, **changed):
        arrays = [parameter_vector(mechanism)] if isinstance(mechanism, Mechanism) else [mechanism]
        arrays += [np.array(changed.get(key, getattr(sample, key)[0]), float) for key in GIVEN[name]]
        results = [np.full(size, UNTOUCHED) for size in SIZES[name]]
        return self.call(name, arrays, results), results

    def call(self, name, arrays, results):
        pointers = [array.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for array in (*arrays, *results)]
        return getattr(self._library, f"hexapod_{name}")(*pointers)


@pytest.fixture(scope="module")
def library(compiler, folder):
    path = folder / f"{compiler}.so"
    options = [*STRICT, "-O2", "-ffp-contract=off", "-fPIC", "-shared"]
    compiled(compiler, *options, folder / "hexapod.c", "-o", path, "-lm")
    return Library(path)


@pytest.mark.parametrize("options", [["-O0"], ["-O3"], ["-Os"], ["-std=c11", "-O1"], ["-std=gnu99", "-O1"]])
def test_it_compiles_without_a_warning(compiler, tmp_path, options):
    export_c(random_mechanism(1), tmp_path)
    for name in ("hexapod.c", "example.c"):
        compiled(compiler, *STRICT, *options, "-c", tmp_path / name, "-o", tmp_path / "object.o")


@pytest.mark.parametrize("name", ["wu2012", "*/ int /* ", "??/", "*\\", '"\\', "Bühne 六足 🤖" * 10])
def test_a_hostile_name_compiles_without_a_warning(compiler, tmp_path, name):
    export_c(replace(Mechanism.load("wu2012"), name=name, source=name, assumed={name: name}), tmp_path)
    compiled(
        compiler, *STRICT, "-Wtrigraphs", "-Wcomment", "-c", "example.c", "-o", "example.o", cwd=tmp_path
    )


@pytest.mark.parametrize("seed", range(20))
def test_forces_and_lengths_are_those_of_the_formulations(library, seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed, samples=10)
    forces, legs = inverse_dynamics(mechanism, motion), inverse_kinematics(mechanism, motion)
    # Both may be off by this much.
    allowed = 2 * tolerance_of("casadi").relative(legs.error_growth) * np.abs(forces).max(axis=1)
    for k in range(len(motion)):
        status, (found,) = library("leg_forces", mechanism, motion[k : k + 1])
        assert status == OK
        assert np.abs(found - forces[k]).max() <= allowed[k]
        status, found = library("leg_motion", mechanism, motion[k : k + 1])
        assert status == OK
        for values, expected in zip(
            found, (legs.lengths, legs.length_rates, legs.length_accelerations), strict=True
        ):
            # Some hundred operations on numbers of this size, divided by a leg's length.
            size = np.abs(expected).max() * (1 + legs.coordinates[k] / legs.lengths[k].min())
            assert np.abs(values - expected[k]).max() <= 1e3 * np.finfo(float).eps * size


@pytest.mark.skipif(not EXACT, reason="this processor does not round every operation to 64 bits")
@pytest.mark.parametrize("name", BUNDLED)
def test_every_result_is_that_of_casadi_to_the_last_bit(library, name):
    mechanism = Mechanism.load(name)
    motion = bundled("sinusoids", mechanism, 7)
    functions = {
        "leg_forces": symbolic.forces(),
        "leg_motion": symbolic.leg_motion(),
        "leg_force_derivatives": symbolic.force_derivatives(),
    }
    for called, function in functions.items():
        expected = list(symbolic.evaluate(function, mechanism, motion).values())
        for k in range(len(motion)):
            status, found = library(called, mechanism, motion[k : k + 1])
            assert status == OK
            for values, whole in zip(found, expected, strict=False):  # the regularity is not handed out
                assert np.array_equal(values, whole[k].ravel())


def test_near_a_singular_pose_the_answer_is_what_the_header_says(library, wu2012):
    seen = set()
    for height in 10.0 ** -np.arange(0, 17, 0.25):
        sample = at_rest([0.01, 0.02, height])
        condition = inverse_kinematics(wu2012, sample).condition[0]
        for name in ("leg_forces", "leg_force_derivatives"):
            status, results = library(name, wu2012, sample)
            assert status in (OK, NOT_REGULAR)
            assert status == NOT_REGULAR or condition < 5e11
            assert status == OK or condition > 100
            assert all((values == UNTOUCHED).all() == (status != OK) for values in results)
            seen.add(status)
    assert seen == {OK, NOT_REGULAR}


@pytest.mark.parametrize("seed", range(20))
def test_a_pose_that_is_well_conditioned_is_never_refused(library, seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed, samples=20, tilt=1.5)
    for k in np.flatnonzero(inverse_kinematics(mechanism, motion).condition < 100):
        assert library("leg_forces", mechanism, motion[k : k + 1])[0] == OK


NAN, INFINITE = [np.nan, 0, 0], [0, -np.inf, 0]


@pytest.mark.parametrize(
    ("changed", "forces", "motion"),
    [
        ({"position": NAN}, NOT_REGULAR, NOT_FINITE),
        ({"position": INFINITE}, NOT_REGULAR, NOT_FINITE),
        ({"quaternion": [0, 0, 0, 0]}, NOT_REGULAR, NOT_FINITE),
        ({"quaternion": [np.nan, 0, 0, 0]}, NOT_REGULAR, NOT_FINITE),
        ({"velocity": NAN}, NOT_FINITE, NOT_FINITE),
        ({"angular_acceleration": INFINITE}, NOT_FINITE, NOT_FINITE),
        ({"angular_velocity": [1e200, 0, 0]}, NOT_FINITE, NOT_FINITE),
        ({"force": INFINITE}, NOT_FINITE, OK),
        ({"moment": NAN}, NOT_FINITE, OK),
    ],
)
def test_what_is_not_finite_is_told_and_nothing_is_written(library, wu2012, changed, forces, motion):
    sample = bundled("line", wu2012, 3)[1:2]
    for name, expected in (("leg_forces", forces), ("leg_force_derivatives", forces), ("leg_motion", motion)):
        status, results = library(name, wu2012, sample, **changed)
        assert status == expected
        assert all((values == UNTOUCHED).all() == (status != OK) for values in results)


def test_a_leg_without_length_is_told(library, wu2012):
    # Anchors in binary fractions, so that the length is 0 and not a rounding error.
    base, platform_anchors = (
        np.round(1024 * a) / 1024 for a in (wu2012.base_anchors, wu2012.platform_anchors)
    )
    mechanism = replace(wu2012, base_anchors=base, platform_anchors=platform_anchors)
    sample = at_rest(base[0] - platform_anchors[0])
    assert library("leg_forces", mechanism, sample)[0] == NOT_REGULAR
    assert library("leg_motion", mechanism, sample)[0] == NOT_FINITE


@pytest.mark.parametrize("number", [0.0, np.nan, np.inf])
def test_parameters_of_nothing_are_told(library, wu2012, number):
    sample = bundled("line", wu2012, 3)[1:2]
    assert library("leg_forces", np.full(97, number), sample)[0] != OK


def test_a_quaternion_may_have_any_length(library, wu2012):
    turned = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_quat(scalar_first=True)
    sample = at_rest([0.0, 0.0, 0.6], turned)
    _, (unit,) = library("leg_forces", wu2012, sample)
    for factor in (-1.0, 2.0**-20, 2.0**20):
        status, (found,) = library("leg_forces", wu2012, sample, quaternion=factor * turned)
        assert status == OK
        assert np.array_equal(found, unit)


def test_results_may_overlap_what_is_given(library, wu2012):
    sample = bundled("sinusoids", wu2012, 5)[2:3]
    _, (expected,) = library("leg_forces", wu2012, sample)
    parameters = parameter_vector(wu2012)
    rest = [getattr(sample, key)[0].copy() for key in GIVEN["leg_forces"]]
    assert library.call("leg_forces", [parameters, *rest], [parameters]) == OK
    assert np.array_equal(parameters[:6], expected)
    assert np.array_equal(parameters[6:], parameter_vector(wu2012)[6:])


def test_two_threads_may_call_at_the_same_time(library):
    mechanisms = [random_mechanism(seed) for seed in (1, 2)]
    motions = [random_motion(mechanism, 5, samples=20) for mechanism in mechanisms]

    def forces(which, rounds):
        samples = [motions[which][k : k + 1] for k in range(20)] * rounds
        return [library("leg_force_derivatives", mechanisms[which], sample)[1][0] for sample in samples]

    alone = [forces(which, 1) for which in (0, 1)]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(forces, (0, 1), (50, 50)))
    for one, both in zip(alone, together, strict=True):
        assert np.array_equal(both, one * 50)


def test_it_needs_sqrt_and_nothing_else_and_keeps_no_data(compiler, folder):
    target = folder / "object.o"
    compiled(compiler, "-std=c99", "-O3", "-fno-stack-protector", "-c", folder / "hexapod.c", "-o", target)
    symbols = [line.split() for line in run(needed("nm"), target).stdout.splitlines()]
    # The second name is a compiler's for code that may be loaded anywhere, not a function's.
    needs = {name.lstrip("_") for *_, kind, name in symbols if kind in "Uw"}
    assert needs <= {"sqrt", "GLOBAL_OFFSET_TABLE_"}
    assert {kind for *_, kind, _ in symbols} <= set("UTtrsN")  # no data that could be written
    functions = {name.lstrip("_") for *_, kind, name in symbols if kind == "T"}
    assert functions == {f"hexapod_{name}" for name in GIVEN}


def test_the_stack_is_as_small_as_the_header_says(folder):
    about = (folder / "hexapod.h").read_text().replace("\n *", "")
    (stated,) = re.findall(r"Stack: at most (\d+) KiB", about)
    for optimisation in ("-O0", "-O1"):
        options = ["-std=c99", optimisation, "-fstack-usage", "-c", "hexapod.c", "-o", "stack.o"]
        compiled(needed("gcc"), *options, cwd=folder)
        frames = [int(line.split("\t")[1]) for line in (folder / "stack.su").read_text().splitlines()]
        # What is called calls one function more, and that at most a small one.
        assert sum(sorted(frames)[-3:]) <= 1024 * int(stated)


def test_options_that_take_every_number_for_finite_are_refused(compiler, folder):
    done = run(compiler, "-O1", "-ffast-math", "-fsyntax-only", folder / "hexapod.c")
    assert done.returncode != 0
    assert "compile without -ffast-math" in done.stderr


def example(compiler, place):
    """Compiles and runs the example by the command that stands in it."""
    (command,) = re.findall(r"^ \*   cc (.*) && (\S+)$", (place / "example.c").read_text(), re.MULTILINE)
    compiled(compiler, *STRICT, *command[0].split(), cwd=place)
    return run(place / Path(command[1]).name, cwd=place)


@pytest.mark.parametrize(
    "mechanism", [*map(Mechanism.load, BUNDLED), *map(random_mechanism, range(5))], ids=lambda one: one.name
)
def test_the_example_agrees_with_kane(compiler, tmp_path, mechanism):
    export_c(mechanism, tmp_path)
    done = example(compiler, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    table = np.array([line.split() for line in done.stdout.splitlines()[1:7]], float)
    assert table[:, 0].tolist() == [1, 2, 3, 4, 5, 6]
    assert (
        np.abs(table[:, 2] - table[:, 3]).max() <= 1e-8 * np.abs(table[:, 3]).max()
    )  # nine digits are printed
    assert "\n0 of 6 forces are further apart" in done.stdout


def test_the_example_tells_when_the_forces_are_others(compiler, tmp_path):
    export_c(Mechanism.load("wu2012"), tmp_path)
    numbers = tmp_path / "hexapod_parameters.h"
    numbers.write_text(numbers.read_text().replace("-9.81,", "-9.80665,"))
    assert example(compiler, tmp_path).returncode == 1


def test_cpp_takes_the_headers_and_links_with_c(compiler, tmp_path):
    program = needed({"gcc": "g++", "clang": "clang++"}.get(compiler, "c++"))
    export_c(Mechanism.load("wu2012"), tmp_path)
    (tmp_path / "example.c").rename(tmp_path / "example.cpp")
    compiled(compiler, *STRICT, "-c", "hexapod.c", "-o", "hexapod.o", cwd=tmp_path)
    compiled(program, *STRICT_CPP, "example.cpp", "hexapod.o", "-o", "example", "-lm", cwd=tmp_path)
    assert run(tmp_path / "example").returncode == 0
    compiled(program, *STRICT_CPP, "-x", "c++", "-c", "hexapod.c", "-o", "hexapod.o", cwd=tmp_path)
