"""`sixsps check`: what it finds, how it says so, and with which exit status."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from cases import at_rest, random_mechanism, random_motion

import sixsps
from compare.check import check, runs
from compare.check_report import mapping
from compare.check_table import table
from compare.margin_figure import write_figure
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.limits import Limits
from sixsps.margins import LIMITS
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import bundled, quintic

LIMITED = Limits(force=[-200, 200], rate=0.3, base_cone=0.9, platform_cone=1.0, clearance=0.02)


def checked(mechanism, motion, engine="kane"):
    return check(mechanism, motion, engine, lambda *_: None)


def run(*arguments, **options):
    command = [sys.executable, "-m", "compare", "check", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, **options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files of a mechanism with limits and one of geometry alone."""
    path = tmp_path_factory.mktemp("check")
    mechanism = replace(Mechanism.load("wu2012"), limits=LIMITED)
    mechanism.save(path / "limited.yaml")
    bare = Mechanism.geometry(
        "bare", mechanism.base_anchors, mechanism.platform_anchors, [0.45, 0.9], LIMITED
    )
    bare.save(path / "bare.yaml")
    return path


def violations_by_hand(found):
    """The same intervals by one naive loop over the samples of every leg."""
    rows, time = [], found.motion.time
    for key, margin in found.margins.limits.items():
        for column, leg in enumerate(margin.legs):
            open_ = None
            for k in range(len(time)):
                value, limit = margin.values[k, column], margin.limit[column]
                excess = value - limit if margin.is_largest else limit - value
                kind = "none" if np.isnan(value) else ("beyond" if excess > 1e-12 * abs(limit) else "")
                if open_ and open_["kind"] != kind:
                    rows.append(open_)
                    open_ = None
                if kind and open_ is None:
                    open_ = {"kind": kind, "limit": key, "leg": leg, "start": time[k], "samples": 0,
                             "excess": -np.inf, "worst": time[k], "value": None}  # fmt: skip
                if kind:
                    open_["end"] = time[k]
                    open_["samples"] += 1
                if kind == "beyond" and excess > open_["excess"]:
                    open_ |= {"excess": excess, "worst": time[k], "value": value}
            if open_:
                rows.append(open_)
    return rows


@pytest.mark.parametrize("seed", range(4))
def test_intervals_are_those_of_a_naive_loop(seed):
    mechanism, rng = random_mechanism(seed), np.random.default_rng(seed)
    size = mechanism.characteristic_length
    load = 10 * mechanism.platform.mass
    limits = Limits(
        force=np.sort(load * rng.uniform(-2, 2, (6, 2)), axis=1),
        rate=size * rng.uniform(0.2, 2, 6),
        base_cone=rng.uniform(0.1, 0.4, 6),
        platform_cone=rng.uniform(0.1, 0.6, 6),
        clearance=0.3 * size,
    )
    found = checked(replace(mechanism, limits=limits), bundled("sinusoids", mechanism, 157))
    expected = violations_by_hand(found)
    at_samples = [violation for violation in found.violations if violation.samples]
    assert len(at_samples) == len(expected) > 5
    for violation, row in zip(at_samples, expected, strict=True):
        for name in ("limit", "leg", "start", "end", "samples", "worst", "value"):
            assert getattr(violation, name) == row[name], name
    assert not found.passed


def test_runs_are_what_they_are():
    assert runs(np.array([1, 1, 0, 2, 2, 1, 0, 0, 1])) == [(0, 2), (3, 5), (5, 6), (8, 9)]
    assert runs(np.array([0, 0])) == []
    assert runs(np.array([], dtype=np.intp)) == []


def test_forces_of_a_singular_sample_are_a_violation_of_their_own():
    mechanism = replace(Mechanism.load("wu2012"), limits=Limits(force=[-1e9, 1e9]))
    motion = bundled("line", mechanism, 9)
    position = np.array(motion.position)
    position[4] = [0.01, 0.02, 0.0]
    found = checked(mechanism, replace(motion, position=position))
    none = [violation for violation in found.violations if violation.value is None]
    assert {violation.limit for violation in none} == {"min_force", "max_force"}
    assert {(violation.start, violation.end) for violation in none} == {(motion.time[4], motion.time[4])}
    content = mapping(found)
    assert content["singularity"]["singular_samples"] == [
        {"start": motion.time[4], "end": motion.time[4], "samples": 1}
    ]
    assert content["singularity"]["largest_condition"] is None
    assert "SINGULAR at 1 samples, t = 1 to 1 s" in table(found)
    assert json.dumps(content, allow_nan=False)


