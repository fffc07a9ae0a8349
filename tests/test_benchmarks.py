"""The benchmarks measure what they say; how fast anything is, no test asks."""

import ast
import copy
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import benchmarks
import sixsps
from benchmarks import batch, latency, machine, rounds, scaling
from benchmarks.__main__ import REPORT, RESULTS, main
from benchmarks.candidates import Candidate, Missing, build, names
from benchmarks.figures import Spread, ratios, row
from benchmarks.forward_kinematics import FOLLOWED, FROM_HOME, MECHANISMS, NEXT, PLAIN
from benchmarks.limits import LIMITS
from benchmarks.naming import (
    DIFFERENCES,
    EXACT,
    EXACT_REUSED,
    FAST,
    FORCES,
    FORCES_REUSED,
    PEAK,
    PINOCCHIO,
    RNEA,
    VECTORISED,
    on_threads,
)
from benchmarks.plan import FULL, QUICK
from benchmarks.report import asked, markdown, short
from benchmarks.rounds import Contestant, interleaved
from benchmarks.states import States, long_motion
from benchmarks.tables import duration, number
from benchmarks.workers import processors, thread_counts
from compare import registry
from sixsps.errors import EngineError
from sixsps.kernels.graph import graph
from sixsps.trajectories import bundled

ROUNDOFF = 2.0**-53
COMMAND = [sys.executable, "-m", "benchmarks"]
SMALL = replace(QUICK, rounds=2, turn=0.0, states=dict.fromkeys(QUICK.states, 8))


def silent(*_words):
    pass


def run(*arguments):
    return subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True)


