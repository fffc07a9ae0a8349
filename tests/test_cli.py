"""The command as a user runs it."""

import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from cases import RECORDED
from terminals import on_terminal

import sixsps
from compare.registry import ENGINES, TRAPS
from sixsps.trajectories import bundled

COMMAND = [sys.executable, "-m", "compare"]


def sixsps_command(*arguments, **options):
    return subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True, **options)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The main job on the paper's example: the folder it ran in, and how it ended."""
    folder = tmp_path_factory.mktemp("compare")
    return folder, sixsps_command("compare", "--samples", 200, cwd=folder)


class TestCompare:
    def test_paper_example_without_arguments(self, done):
        folder, result = done
        assert result.returncode == 0, result.stdout + result.stderr
        assert result.stderr == ""
        assert re.search(r"\d+ engines agree with the certified forces to \d\.\de-1[45]", result.stdout)
        assert "report: report/report.md" in result.stdout
        names = {path.name for path in (folder / "report").iterdir()} - {"report.svg"}  # with matplotlib
        assert names == {"forces.parquet", "report.md", "results.json"}

    def test_piped_output_has_no_colours_and_fits_80_columns(self, done):
        _, result = done
        assert "\x1b" not in result.stdout
        assert max(len(line) for line in result.stdout.splitlines()) <= 80

    def test_results_have_the_agreed_keys(self, done):
        folder, _ = done
        results = json.loads((folder / "report" / "results.json").read_text())
        assert {"versions", "machine", "mechanism", "motion", "reference", "engines"} <= set(results)
        assert set(results["mechanism"]) >= {"name", "sha256"}
        assert set(results["motion"]) >= {"name", "sha256"}
        assert set(results["reference"]) >= {"engine", "bound"}
        assert list(results["engines"]) == list(ENGINES)
        for name, entry in results["engines"].items():
            assert set(entry) >= {
                "status",
                "reason",
                "version",
                "formulation",
                "max_abs_error_N",
                "max_rel_error",
                "worst",
                "digits",
                "closure_residual",
                "microseconds_per_sample",
                "tolerance_rel",
                "within_tolerance",
            }
            if entry["status"] == "ok":
                assert set(entry["worst"]) == {"t", "leg"}
            else:
                assert ENGINES[name].extra
                assert (entry["status"], entry["worst"]) == ("unavailable", None)
        assert results["command"] == "sixsps compare --samples 200"

    def test_traps_stand_apart_and_change_no_exit_status(self, tmp_path):
        result = sixsps_command(
            "compare", "wu2012", "sinusoids", "--samples", 20, "--engine", "kane", "--traps",
            "--output", tmp_path / "out",
        )  # fmt: skip
        assert result.returncode == 0, result.stdout + result.stderr
        results = json.loads((tmp_path / "out" / "results.json").read_text())
        assert list(results["traps"]) == list(TRAPS)
        wrong = [entry for entry in results["traps"].values() if entry["status"] == "ok"]
        assert len(wrong) >= 5
        assert all(entry["within_tolerance"] is False for entry in wrong)
        shown = [line for line in result.stdout.splitlines() if not line.startswith("report: ")]
        assert max(map(len, shown)) <= 80

    def test_a_trap_asked_for_by_name_is_judged_like_any_engine(self, tmp_path):
        result = sixsps_command(
            "compare", "wu2012", "sinusoids", "--samples", 20, "--engine", "wu2012-printed",
            "--output", tmp_path / "out",
        )  # fmt: skip
        assert result.returncode == 1
        assert "wu2012-printed disagrees with the certified forces" in result.stdout

    def test_universal_joints_are_judged_at_their_own_tolerance(self, tmp_path):
        result = sixsps_command(
            "compare", "wu2012", "sinusoids", "--samples", 20, "--legs", "ups", "--output", tmp_path / "out"
        )
        assert result.returncode == 0, result.stdout + result.stderr
        results = json.loads((tmp_path / "out" / "results.json").read_text())
        assert results["leg_type"] == "ups"
        assert all(ENGINES[name].ups for name in results["engines"])
        pinocchio = results["engines"]["pinocchio"]
        assert pinocchio["tolerance_rel"] == 1e-6
        assert 1e-9 < pinocchio["max_rel_error"] < 1e-6
        assert results["universal_joints"]["unexplained_rel"] < 1e-13
        assert "errors are against legs that do not spin" in " ".join(result.stdout.split())
        assert "## Universal joints" in (tmp_path / "out" / "report.md").read_text()

    def test_traps_and_universal_joints_do_not_go_together(self, tmp_path):
        result = sixsps_command("compare", "--legs", "ups", "--traps", "--output", tmp_path / "out")
        assert result.returncode == 2
        assert result.stderr == "sixsps: --traps: with --legs ups; allowed: with --legs sps\n"

    def test_an_engine_without_universal_joints_says_so(self, tmp_path):
        result = sixsps_command(
            "compare", "--samples", 5, "--legs", "ups", "--engine", "kane", "--output", tmp_path / "out"
        )
        assert result.returncode == 1
        assert "its legs stand on ball joints only" in " ".join(result.stdout.split())

    def test_impossible_tolerance_exits_with_1(self, tmp_path):
        result = sixsps_command(
            "compare", "wu2012", "line", "--samples", 5, "--engine", "casadi",
            "--tolerance", "1e-30", "--output", tmp_path / "out",
        )  # fmt: skip
        assert result.returncode == 1
        assert "casadi disagrees with the certified forces" in result.stdout

    def test_singular_pose_exits_with_1_and_names_the_sample(self, tmp_path):
        motion = bundled("line", sixsps.Mechanism.load("wu2012"), 4)
        position = np.array(motion.position)
        position[2] = [0.01, 0.02, 0.0]
        dataclasses.replace(motion, position=position).save(tmp_path / "flat.csv")
        result = sixsps_command(
            "compare", "wu2012", tmp_path / "flat.csv", "--engine", "kane", "--output", tmp_path / "out"
        )
        assert result.returncode == 1
        assert "sample 3 at t = 1.333333333 s is singular" in result.stdout
        table = pq.read_table(tmp_path / "out" / "forces.parquet").to_pydict()
        assert np.isnan([table[f"f{leg}"][2] for leg in range(1, 7)]).all()
        assert np.isfinite([table[f"f{leg}"][1] for leg in range(1, 7)]).all()

    @pytest.mark.skipif(not RECORDED.exists(), reason="the recorded motion is not here")
    @pytest.mark.parametrize("name", ["wu2012", "tsai2000", "taghirad2013"])
    def test_recorded_motion_fitted_to_a_mechanism(self, name, tmp_path):
        result = sixsps_command("compare", name, RECORDED, "--fit", "--output", tmp_path / "out")
        assert result.returncode == 0, result.stdout + result.stderr
        results = json.loads((tmp_path / "out" / "results.json").read_text())
        compared = [entry for entry in results["engines"].values() if entry["status"] != "unavailable"]
        assert len(compared) >= 7
        assert all(entry["max_rel_error"] < 1e-13 for entry in compared)
        assert results["limit_violations"] == []

    def test_terminal_shows_progress_on_standard_error_only(self, tmp_path):
        command = [*COMMAND, "compare", "--samples", "50", "--engine", "kane"]
        out, shown = on_terminal(command, cwd=tmp_path)
        assert b"kane" in shown
        assert b"\x1b" not in out


