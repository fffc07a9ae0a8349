"""Engines in processes of their own: whatever one does, the others' results stand."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import sixsps
from compare import registry
from compare.runner import probe, run
from sixsps.trajectories import bundled

HERE = Path(__file__).parent


@pytest.fixture
def fake(monkeypatch):
    """Registers a class of fake_engines.py as an engine."""
    monkeypatch.syspath_prepend(HERE)

    def add(attribute, library="numpy"):
        entry = registry.Entry("fake_engines", attribute, library, library)
        monkeypatch.setitem(registry.ENGINES, attribute, entry)
        return attribute

    return add


@pytest.fixture
def job(wu2012):
    motion = bundled("line", wu2012, 10)
    return wu2012, motion, np.ones(10, dtype=bool)


@pytest.mark.parametrize(
    ("attribute", "reason"),
    [
        ("Killed", "killed by SIGSEGV"),
        ("Raises", "ValueError: joint 7 is not there"),
        ("Leaves", "exited with status 3: license expired"),
        ("GivesNan", "leg 3 at t = 0.222222 s is not a number"),
        ("GivesTooFew", r"shape \(9, 6\), not \(10, 6\)"),
        ("GivesComplexNumbers", r"forces as complex128 array of shape \(10, 6\)"),
        ("GivesOneClosure", r"closure_residual as float64 array of shape \(\), not \(10,\)"),
        ("DiesOfARareSignal", r"killed by signal \d+"),
        ("SaysWhatNoFileCanHold", r"half of \\udcff"),
    ],
)
def test_failure_has_its_reason_and_spares_the_others(fake, job, attribute, reason):
    broken, kane = run([fake(attribute), "kane"], *job)
    assert broken.status == "failed"
    assert broken.forces is None
    assert re.search(reason, broken.reason)
    assert kane.status == "ok"
    assert np.array_equal(kane.forces, sixsps.inverse_dynamics(*job[:2]))


@pytest.mark.parametrize(
    ("attribute", "doing"), [("SleepsForEver", "computing"), ("StartsForEver", "starting")]
)
def test_hanging_engine_is_stopped_at_the_time_limit(fake, job, attribute, doing, monkeypatch):
    monkeypatch.setattr("compare.runner.START_LIMIT_S", 2.0)
    hanging, kane = run([fake(attribute), "kane"], *job, time_limit=2.0)
    assert hanging.status == "failed"
    assert hanging.reason == f"time limit: still {doing} after 2 s"
    assert kane.status == "ok"


def test_odd_words_do_no_harm(fake, job):
    (outcome,) = run([fake("OddWords")], *job)
    assert outcome.status == "ok", outcome.reason
    assert outcome.facts["version"] == "4"


def test_garbage_on_standard_output_harms_nobody(fake, job, capfd):
    (outcome,) = run([fake("PrintsGarbage")], *job)
    assert outcome.status == "ok"
    assert np.array_equal(outcome.forces, np.ones((10, 6)))
    assert capfd.readouterr() == ("", "")


def test_missing_library_is_unavailable_and_a_broken_one_has_failed(fake, job, tmp_path, monkeypatch):
    (tmp_path / "half_installed.py").write_text("import no_such_dependency\n")
    monkeypatch.syspath_prepend(tmp_path)
    names = [fake("GivesNan", "no_such_library"), fake("GivesTooFew", "half_installed")]
    missing, broken = run(names, *job)
    assert (missing.status, broken.status) == ("unavailable", "failed")
    assert missing.reason == "package no_such_library is not installed"
    assert "No module named 'no_such_dependency'" in broken.reason


def test_a_child_that_an_engine_started_ends_with_it(fake, job, tmp_path, monkeypatch):
    monkeypatch.setenv("SIXSPS_TEST_PID", str(tmp_path / "pid"))
    (outcome,) = run([fake("LeavesAChild")], *job, time_limit=3.0)
    assert outcome.status == "failed"
    child = int((tmp_path / "pid").read_text())
    for _ in range(100):
        status = Path(f"/proc/{child}/stat")
        if not status.exists() or status.read_text().split()[2] == "Z":
            return
        time.sleep(0.05)
    pytest.fail("the child goes on")


def test_singular_samples_are_not_given_to_engines_and_come_back_as_nan(job):
    mechanism, motion, regular = job
    regular[4] = False
    (outcome,) = run(["pinocchio"], mechanism, motion, regular)
    assert outcome.status == "ok"
    assert np.isnan(outcome.forces[4]).all()
    assert np.isfinite(np.delete(outcome.forces, 4, axis=0)).all()
    assert np.isnan(outcome.closure_residual[4])


def test_no_regular_sample_at_all(job):
    mechanism, motion, regular = job
    for outcome in run(["kane", "casadi", "pinocchio"], mechanism, motion, ~regular):
        assert outcome.status == "ok"
        assert np.isnan(outcome.forces).all()


def test_watcher_sees_states_in_order(job):
    seen = []
    run(["kane"], *job, watch=lambda engine, state, done: seen.append((engine, state)))
    states = list(dict.fromkeys(state for _, state in seen))
    assert states[0] == "starting"
    assert states[-1] == "ok"


def test_probe_tells_versions_without_a_job():
    outcomes = probe(list(registry.ENGINES))
    assert [outcome.engine for outcome in outcomes] == list(registry.ENGINES)
    for outcome in outcomes:
        assert outcome.facts["version"] if outcome.status == "ok" else outcome.reason


def test_files_in_the_current_folder_do_not_shadow_libraries(job, tmp_path, monkeypatch):
    (tmp_path / "numpy.py").write_text("raise RuntimeError('shadowed')\n")
    monkeypatch.chdir(tmp_path)
    (outcome,) = run(["kane"], *job)
    assert outcome.status == "ok"


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="signals of POSIX")
def test_worker_ends_when_the_program_is_killed(tmp_path):
    """A worker that waits for its turn must not compute on when nobody waits for it."""
    script = tmp_path / "job.py"
    script.write_text(
        "import numpy as np\n"
        "from compare.registry import entry\nfrom compare.runner import _Process\n"
        "import pickle, sys, time\nfrom pathlib import Path\n"
        "from sixsps.mechanism import Mechanism\nfrom sixsps.trajectories import bundled\n"
        "m = Mechanism.load('wu2012')\n"
        "folder = Path(sys.argv[1])\n"
        "p = _Process('kane', entry('kane'), folder, pickle.dumps((m, bundled('line', m, 5))))\n"
        "while p.status()['state'] != 'ready': time.sleep(0.05)\n"
        "print(p.process.pid, flush=True)\ntime.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, script, tmp_path], stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    for _ in range(200):
        if not Path(f"/proc/{worker}").exists():
            break
        time.sleep(0.05)
    assert not Path(f"/proc/{worker}").exists()
    assert not (tmp_path / "forces.npz").exists()