class TestQuickRun:
    """One run for all that has to hold of its results: it takes half a minute."""

    def test_works_from_end_to_end(self, tmp_path):
        done = run("--quick", "--output", tmp_path / "bench", "--engine", "pinocchio", "--engine", "opensim")
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(f"report: {tmp_path / 'bench' / REPORT}")
        assert "batch: round 3 of 3" in done.stderr  # progress
        assert {path.name for path in (tmp_path / "bench").iterdir()} == {RESULTS, REPORT}
        results = json.loads((tmp_path / "bench" / RESULTS).read_text())
        written = (tmp_path / "bench" / REPORT).read_text()

        self.has_every_row(results)
        self.has_ratios_that_follow_from_the_times(results, written)
        self.has_plausible_facts(results)
        self.knows_what_is_not_met(results)
        self.can_be_reported_again(tmp_path, written)

    @staticmethod
    def has_every_row(results):
        both = {1, processors()}
        fast = {on_threads(FAST, n) for n in both}
        assert {one["name"] for one in results["batch"]["rows"]} == fast | {
            "numpy", "kane", "casadi, mapped", "casadi, one by one", "pinocchio rnea", "pinocchio", "opensim",
        }  # fmt: skip
        assert set(results["batch"]["ns_per_flop"]) == {on_threads(PEAK, n) for n in both}
        of_calls = {FAST, f"{FAST}, new array", "kane", "casadi", PINOCCHIO, RNEA}
        assert {one["name"] for one in results["latency"]["rows"]} == of_calls
        of_slopes = [FORCES, FORCES_REUSED, EXACT, EXACT_REUSED, DIFFERENCES, "casadi"]
        assert [one["name"] for one in results["derivatives"]["rows"]] == of_slopes
        kernels = {(one["kernel"], one["place"], one["threads"]) for one in results["kernels"]["rows"]}
        measured = ("forces", "equations", "leg_motion", "force_derivatives")
        assert kernels == {(k, place, n) for k in measured for place in ("cache", "memory") for n in both}
        part = results["forward_kinematics"]
        assert {one["name"] for one in part["rows"]} == {on_threads(FOLLOWED, n) for n in both}
        assert {one["name"] for one in part["calls"]} == {NEXT, FROM_HOME, PLAIN}
        guesses = ("home", "the pose before", "a warm start")
        tried = {(one["mechanism"], one["guess"]) for one in part["workspaces"]}
        assert tried == {(name, guess) for name in MECHANISMS for guess in guesses}
        for one in part["workspaces"]:
            assert sum(one["status"].values()) == one["poses"] == QUICK.poses
            assert one["others"] == 0
        sizes = {(one["samples"], one["threads"], one["reused"]) for one in results["scaling"]["rows"]}
        assert sizes >= {(size, n, reused) for size in QUICK.sizes for n in both for reused in (True, False)}
        assert {one["name"] for one in results["memory"]["rows"]} == fast | {
            "numpy",
            "kane",
            "casadi, mapped",
        }
        for part in ("batch", "derivatives", "kernels", "scaling"):
            for one in results[part]["rows"]:
                if "reason" in one:
                    continue
                times = one["ns_per_sample"]
                assert len(times) == (2 if part == "scaling" else results["rounds"])
                assert min(times) > 0

    @staticmethod
    def has_ratios_that_follow_from_the_times(results, written):
        fast = row(results, "batch", on_threads(FAST, 1))["ns_per_sample"]
        for one in results["batch"]["rows"]:
            if "reason" in one:
                continue
            times = one["ns_per_sample"]
            ratio = ratios(times, fast)
            assert min(times) / max(fast) <= ratio.low <= ratio.median <= ratio.high <= max(times) / min(fast)
            start = f"| `{one['name']}` | {one['what']} | {one['version']} |"
            (line,) = (line for line in written.splitlines() if line.startswith(start))
            assert f"| {number(ratio.median)} ({number(ratio.low)} to {number(ratio.high)}) |" in line
        for one in results["latency"]["rows"]:
            slow = list(one["ns"].values())
            assert slow == sorted(slow)
            assert slow[0] > 0
        assert all(0 < call["difference"] < 1e-7 for call in [results["derivatives"]])

    @staticmethod
    def has_plausible_facts(results):
        assert results["machine"]["processors"] == processors()
        assert results["disturbance"]["seconds"] > 0
        counts = results["kernels"]["counts"]["forces"]
        assert counts["flops"] == graph("forces").flops
        assert counts["bytes"] == 8 * (25 + 6)
        assert "casadi" not in results["startup"]["loaded"]["import sixsps"]
        assert results["startup"]["cold"][0]["compile"] > min(
            one["compile"] for one in results["startup"]["warm"]
        )
        for one in results["memory"]["rows"]:
            assert one["peak"] >= one["before"] > 0

    @staticmethod
    def knows_what_is_not_met(results):
        slow = copy.deepcopy(results)
        for one in slow["batch"]["rows"]:
            if one["name"].startswith(FAST):
                one["ns_per_sample"] = [1e9 * time for time in one["ns_per_sample"]]
        for one in slow["latency"]["rows"]:
            if one["name"] == FAST:
                one["median_ns"] = one["slow_ns"] = [1e9] * slow["rounds"]
        assert asked(slow).count("**no**") >= 7
        absent = copy.deepcopy(results)
        for one in absent["batch"]["rows"] + absent["latency"]["rows"]:
            if one["name"] in (PINOCCHIO, RNEA):
                one["reason"] = "gone"
        assert asked(absent).count("not measured: gone") == 3
        assert PINOCCHIO not in short(absent)
        assert "not here: gone" in markdown(absent)

    @staticmethod
    def can_be_reported_again(folder, written):
        again = run("--report", folder / "bench" / RESULTS, "--output", folder / "again")
        assert again.returncode == 0, again.stderr
        assert (folder / "again" / REPORT).read_text() == written
        assert not (folder / "again" / RESULTS).exists()


class TestBadInput:
    @pytest.fixture
    def refused(self, tmp_path, capsys):
        def check(*arguments):
            assert main([*map(str, arguments), "--output", str(tmp_path / "bench")]) == 2
            assert not (tmp_path / "bench").exists()
            (line,) = capsys.readouterr().err.splitlines()
            return line

        return check

    def test_unknown_engine(self, refused):
        assert re.match("error: engine: kaen; allowed: kane, ", refused("--engine", "kaen"))

    def test_report_of_no_file(self, refused, tmp_path):
        assert "no such file" in refused("--report", tmp_path / "absent.json")

    @pytest.mark.parametrize("content", ["{", "[]", "3", '{"plan": "full"}', "\xff"])
    def test_report_of_another_file(self, refused, tmp_path, content):
        path = tmp_path / "other.json"
        path.write_bytes(content.encode("latin-1"))
        assert str(path) in refused("--report", path)

    def test_output_that_is_a_file(self, tmp_path, capsys):
        (tmp_path / "bench").write_text("")
        assert main(["--quick", "--output", str(tmp_path / "bench")]) == 2
        assert "a file; allowed: a folder" in capsys.readouterr().err


