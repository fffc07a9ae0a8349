"""What `sixsps simulate` writes and says."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pyarrow.parquet as pq
import pytest

from compare.simulation.modes import Mode
from compare.simulation.outputs import error_columns, motion_columns, summary, write_simulation
from compare.simulation.simulate import Request, simulate
from sixsps.formulations import inverse_dynamics
from sixsps.home import home_position
from sixsps.motion import Motion
from sixsps.trajectories import bundled, quintic

KEYS = {
    "engine", "mode", "version", "settings", "max_acceleration_error", "max_position_error_m",
    "max_orientation_error_rad", "max_feedback_force_N", "growth_rate_per_s", "horizon_s",
    "max_closure_error_m", "stopped", "mechanism", "motion",
}  # fmt: skip


def command(*arguments):
    line = [sys.executable, "-m", "compare", "simulate", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True)


@pytest.fixture(scope="module")
def followed(wu2012):
    """A tenth of a second of the paper's example under forces and PD."""
    return simulate(wu2012, bundled("sinusoids", wu2012)[:51], Request("pinocchio", Mode.feedforward))


def test_recover_from_the_command_line(wu2012, tmp_path):
    done = command("wu2012", "line", "--samples", 21, "--output", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    shown = [line for line in done.stdout.splitlines() if not line.startswith("written: ")]
    assert max(map(len, shown)) <= 80
    assert "acceleration error" in done.stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "errors.parquet", "simulation.json", "trajectory.parquet",
    }  # fmt: skip
    facts = json.loads((tmp_path / "out" / "simulation.json").read_text())
    assert set(facts) >= KEYS | {"command"}
    assert (facts["engine"], facts["mode"], facts["stopped"]) == ("closed-form", "recover", None)
    assert facts["max_acceleration_error"] <= 1e-9
    assert facts["max_feedback_force_N"] is None
    table = pq.read_table(tmp_path / "out" / "trajectory.parquet").to_pydict()
    motion = bundled("line", wu2012, 21)
    np.testing.assert_array_equal(table["y"], motion.position[:, 1])
    again = Motion.load(tmp_path / "out" / "trajectory.parquet")
    np.testing.assert_array_equal(again.velocity, motion.velocity)
    table = pq.read_table(tmp_path / "out" / "errors.parquet").to_pydict()
    forces = np.transpose([table[f"f{leg}"] for leg in range(1, 7)])
    np.testing.assert_array_equal(forces, inverse_dynamics(wu2012, motion))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--engine", "adams"], "engine: adams; allowed: closed-form"),
        (["--mode", "guess"], "'guess'"),
        (["--mode", "open-loop", "--damping", "5"], "--damping: 5.0; allowed: only with --mode feedforward"),
        (["--stiffness", "-1"], "--stiffness: -1.0"),
        (["--figures", "--mode", "recover"], "--figures: with --mode recover"),
    ],
)
def test_bad_options_exit_with_2_in_one_line(arguments, message, tmp_path):
    done = command("wu2012", "line", "--output", tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_plan_through_a_singularity_exits_with_1_and_keeps_what_it_has(wu2012, tmp_path):
    motion = bundled("line", wu2012, 6)
    position = np.array(motion.position)
    position[3] = [0.01, 0.02, 0.0]
    type(motion)(**{**vars_of(motion), "position": position}).save(tmp_path / "flat.csv")
    done = command("wu2012", tmp_path / "flat.csv", "--output", tmp_path / "out")
    assert done.returncode == 1
    assert "stopped at t = 1.2 s: the planned pose is singular" in done.stderr
    facts = json.loads((tmp_path / "out" / "simulation.json").read_text())
    assert facts["stopped"]["t"] == pytest.approx(1.2)
    assert pq.read_table(tmp_path / "out" / "trajectory.parquet").num_rows == 5


def test_a_driven_run_that_gives_up_exits_with_1_and_keeps_what_it_has(wu2012, tmp_path):
    pytest.importorskip("exudyn")
    home = home_position(wu2012)
    motion = quintic(np.linspace(0, 0.1, 101), home, home, [0, 0, 2.0])
    motion.save(tmp_path / "turn.csv")
    done = command("wu2012", tmp_path / "turn.csv", "--engine", "exudyn", "--output", tmp_path / "out")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    facts = json.loads((tmp_path / "out" / "simulation.json").read_text())
    stop = facts["stopped"]
    assert f"sixsps: stopped at t = {stop['t']:g} s: {stop['reason']}" in done.stderr.splitlines()
    assert f"stopped at t = {stop['t']:g} s, {facts['samples']} samples kept" in done.stdout.splitlines()
    for name in ("trajectory", "errors"):
        table = pq.read_table(tmp_path / "out" / f"{name}.parquet").to_pydict()
        np.testing.assert_allclose(table["t"], motion.time[: facts["samples"]])
        assert table["t"][-1] <= stop["t"] < 0.1


def test_a_driven_run_that_is_inaccurate_exits_with_1(wu2012, tmp_path):
    pytest.importorskip("exudyn")
    noise = np.random.default_rng(1).normal(scale=1e-4, size=(21, 3))
    Motion.from_poses(np.linspace(0, 0.1, 21), home_position(wu2012) + noise).save(tmp_path / "rough.csv")
    done = command("wu2012", tmp_path / "rough.csv", "--engine", "exudyn", "--output", tmp_path / "out")
    assert done.returncode == 1
    assert "sixsps: multipliers differ by" in done.stderr
    assert "integrator's estimate" in done.stdout


def test_open_loop_between_two_samples(tmp_path):
    given = ("wu2012", "line", "--samples", 2, "--mode", "open-loop", "--output", tmp_path / "out")
    done = command(*given)
    assert done.returncode == 0
    assert "samples were put between" in done.stderr
    facts = json.loads((tmp_path / "out" / "simulation.json").read_text())
    assert facts["samples"] > 2
    assert max(map(len, done.stdout.splitlines()[:-1])) <= 80


def vars_of(motion):
    return {name: getattr(motion, name) for name in motion.__dataclass_fields__}


def test_trajectory_has_the_columns_of_a_motion_and_of_the_errors(followed):
    table = motion_columns(followed.outcome.trajectory) | error_columns(
        followed.outcome.trajectory, simulated=True
    )
    motion = ["t", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz"]
    motion += ["ax", "ay", "az", "ex", "ey", "ez", "fx", "fy", "fz", "mx", "my", "mz"]
    assert list(table)[: len(motion)] == motion
    rest = {"f1", "f6", "feedback1", "feedback6", "position_error", "orientation_error", "closure_error"}
    assert rest <= set(table)
    assert {len(values) for values in table.values()} == {51}
    assert table["position_error"].max() == followed.facts["max_position_error_m"]
    np.testing.assert_allclose(np.linalg.norm([table[q] for q in motion[4:8]], axis=0), 1, rtol=1e-14)


def test_summary_fits_a_terminal(followed):
    lines = list(summary(followed.facts))
    assert any("PD force needed" in line for line in lines)
    assert max(map(len, lines)) <= 80


def test_written_json_has_no_infinity(followed, tmp_path):
    write_simulation(followed, "sixsps simulate", tmp_path)
    facts = json.loads((tmp_path / "simulation.json").read_text(), parse_constant=pytest.fail)
    assert facts["command"] == "sixsps simulate"
    assert facts["settings"]["force_step_s"] == pytest.approx(0.005)


class TestFigures:
    def test_all_five_with_units_and_the_same_bytes_again(self, followed, wu2012, tmp_path):
        pytest.importorskip("matplotlib")
        from compare.simulation.figures import write_figures

        written = write_figures(followed.outcome.trajectory, wu2012, tmp_path)
        assert [path.name for path in written if path.suffix == ".svg"] == [
            "figure3_driving_forces.svg", "figure4_trajectory.svg", "figure5_velocity.svg",
            "figure6_acceleration.svg", "figure7_displacement.svg",
        ]  # fmt: skip
        assert sum(path.suffix == ".png" for path in written) == 5
        before = [path.read_bytes() for path in written]
        assert [
            path.read_bytes() for path in write_figures(followed.outcome.trajectory, wu2012, tmp_path)
        ] == before
        words = {
            element.text
            for path in written
            if path.suffix == ".svg"
            for element in ET.parse(path).iter()
            if element.tag.endswith("text")
        }
        assert {
            "time [s]",
            "driving force [N]",
            "x [m]",
            "z [m]",
            "velocity of O1 [m/s]",
            "rotation vector [rad]",
        } <= words
        assert {"planned", "simulated", "angular acceleration [rad/s²]", "difference [m/s²]"} <= words

    def test_a_difference_that_is_nowhere_has_an_axis_too(self, wu2012):
        figure = pytest.importorskip("matplotlib.figure").Figure()
        from compare.simulation.figures import _draw_difference

        axes = figure.subplots()
        _draw_difference(axes, np.arange(3.0), np.zeros(3), np.arange(3))
        assert axes.get_ylim() == pytest.approx((1e-18, 1e-17))
