"""Machine code on disk: found again, never taken for another's, and not missed where it cannot be kept."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from cases import random_mechanism, random_motion

import sixsps
from sixsps import sources, symbolic
from sixsps.kernels import compiled
from sixsps.kernels.compiled import kernel
from sixsps.kernels.emission import CAPACITY
from sixsps.kernels.signatures import EQUATIONS, LEG_MOTION
from sixsps.parameters import parameter_vector

PACKAGE = Path(sixsps.__file__).parent
FUNCTIONS = ("prepare", "_wide", "single")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder for machine code that has none yet."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "code"))
    return tmp_path / "code"


def made(signature=LEG_MOTION):
    """A kernel as a new process makes it: read from disk, or compiled."""
    one = kernel.__wrapped__(signature)
    one.single  # noqa: B018  made when it is asked for
    return one


def hits(one):
    """How many of the three functions of a kernel were found on disk."""
    return sum(sum(getattr(one, name).stats.cache_hits.values()) for name in FUNCTIONS)


def stored(folder):
    """Path -> (content, time of change) of the files of machine code."""
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.rglob("*.nb*")}


def assert_right(one):
    """The kernel computes what its signature says, all of it: it is not another's, and not a broken one."""
    mechanism = random_mechanism(3)
    motion = random_motion(mechanism, 3, samples=9)
    signature = one.signature
    constants = np.full(CAPACITY, np.nan)
    one.prepare(parameter_vector(mechanism), constants)
    found = tuple(np.zeros((9, size)) for size in signature.sizes.values())
    one.batch(tuple(getattr(motion, name) for name in signature.arrays), constants, found, 0, 9)
    expected = symbolic.evaluate(getattr(symbolic, signature.name)(), mechanism, motion)
    for name, array in zip(signature.outputs, found, strict=True):
        wanted = expected[name].reshape(9, -1)
        # Rounding of well-conditioned functions: a wrong kernel is wrong in the first digit.
        assert np.abs(array - wanted).max() <= 1e-10 * np.abs(wanted).max(), name
    row = tuple(getattr(motion, name)[4] for name in signature.arrays)
    alone = tuple(np.zeros(size) for size in signature.sizes.values())
    one.single(row, constants, alone)
    assert all(a.tobytes() == array[4].tobytes() for a, array in zip(alone, found, strict=True))


def test_machine_code_is_found_again(folder):
    assert hits(made()) == 0
    before = stored(folder)
    one = made()
    assert hits(one) == len(FUNCTIONS)
    assert stored(folder) == before
    assert_right(one)


CHILD = """
import sys
from sixsps.kernels.compiled import kernel
from sixsps.kernels.signatures import SIGNATURES
one = kernel(SIGNATURES[sys.argv[1]])
print(*(sum(getattr(one, name).stats.cache_hits.values()) for name in ("prepare", "_wide", "single")))
"""


def child(code, *arguments, cwd=PACKAGE.parent, **environment):
    """A process that imports the package that lies in `cwd`."""
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", code, *arguments],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | environment,
        cwd=cwd,
    )


def output(process):
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    return out


def test_machine_code_is_found_in_another_process(folder):
    made()
    before = stored(folder)
    assert output(child(CHILD, "leg_motion", NUMBA_CACHE_DIR=str(folder))) == "1 1 1\n"
    assert stored(folder) == before


def test_each_kernel_finds_its_own_machine_code(folder):
    for signature in (LEG_MOTION, EQUATIONS):
        assert hits(made(signature)) == 0
    for signature in (EQUATIONS, LEG_MOTION):
        one = made(signature)
        assert hits(one) == len(FUNCTIONS)
        assert_right(one)


def test_another_source_compiles_anew(folder, monkeypatch):
    made()
    monkeypatch.setattr(compiled, "source_digest", lambda: "another")
    assert hits(made()) == 0
    assert hits(made()) == len(FUNCTIONS)


def test_another_width_of_vectors_compiles_anew(folder, monkeypatch):
    made()
    monkeypatch.setattr(compiled, "host_width", lambda: 1)
    assert hits(made()) < len(FUNCTIONS)


@pytest.mark.parametrize("place", ["symbolic/leg.py", "kernels/emission.py", "parameters.py"])
def test_the_digest_is_of_every_source(place, tmp_path, monkeypatch):
    for name in ("symbolic", "kernels"):
        shutil.copytree(PACKAGE / name, tmp_path / name)
    shutil.copy(PACKAGE / "parameters.py", tmp_path)
    monkeypatch.setattr(sources, "files", lambda package: tmp_path)
    places = ("kernels", *sources.MODEL)
    before = sources.digest(*places)
    assert sources.digest(*places) == before
    with (tmp_path / place).open("a") as file:
        file.write("# changed\n")
    assert sources.digest(*places) != before


def test_the_digest_is_of_the_compilers_too(monkeypatch):
    before = compiled.source_digest.__wrapped__()
    monkeypatch.setattr(compiled, "version", lambda package: "0")
    assert compiled.source_digest.__wrapped__() != before