def test_lengths_beyond_a_limit_between_samples_are_found():
    """Two samples, and a path that leaves the strokes and comes back between them."""
    mechanism = Mechanism.load("wu2012")
    home = home_position(mechanism)
    zero = np.zeros((2, 3))
    motion = Motion(
        time=[0.0, 1.0],
        position=[home, home],
        velocity=[[0, 0, 1.2], [0, 0, -1.2]],
        angular_velocity=zero, acceleration=zero, angular_acceleration=zero,
    )  # fmt: skip
    found = checked(mechanism, motion)
    assert [violation.samples for violation in found.violations] == [0] * 6
    assert {violation.limit for violation in found.violations} == {"max_length"}
    highest = at_rest(home + [0, 0, 0.3])
    expected = inverse_kinematics(mechanism, highest).lengths[0]
    values = np.array([violation.value for violation in found.violations])
    np.testing.assert_allclose(values, expected, rtol=0.02)  # a cubic stands for the hypotenuse
    assert not found.passed
    assert "between samples" in table(found)
    slower = replace(motion, velocity=motion.velocity / 2)
    assert checked(mechanism, slower).passed


def test_crossing_a_singular_pose_fails():
    mechanism = Mechanism.geometry(
        "free", *(getattr(Mechanism.load("wu2012"), f"{part}_anchors") for part in ("base", "platform"))
    )
    home = home_position(Mechanism.load("wu2012"))
    motion = quintic(np.linspace(0, 1, 30), home, home + [0.05, 0, 0.1], [0.2, 0.1, 3.0])
    found = checked(mechanism, motion)
    assert not found.violations
    assert not found.passed
    (crossing,) = mapping(found)["singularity"]["crossings"]
    assert crossing["t"] == pytest.approx(0.51215, abs=1e-4)
    assert motion.time[crossing["after_sample"] - 1] < crossing["t"] < motion.time[crossing["after_sample"]]
    text = table(found)
    assert "SINGULAR POSE CROSSED at t = 0.51215 s" in text
    assert text.endswith("1 singular pose crossed.\n")


def test_the_least_distance_is_that_of_the_worst_sample():
    mechanism = Mechanism.load("tsai2000")
    motion = bundled("sinusoids", mechanism, 60)
    content = mapping(checked(mechanism, motion))["singularity"]
    everywhere = sixsps.singularity_distance(mechanism, motion)
    assert content["least_distance_m"] == pytest.approx(everywhere.distance.min(), rel=1e-6)
    assert content["least_distance_t"] == motion.time[everywhere.distance.argmin()]


def test_anchors_that_are_nearly_an_architecture_singularity_are_told():
    angles = np.radians([3, 47, 125, 166, 244, 289.0])
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    platform = 0.37 * ring
    platform[0, 0] += 2e-4
    mechanism = Mechanism.geometry("ring", ring, platform, [0.5, 1.5])
    text = table(checked(mechanism, bundled("line", mechanism, 9)))
    assert "NEARLY SINGULAR IN EVERY POSE by its anchors" in text


