"""Machine code of functions written by hand: found again, renewed, and not missed where it cannot be kept."""

import errno
import os
import subprocess
import sys

import numba
import pytest
from numba.core.caching import CompileResultCacheImpl

from sixsps import sources
from sixsps.kernels import forward_kinematics as kernels
from sixsps.machine_code import entry, part


@part
def doubled(x):
    return 2 * x


def raised(x):
    return doubled(x) + 1


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder for machine code that has none yet."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "code"))
    return tmp_path / "code"


def made():
    """The function as a new process makes it, and whether that found it on disk."""
    raised.__qualname__ = "raised"
    found = entry("f8(f8)", "arrays.py")(raised)
    assert found(3.0) == 7.0
    return sum(found.stats.cache_hits.values()) == 1


def stored(folder):
    return {path: path.read_bytes() for path in folder.rglob("*.nb*")}


def test_is_found_again(folder):
    assert not made()
    before = stored(folder)
    assert made()
    assert stored(folder) == before


def test_is_renewed_with_the_source_of_its_parts(folder, monkeypatch):
    assert not made()
    monkeypatch.setattr(sources, "digest", lambda *places: "another source, " + " ".join(places))
    assert not made()
    assert made()


@pytest.mark.parametrize("damage", [b"", b"no machine code", None], ids=["empty", "garbage", "half"])
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_broken_files_are_renewed(folder, suffix, damage):
    made()
    for path in folder.rglob(f"*.{suffix}"):
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2] if damage is None else damage)
    made()
    assert made()


def test_place_to_keep_it_is_not_needed(monkeypatch):
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])
    assert not made()


def test_a_full_disk_does_not_stop_the_work(folder, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    assert not made()


CODE = """
import sixsps
from sixsps.kernels import forward_kinematics as kernels
found = sixsps.forward_kinematics(sixsps.Mechanism.load("wu2012"), [0.7] * 6)
assert abs(found.position[2] - 0.678823445521162) < 1e-12
print(*(sum(one.stats.cache_hits.values()) for one in (kernels.track, kernels.same)))
"""


def test_kernels_are_found_in_another_process():
    """In the folder where the tests of this process have them, or leave them now."""
    kernels.track  # noqa: B018
    done = subprocess.run([sys.executable, "-W", "error", "-c", CODE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "1 1\n"