def test_a_half_installed_engine_has_failed_and_says_why(tmp_path):
    (tmp_path / "mujoco.py").write_text("raise OSError('libmujoco.so.4: cannot open shared object file')\n")
    result = sixsps_command(
        "compare", "--samples", 5, "--engine", "kane", "--engine", "mujoco", "--output", tmp_path / "out",
        env=os.environ | {"PYTHONPATH": str(tmp_path)}, cwd=Path(__file__).parents[1],
    )  # fmt: skip
    assert result.returncode == 1
    assert "libmujoco.so.4: cannot open" in " ".join(result.stdout.split())
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["engines"]["kane"]["within_tolerance"] is True
    assert results["engines"]["mujoco"]["status"] == "failed"


def test_forces_read_back_exactly(tmp_path):
    mechanism = sixsps.Mechanism.load("tsai2000")
    motion = bundled("sinusoids", mechanism, 40)
    expected = sixsps.inverse_dynamics(mechanism, motion)
    for suffix in ("csv", "parquet"):
        path = tmp_path / f"forces.{suffix}"
        result = sixsps_command("forces", "tsai2000", "sinusoids", "--samples", 40, "--output", path)
        assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
        if suffix == "csv":
            assert path.read_text().splitlines()[0] == "t,f1,f2,f3,f4,f5,f6"
            table = np.genfromtxt(path, delimiter=",", skip_header=1)
        else:
            columns = pq.read_table(path).to_pydict()
            table = np.column_stack(list(columns.values()))
        assert np.array_equal(table[:, 0], motion.time)
        assert np.array_equal(table[:, 1:], expected)


def test_forces_of_another_engine(tmp_path):
    path = tmp_path / "forces.csv"
    done = sixsps_command("forces", "wu2012", "line", "--samples", 5, "--engine", "casadi", "--output", path)
    assert done.returncode == 0
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    wu2012 = sixsps.Mechanism.load("wu2012")
    expected = sixsps.inverse_dynamics(wu2012, bundled("line", wu2012, 5))
    np.testing.assert_allclose(table[:, 1:], expected, rtol=1e-12)


def test_forces_at_a_singular_pose_are_nan_with_status_1(tmp_path):
    motion = bundled("line", sixsps.Mechanism.load("wu2012"), 2)
    position = [[0.01, 0.02, 0.0], motion.position[1]]
    dataclasses.replace(motion, position=position).save(tmp_path / "flat.parquet")
    path = tmp_path / "forces.csv"
    result = sixsps_command("forces", "wu2012", tmp_path / "flat.parquet", "--output", path)
    assert result.returncode == 1
    assert "sample 1 at t = 0 s is singular: cond(J) is" in result.stderr
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert np.isnan(table[0, 1:]).all()
    assert np.isfinite(table[1]).all()