@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_the_same_data_are_the_same_picture(tmp_path, suffix):
    pytest.importorskip("matplotlib")
    mechanism = replace(Mechanism.load("wu2012"), limits=Limits(clearance=0.035, force=[-1e3, 1e3]))
    motion = bundled("line", mechanism, 12)
    position = np.array(motion.position)
    position[5] = [0.01, 0.02, 0.0]
    found = checked(mechanism, replace(motion, position=position))
    paths = [tmp_path / f"{k}.{suffix}" for k in range(2)]
    for path in paths:
        write_figure(found, path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    if suffix == "svg":
        text = paths[0].read_text()
        assert {word for word in ("leg-leg distance", "largest force", "least singular") if word in text} == {
            "leg-leg distance", "largest force", "least singular"
        }  # fmt: skip


class TestText:
    def test_fits_a_terminal_whatever_the_numbers(self):
        for seed in range(3):
            mechanism = random_mechanism(seed)
            limits = Limits(
                force=[-1e-9, 1e-9], rate=1e-30, base_cone=1e-12, platform_cone=0.123456789, clearance=1e20
            )
            motion = random_motion(mechanism, seed, samples=6)
            times = 1.7e9 + 1e-3 * np.array([0.123456, 1, 2.2, 3, 3.7, 5])
            text = table(
                checked(replace(mechanism, name="a" * 200, limits=limits), replace(motion, time=times))
            )
            assert max(map(len, text.splitlines())) <= 80
            assert "and " in text  # more violations than are shown
            assert "+0.003" in text  # times far from zero count from the start

    def test_says_what_was_not_checked_and_why(self, folder):
        done = run(folder / "bare.yaml", "line")
        assert done.returncode == 1
        words = " ".join(done.stdout.split())
        assert "not checked, needs the inertia that this mechanism of geometry alone does not have: " in words
        assert "least force, largest force" in words
        assert "between them leg lengths" in words


class TestCommand:
    def test_lists_violations_and_margins(self, folder):
        done = run(folder / "limited.yaml", "line")
        assert (done.returncode, done.stderr) == (1, "")
        lines = done.stdout.splitlines()
        assert lines[0] == "wu2012 along line: 2001 samples, 0 to 2 s"
        assert max(map(len, lines)) <= 80
        start = lines.index(next(line for line in lines if line.startswith("violated")))
        rows = [line.rsplit(maxsplit=6) for line in lines[start + 1 : start + 8]]
        mechanism = Mechanism.load(str(folder / "limited.yaml"))
        motion = bundled("line", mechanism)
        forces = sixsps.inverse_dynamics(mechanism, motion)
        assert rows[0][0].strip() == "least force"
        assert rows[0][1:] == ["6", "1.879", "2", "2", f"{forces[:, 5].min():.4g}", "-200"]
        beyond = motion.time[forces[:, 5] < -200]
        assert beyond.min() == pytest.approx(1.879)
        assert "forces by kane" in lines
        assert lines[-1] == "7 violations."

    def test_keeps_quiet_where_all_is_well(self):
        done = run("wu2012", "line")
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.endswith("All limits that are given are kept.\n")
        assert "violated" not in done.stdout
        assert "condition number up to 14.277 at t = 2 s, characteristic length 0.1 m" in done.stdout

    def test_json_holds_what_python_gives(self, folder):
        done = run(folder / "limited.yaml", "line", "--samples", "50", "--json", "--engine", "newton-euler")
        assert done.returncode == 1
        content = json.loads(done.stdout)
        assert content["passed"] is False
        assert content["forces_by"] == "newton-euler"
        assert list(content["limits"]) == list(LIMITS)
        mechanism = Mechanism.load(str(folder / "limited.yaml"))
        motion = bundled("line", mechanism, 50)
        margins = sixsps.limit_margins(mechanism, motion)
        for key, entry in content["limits"].items():
            margin = margins.limits[key]
            assert entry["least_margin"] == pytest.approx(margin.margins.min(), rel=1e-9)
            k = int(np.searchsorted(motion.time, entry["t"]))
            column = margin.legs.index(entry["leg"])
            assert margin.values[k, column] == pytest.approx(entry["value"], rel=1e-9)

    @pytest.mark.parametrize("suffix", ["csv", "parquet"])
    def test_violations_go_into_a_table(self, folder, tmp_path, suffix):
        path = tmp_path / f"violations.{suffix}"
        done = run(folder / "limited.yaml", "line", "--samples", "50", "--output", path)
        assert done.returncode == 1
        read = pyarrow.csv.read_csv if suffix == "csv" else pyarrow.parquet.read_table
        rows = read(path).to_pylist()
        found = checked(
            Mechanism.load(str(folder / "limited.yaml")), bundled("line", Mechanism.load("wu2012"), 50)
        )
        assert len(rows) == len(found.violations) == 7
        for row, violation in zip(rows, found.violations, strict=True):
            assert str(row["leg"]) == violation.leg
            for name in ("limit", "start", "end", "samples", "worst", "value", "allowed", "unit"):
                assert row[name] == getattr(violation, name)

    def test_no_violations_make_an_empty_table(self, tmp_path):
        path = tmp_path / "violations.csv"
        assert run("wu2012", "line", "--samples", "20", "--output", path).returncode == 0
        assert path.read_text() == "limit,leg,start,end,samples,worst,value,allowed,unit\n"

    def test_draws_margins(self, folder, tmp_path):
        pytest.importorskip("matplotlib")
        path = tmp_path / "margins.svg"
        done = run(folder / "limited.yaml", "line", "--samples", "20", "--figure", path)
        assert (done.returncode, done.stderr) == (1, "")
        assert "time [s]" in path.read_text()

    @pytest.mark.parametrize(
        ("arguments", "says"),
        [
            (["wu2012", "nowhere"], "nowhere: motion: no such file or bundled name"),
            (["nowhere", "line"], "nowhere: mechanism: no such file or bundled name"),
            (["wu2012", "line", "--engine", "kaen"], "kaen"),
            (
                ["wu2012", "line", "--output", "a.txt"],
                "a.txt: output: .txt; allowed: .csv, .parquet or .json",
            ),
            (["wu2012", "line", "--figure", "a.jpg"], "a.jpg: figure: .jpg; allowed: .svg, .pdf or .png"),
            (["wu2012", "line", "--samples", "1"], "--samples: 1; allowed: 2 to"),
            (["dietmaier1998", "line"], "legs.length_limits: missing"),
            (
                ["wu2012", "line", "--samples", "9", "--output", "no/a.csv"],
                "no/a.csv: output: its folder does not exist",
            ),
        ],
    )
    def test_bad_options_are_refused_in_one_line(self, arguments, says, tmp_path):
        done = run(*arguments, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert len(done.stderr.splitlines()) == 1
        assert says in done.stderr
        assert list(tmp_path.iterdir()) == []

    def test_the_page_on_limits_shows_what_it_prints(self, tmp_path):
        text = (Path(__file__).parents[1] / "docs" / "limits.md").read_text(encoding="utf-8")
        command, shown = re.search(
            r"```console\n\$ (.*?)\n```\n\n```text\n(.*?)```", text, flags=re.DOTALL
        ).groups()
        limits = Limits(force=[-250, 250], rate=0.3, base_cone=0.9, platform_cone=1.0, clearance=0.02)
        replace(Mechanism.load("wu2012"), limits=limits).save(tmp_path / "hexapod.yaml")
        done = run(*command.split()[2:], cwd=tmp_path)
        assert done.returncode == 1
        assert done.stdout == shown