EDITED = """
import sixsps.symbolic
with open(sixsps.symbolic.__file__, "a") as file:
    file.write("_of_legs = lambda name: 2 * ca.vertcat(*(getattr(one, name) for one in _model().legs))\\n")
"""
COMPARED = """
import numpy as np
import sixsps
from sixsps import sources, symbolic
from sixsps.trajectories import bundled
mechanism = sixsps.Mechanism.load("wu2012")
motion = bundled("line", mechanism, 3)
expected = symbolic.evaluate(symbolic.leg_motion(), mechanism, motion)["lengths"]
found = sixsps.compile(mechanism).inverse_kinematics(motion).lengths
print(np.round(found / expected, 9).tolist() == np.ones((3, 6)).tolist())
"""


def test_an_edit_while_a_process_runs_does_not_outlive_it(folder, tmp_path):
    """What was imported before the edit must not be kept as the machine code of what is there after it."""
    shutil.copytree(PACKAGE, tmp_path / "sixsps", ignore=shutil.ignore_patterns("__pycache__"))
    options = {"cwd": tmp_path, "NUMBA_CACHE_DIR": str(folder)}
    output(child(EDITED + CHILD, "leg_motion", **options))
    assert output(child(COMPARED, **options)) == "True\n"


def test_without_any_folder_for_machine_code_it_is_compiled_every_time(tmp_path):
    """No `__pycache__`, no user's cache and no NUMBA_CACHE_DIR that could be written to."""
    shutil.copytree(PACKAGE, tmp_path / "sixsps", ignore=shutil.ignore_patterns("__pycache__"))
    blocked = tmp_path / "file"
    for file in (blocked, tmp_path / "sixsps" / "kernels" / "__pycache__"):
        file.touch()
    names = ("NUMBA_CACHE_DIR", "HOME", "XDG_CACHE_HOME", "LOCALAPPDATA")
    environment = dict.fromkeys(names, str(blocked))
    code = f"{CHILD}\nprint(sys.modules['sixsps'].__file__)"
    expected = f"0 0 0\n{tmp_path / 'sixsps' / '__init__.py'}\n"
    assert output(child(code, "leg_motion", cwd=tmp_path, **environment)) == expected


def test_a_full_disk_does_not_stop_the_work(folder, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    assert_right(made())


BROKEN = {
    "empty": lambda content: b"",
    "cut short": lambda content: content[: len(content) // 2],
    "overwritten": lambda content: b"\xffgarbage" * 100,
}


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", BROKEN)
def test_broken_machine_code_is_compiled_anew(folder, suffix, damage):
    made()
    for path in folder.rglob(f"*.{suffix}"):
        path.write_bytes(BROKEN[damage](path.read_bytes()))
    assert_right(made())
    one = made()
    assert hits(one) == len(FUNCTIONS)  # and kept, for the next process
    assert_right(one)


def test_lost_machine_code_is_compiled_anew(folder):
    made()
    for path in folder.rglob("*.nbc"):
        path.unlink()
    assert_right(made())
    assert hits(made()) == len(FUNCTIONS)


def test_two_processes_may_compile_the_same_kernel_at_once(folder):
    environment = {"NUMBA_CACHE_DIR": str(folder)}
    for process in [child(CHILD, "leg_motion", **environment) for _ in range(2)]:
        output(process)
    one = made()
    assert hits(one) == len(FUNCTIONS)
    assert_right(one)


IN_TURN = """
import os, sys, time
from pathlib import Path
name, folder = sys.argv[1], Path(sys.argv[2])
order = sys.argv[3:]
replace = os.replace


def reached(*marks):
    end = time.monotonic() + 10  # a way of keeping code that does not stop here need not
    while time.monotonic() < end and not all((folder / mark).exists() for mark in marks):
        time.sleep(0.01)


def in_turn(source, target):
    step = name + os.path.splitext(target)[1]
    if "prepare" not in os.path.basename(target) or step not in order:
        return replace(source, target)
    (folder / f"{step} asked").touch()
    reached(*(f"{each} asked" for each in order[:2]))
    reached(*(f"{each} done" for each in order[: order.index(step)]))
    replace(source, target)
    (folder / f"{step} done").touch()


os.replace = in_turn
"""


def test_two_processes_that_store_at_once_do_not_swap_their_machine_code(folder, tmp_path):
    """Each has seen that nothing is there; index and code of one go to disk between those of the other."""
    order = ("leg_motion.nbi", "equations.nbi", "equations.nbc", "leg_motion.nbc")
    environment = {"NUMBA_CACHE_DIR": str(folder)}
    names = ("leg_motion", "equations")
    for process in [child(IN_TURN + CHILD, name, str(tmp_path), *order, **environment) for name in names]:
        output(process)
    for signature in (LEG_MOTION, EQUATIONS):
        assert_right(made(signature))