class TestRounds:
    def test_each_has_its_turn_in_every_round(self):
        seen = []
        runners = [Contestant(name, 1, lambda name=name: seen.append(name)) for name in "ABC"]
        times = interleaved(runners, 4, 0.0, silent)
        warming = 2 * len(runners)
        assert "".join(seen[warming:]) == "ABC" * 4
        assert {name: len(one) for name, one in times.items()} == dict.fromkeys("ABC", 4)

    def test_time_is_per_unit_whatever_the_passes(self, monkeypatch):
        monkeypatch.setattr(rounds, "seconds", lambda _run, passes: 2.0 * passes)
        runners = [Contestant("one", 1, silent), Contestant("many", 1000, silent)]
        assert interleaved(runners, 2, 7.0, silent) == {"one": [2e9] * 2, "many": [2e6] * 2}

    def test_ratios_are_taken_within_a_round(self):
        assert ratios([2.0, 40.0, 6.0], [1.0, 10.0, 1.0]) == Spread(4.0, 2.0, 6.0)


@pytest.fixture(scope="module")
def states():
    return States(64)


class TestCandidates:
    def test_an_engine_that_is_not_installed_is_a_row_with_the_reason(self, states, monkeypatch):
        entry = registry.Entry(
            "compare.engines.absent", "Absent", "no_such_library", "no-such-package", "absent"
        )
        monkeypatch.setitem(registry.ENGINES, "absent", entry)
        found = batch.measure(replace(SMALL, engines=("absent",)), states, silent)
        (absent,) = (one for one in found["rows"] if one["name"] == "absent")
        assert "package no-such-package is not installed" in absent["reason"]
        assert 'pip install "sixsps[absent]"' in absent["reason"]
        assert all(one["ns_per_sample"] for one in found["rows"] if one is not absent)

    def test_an_engine_that_gives_no_forces_is_a_row_with_the_reason(self, states, monkeypatch):
        def refuse(_motion):
            raise EngineError("it will not")

        def built(name, mechanism, motion):
            if name == "kane":
                return Candidate(name, "", "", "engine", lambda motion: lambda: refuse(motion))
            return build(name, mechanism, motion)

        monkeypatch.setattr(batch, "build", built)
        found = batch.measure(SMALL, states, silent)
        (refused,) = (one for one in found["rows"] if one["name"] == "kane")
        assert refused["reason"] == "it will not"
        assert "ns_per_sample" not in refused

    def test_missing_pinocchio_is_told_where_single_calls_are(self, states, monkeypatch):
        entry = replace(registry.ENGINES[PINOCCHIO], library="no_such_library")
        monkeypatch.setitem(registry.ENGINES, PINOCCHIO, entry)
        plan = replace(SMALL, calls=dict.fromkeys(SMALL.calls, 2))
        rows = {one["name"]: one for one in latency.measure(plan, states, silent)["rows"]}
        assert "not installed" in rows[PINOCCHIO]["reason"]
        assert "not installed" in rows[RNEA]["reason"]
        assert rows[FAST]["calls"] == 2
        assert isinstance(build(RNEA, states.mechanism, states.motion), Missing)

    @pytest.mark.parametrize("name", ["fast, 1 thread", VECTORISED, "casadi, mapped", "casadi, one by one"])
    def test_own_ways_give_the_same_forces(self, states, name):
        found = build(name, states.mechanism, states.motion)
        motion = states.spread(20)
        expected = sixsps.inverse_dynamics(states.mechanism, motion)
        given = found.prepare(motion)()
        # cond(J) stays below 20 along the motion; a hundred roundings at the load's size.
        assert np.abs(given - expected).max() <= 100 * 20 * ROUNDOFF * np.abs(expected).max()

    def test_steps_of_pinocchio_are_the_engine_taken_apart(self, states):
        steps = pytest.importorskip("benchmarks.pinocchio_steps")
        motion = states.spread(5)
        apart = steps.PinocchioSteps(states.mechanism, motion)
        engine = registry.load(PINOCCHIO)(states.mechanism)
        forces = engine.inverse_dynamics(motion, silent).forces
        assert np.array_equal([apart.closed_chain(k) for k in (0, 1, 2, 3, 4)], forces)
        # Along another order of calls RNEA still sees each sample's own state and external wrench.
        backwards = [apart.rnea(k).copy() for k in reversed(range(5))]
        assert len({tuple(tau) for tau in backwards}) == 5
        assert np.array_equal(apart.rnea(4), backwards[0])

    def test_names_are_all_different(self):
        every = names(tuple(registry.ENGINES))
        assert len(set(every)) == len(every)
        assert set(thread_counts()) >= {1, processors()}