def test_ik_with_and_without_rates(tmp_path):
    mechanism = sixsps.Mechanism.load("wu2012")
    legs = sixsps.inverse_kinematics(mechanism, bundled("line", mechanism, 7))
    for option, columns in ((None, 7), ("--rates", 13)):
        path = tmp_path / "lengths.csv"
        arguments = ["ik", "wu2012", "line", "--samples", 7, "--output", path]
        assert sixsps_command(*arguments, *([option] if option else [])).returncode == 0
        table = np.genfromtxt(path, delimiter=",", skip_header=1)
        assert table.shape == (7, columns)
        assert np.array_equal(table[:, 1:7], legs.lengths)
    assert np.array_equal(table[:, 7:], legs.length_rates)
    assert path.read_text().startswith("t,l1,l2,l3,l4,l5,l6,dl1,dl2,dl3,dl4,dl5,dl6\n")


@pytest.mark.parametrize(("format", "names"), [("urdf", {"urdf", "yaml", "xml"}), ("mjcf", {"xml"})])
def test_export(format, names, tmp_path):
    result = sixsps_command("export", format, "wu2012", "--output", tmp_path / "out")
    assert result.returncode == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {f"wu2012.{name}" for name in names}
    assert len(result.stdout.splitlines()) == len(names)


def test_engines_lists_each_with_its_version():
    result = sixsps_command("engines")
    assert result.returncode == 0
    lines = dict(line.split(maxsplit=1) for line in result.stdout.splitlines())
    assert list(lines) == list(ENGINES)
    assert lines["casadi"].startswith("casadi 3.")


@pytest.mark.parametrize("arguments", [[], ["--help"], ["compare", "--help"]])
def test_help_goes_to_standard_output(arguments):
    result = sixsps_command(*arguments)
    assert (result.returncode, result.stderr) == (0, "")
    assert "Usage:" in result.stdout


def test_shell_completion_offers_names():
    def complete(line, count):
        environment = os.environ | {
            "_SIXSPS_COMPLETE": "complete_bash",
            "COMP_WORDS": line,
            "COMP_CWORD": str(count),
        }
        program = os.path.join(os.path.dirname(sys.executable), "sixsps")  # noqa: PTH118, PTH120
        return subprocess.run([program], capture_output=True, text=True, env=environment).stdout.split()

    assert complete("sixsps compare ts", 2) == ["tsai2000"]
    assert complete("sixsps compare wu2012 si", 3) == ["sinusoids"]
    assert complete("sixsps compare --engine pin", 3) == ["pinocchio", "pinocchio-ball"]


def test_interrupt_leaves_no_half_written_file(tmp_path):
    output = tmp_path / "forces.csv"
    output.write_text("precious\n")
    process = subprocess.Popen(
        [*COMMAND, "forces", "wu2012", "line", "--samples", "50000", "--engine", "pinocchio"]
        + ["--output", str(output)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(3)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=20)
    assert process.returncode == 130
    assert error == "sixsps: interrupted; nothing was left half-written\n"
    assert output.read_text() == "precious\n"
    assert [path.name for path in tmp_path.iterdir()] == ["forces.csv"]


class TestErrata:
    def test_the_print_fails_by_the_newtons_of_its_row(self, tmp_path):
        written = sixsps_command("errata", "--output", tmp_path / "errata")
        assert written.returncode == 0
        table, hexapod, motion = written.stdout.split()
        last = [line for line in Path(table).read_text().splitlines() if line.startswith("| all ")]
        result = sixsps_command(
            "compare", hexapod, motion, "--engine", "wu2012-printed", "--output", tmp_path / "out"
        )
        assert result.returncode == 1
        results = json.loads((tmp_path / "out" / "results.json").read_text())
        entry = results["engines"]["wu2012-printed"]
        assert entry["within_tolerance"] is False
        newtons = f"{entry['max_abs_error_N']:.3g}"
        assert last == [f"| all | formulation `wu2012-printed` | formulation `kane` | {newtons} |"]

    def test_without_a_folder_the_table_is_printed(self):
        result = sixsps_command("errata")
        assert result.returncode == 0
        assert "| 15 | (s·c) E + c sᵀ | (s·c) E − c sᵀ |" in result.stdout


class TestDigits:
    def test_table_has_a_row_an_engine_and_a_column_a_case(self, tmp_path):
        names = ("--engine", "kane", "--engine", "virtual-work")
        path = tmp_path / "digits.md"
        result = sixsps_command("digits", "line", "--samples", 10, *names, "--output", path)
        assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
        lines = [line.strip("| \n").split(" | ") for line in path.read_text().splitlines()]
        assert lines[0] == ["engine", "version", "taghirad2013 line", "tsai2000 line", "wu2012 line"]
        assert [line[0] for line in lines[2:]] == ["`kane`", "`virtual-work`"]
        assert all(14 < float(cell) < 16 for line in lines[2:] for cell in line[2:])

    def test_unknown_motion_exits_with_2_before_anything_is_computed(self):
        result = sixsps_command("digits", "line", "no-such.csv")
        assert result.returncode == 2
        assert len(result.stderr.splitlines()) == 1