class TestScaling:
    def test_goes_over_the_same_motion_where_it_is_asked_for_more(self, states):
        plan = replace(SMALL, sizes=(10, 30))
        found = scaling.measure(plan, states, silent, long=True)
        passes = {(one["samples"], one["passes"]) for one in found["rows"]}
        assert passes == {(10, 1), (30, 1), (30 * scaling.PASSES, scaling.PASSES)}
        assert all(len(one["ns_per_sample"]) == 2 for one in found["rows"])

    def test_leaves_out_what_memory_does_not_hold(self, states, monkeypatch):
        monkeypatch.setattr(scaling, "memory_left", lambda: 3 * 32 * 8 * 20)
        found = scaling.measure(replace(SMALL, sizes=(10, 30)), states, silent)
        assert {one["samples"] for one in found["rows"] if "reason" in one} == {30}
        assert all(one["ns_per_sample"] for one in found["rows"] if "reason" not in one)

    @pytest.mark.parametrize("samples", [5, 23])
    def test_a_long_motion_is_the_bundled_one_again_and_again(self, wu2012, monkeypatch, samples):
        monkeypatch.setattr("benchmarks.states._LONGEST", 10)
        motion = long_motion(wu2012, samples)
        assert len(motion) == samples
        expected = bundled("sinusoids", wu2012, min(samples, 10)).position
        assert np.array_equal(motion.position, np.resize(expected, (samples, 3)))


class TestMachine:
    def test_says_so_where_the_system_does_not_tell(self, monkeypatch, tmp_path):
        monkeypatch.setattr(machine, "_PROC", tmp_path)
        monkeypatch.setattr(machine, "_CACHES", tmp_path)
        watch = machine.Watch()
        assert watch.disturbance()["others_share"] is None
        assert machine.memory_left() is None
        assert machine.last_cache() == 32 * 2**20
        assert machine.facts()["processor"]

    def test_others_share_is_one_of_all_processors(self):
        found = machine.Watch().disturbance()
        assert found["others_share"] is None or found["others_share"] >= 0


class TestNumbers:
    def test_have_three_digits_that_count(self):
        for value, text in ((0, "0"), (0.12345, "0.123"), (1.2345, "1.23"), (12.345, "12.3"), (123.45, "123"),
                            (1234.5, "1234"), (-0.5, "-0.500"), (1e-9, "1e-09"), (3e8, "3e+08")):  # fmt: skip
            assert number(value) == text

    def test_durations_have_the_unit_that_suits(self):
        assert [duration(ns) for ns in (0.5, 84, 3500, 2e7, 3e9)] == [
            "0.500 ns", "84.0 ns", "3.50 us", "20.0 ms", "3.00 s",
        ]  # fmt: skip


def test_plans_know_every_pace():
    from benchmarks.candidates import PACES

    for plan in (FULL, QUICK):
        assert set(plan.states) == set(plan.calls) == set(plan.memory) == set(PACES)


def test_what_is_asked_for_has_words_and_bounds():
    assert len({limit.what for limit in LIMITS}) == len(LIMITS) == 15


def test_modules_have_one_job_and_are_no_part_of_the_package():
    folder = Path(benchmarks.__file__).parent
    for path in folder.glob("*.py"):
        assert len(path.read_text().splitlines()) <= 300, path
        assert ast.get_docstring(ast.parse(path.read_text())), path
    for room in ("sixsps", "urdf", "compare"):
        for path in (folder.parent / room).rglob("*.py"):
            assert "import benchmarks" not in path.read_text()
            assert "from benchmarks" not in path.read_text()
