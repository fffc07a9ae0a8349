"""Driving functions, read back by a parser of every format as the other program would read them."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cases import still, times

import sixsps.driving_functions
from compare.driving_functions import check_output, interpolation, summary, write
from sixsps.driving_functions import Interpolation, driving_functions
from sixsps.errors import InputError, MotionError, OutputError
from sixsps.formulations import inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import bundled, fitted, sinusoids

SUFFIXES = {"adams": "adm", "matlab": "m", "csv": "csv", "json": "json"}
CASES = [
    ("wu2012", "line", 1e-6),
    ("wu2012", "spiral", 1e-4),
    ("tsai2000", "sinusoids", 1e-5),
    ("taghirad2013", "quintic", 1e-3),
]


def akima(x, y, at):
    """Akima (1970), from his paper: the slope at a knot from the four chords around it."""
    m = np.diff(y) / np.diff(x)
    before = [3 * m[0] - 2 * m[1], 2 * m[0] - m[1]]
    m = np.concatenate([before, m, [2 * m[-1] - m[-2], 3 * m[-1] - 2 * m[-2]]])
    right, left = np.abs(m[3:] - m[2:-1]), np.abs(m[1:-2] - m[:-3])
    flat = right + left == 0
    weight = np.where(flat, 0.5, right / np.where(flat, 1, right + left))
    slope = weight * m[1:-2] + (1 - weight) * m[2:-1]
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    h, u, chord = np.diff(x)[i], at - x[i], m[2:-2][i]
    second = (3 * chord - 2 * slope[i] - slope[i + 1]) / h
    third = (slope[i] + slope[i + 1] - 2 * chord) / h**2
    return y[i] + u * (slope[i] + u * (second + u * third))


def piecewise(breaks, rows, at):
    """Horner's rule on pieces whose powers are of the time since the break before."""
    i = np.clip(np.searchsorted(breaks, at, side="right") - 1, 0, len(breaks) - 2)
    value = np.zeros_like(at)
    for column in np.asarray(rows).T:
        value = value * (at - breaks[i]) + column[i]
    return value


def read_adams(path, at):
    text = "\n".join(line for line in path.read_text().splitlines() if not line.startswith("!"))
    statements = re.sub(r"\n\s*,", ",", text).splitlines()
    splines, forces = {}, {}
    for statement in statements:
        name, number, rest = re.fullmatch(r"(SPLINE|SFORCE)/(\d+),(.*)", statement).groups()
        if name == "SPLINE":
            x, y = re.fullmatch(r" X=(.*), Y=(.*)", rest).groups()
            splines[number] = [np.array(values.split(","), dtype=float) for values in (x, y)]
        else:
            pattern = r" I=(\d+), J=(\d+), TRANSLATION, FUNCTION=AKISPL\(TIME, 0, (\d+), 0\)"
            forces[int(number)] = re.fullmatch(pattern, rest).group(3)
    return np.column_stack([akima(*splines[forces[leg]], at) for leg in range(1, 7)])


def read_matlab(path, at):
    text = path.read_text()
    assert re.match(rf"function f = {path.stem}\(t\)\n%", text)
    (breaks,) = re.findall(r"breaks = \[([^]]*)\];", text)
    breaks = np.array(breaks.split(), dtype=float)
    curves = re.findall(r"curves\{(\d)\} = mkpp\(breaks, \[([^]]*)\]\);", text)
    assert [leg for leg, _ in curves] == list("123456")
    rows = ([row.split() for row in body.strip().splitlines()] for _, body in curves)
    return np.column_stack([piecewise(breaks, np.array(table, dtype=float), at) for table in rows])


def read_csv(path, at):
    header, *rows = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert header == "t,f1,f2,f3,f4,f5,f6"
    t, *forces = np.array([row.split(",") for row in rows], dtype=float).T
    return np.column_stack([np.interp(at, t, force) for force in forces])


def read_json(path, at):
    content = json.loads(path.read_text())
    assert content["units"] == {"time": "s", "force": "N"}
    assert np.shape(content["coefficients"]) == (6, len(content["breaks"]) - 1, content["order"])
    breaks = np.array(content["breaks"])
    return np.column_stack([piecewise(breaks, rows, at) for rows in content["coefficients"]])


READERS = {"adams": read_adams, "matlab": read_matlab, "csv": read_csv, "json": read_json}


def stated_bound(path):
    words = " ".join(path.read_text().replace("\n!", "").replace("\n%", "").replace("\n#", "").split())
    return float(re.search(r"Interpolation error: bound (\S+) N", words).group(1))


def written(folder, format, mechanism, motion, tolerance):
    path = folder / f"forces.{SUFFIXES[format]}"
    method = interpolation(format, not isinstance(motion, Motion))
    write(driving_functions(mechanism, motion, method, tolerance), format, path)
    return path


@pytest.mark.parametrize("format", SUFFIXES)
@pytest.mark.parametrize(("name", "motion", "tolerance"), CASES)
def test_a_reader_of_the_format_finds_the_forces_within_the_bound(format, name, motion, tolerance, tmp_path):
    mechanism = Mechanism.load(name)
    path = written(tmp_path, format, mechanism, partial(bundled, motion, mechanism), tolerance)
    # A prime number of steps: hardly any of these times was looked at when the knots were chosen.
    between = bundled(motion, mechanism, 3002)
    expected = inverse_dynamics(mechanism, between)
    error = np.abs(READERS[format](path, between.time) - expected).max()
    assert stated_bound(path) == pytest.approx(tolerance * np.abs(expected).max(), rel=1e-4)
    assert 0.01 * stated_bound(path) < error <= stated_bound(path)


@pytest.mark.parametrize("format", SUFFIXES)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-9])
def test_a_motion_given_by_samples_is_bounded_at_its_samples(format, tolerance, tmp_path):
    mechanism = Mechanism.load("wu2012")
    amplitude, frequency = [0.03] * 3 + [0.1] * 3, [0.3, 0.5, 0.7, 0.4, 0.6, 0.2]
    uneven = sinusoids(times(400), [0, 0, 0.65, 0, 0, 0], amplitude, frequency)
    path = written(tmp_path, format, mechanism, uneven, tolerance)
    expected = inverse_dynamics(mechanism, uneven)
    error = np.abs(READERS[format](path, uneven.time) - expected).max()
    assert error <= stated_bound(path) == tolerance * np.abs(expected).max()
    assert "bound holds at the 400 samples" in " ".join(re.sub("[!%#]", "", path.read_text()).split())


@pytest.mark.parametrize(("method", "order"), [("linear", 2), ("akima", 3), ("quintic", 6)])
def test_knots_grow_with_the_order_of_the_interpolation(method, order):
    mechanism = Mechanism.load("wu2012")
    motion = partial(bundled, "sinusoids", mechanism)
    coarse, fine = (
        driving_functions(mechanism, motion, Interpolation(method), tolerance) for tolerance in (1e-3, 1e-5)
    )
    growth = len(fine.time) / len(coarse.time)
    assert growth == pytest.approx(100 ** (1 / order), rel=0.35)
    assert fine.error <= fine.bound < coarse.bound


def test_knots_gather_where_the_force_changes():
    mechanism = Mechanism.load("wu2012")
    time = np.linspace(0, 10, 2001)
    burst = np.exp(-(((time - 5) / 0.1) ** 2))[:, None] * [100.0, 0, 0]
    pushed = still(2001, time=time, position=np.tile([0, 0, 0.65], (2001, 1)), force=burst)
    found = driving_functions(mechanism, pushed, Interpolation.linear, 1e-3)
    assert found.error <= found.bound
    assert len(found.time) < 250
    assert np.median(np.abs(found.time - 5)) < 0.3


def test_forces_beyond_the_ends_are_nan():
    mechanism = Mechanism.load("wu2012")
    found = driving_functions(mechanism, partial(bundled, "line", mechanism), Interpolation.quintic, 1e-3)
    inside = found(np.array([-0.01, 0.0, 1.0, 2.0, 2.01]))
    assert np.isnan(inside[[0, -1]]).all()
    assert np.isfinite(inside[1:-1]).all()


def test_a_platform_without_forces_has_functions_without_error():
    mechanism = replace(Mechanism.load("wu2012"), gravity=np.zeros(3))
    floating = still(50, position=np.tile([0, 0, 0.65], (50, 1)))
    for method in (Interpolation.linear, Interpolation.akima):
        found = driving_functions(mechanism, floating, method)
        assert found.error == found.bound == 0
        assert np.array_equal(found(floating.time), np.zeros((50, 6)))


class TestRefusals:
    mechanism = Mechanism.load("wu2012")

    @pytest.mark.parametrize("tolerance", [0.0, -1e-6, 1e-13, 0.2, np.nan, np.inf])
    def test_tolerance_out_of_range(self, tolerance):
        with pytest.raises(InputError, match=r"tolerance: .*; allowed: 1e-12 to 0\.1"):
            driving_functions(self.mechanism, still(), Interpolation.linear, tolerance)

    def test_tolerance_that_would_take_too_many_knots(self, monkeypatch):
        monkeypatch.setattr(sixsps.driving_functions, "_STEPS", (840,))
        motion = partial(bundled, "sinusoids", self.mechanism)
        with pytest.raises(InputError, match=r"1e-09; allowed: at least .* with linear") as refusal:
            driving_functions(self.mechanism, motion, Interpolation.linear, 1e-9)
        least = float(re.search(r"at least (\S+)", str(refusal.value)).group(1))
        found = driving_functions(self.mechanism, motion, Interpolation.linear, least)
        assert found.error <= found.bound

    def test_singular_pose(self):
        motion = bundled("line", self.mechanism, 40)
        position = np.array(motion.position)
        position[2] = [0.01, 0.02, 0.0]
        with pytest.raises(MotionError, match=r"sample 3 at t = 0\.10\d+ s: cond\(J\) = .*not singular"):
            driving_functions(self.mechanism, replace(motion, position=position), Interpolation.akima)

    def test_too_few_samples(self):
        motion = bundled("line", self.mechanism, 3)
        with pytest.raises(MotionError, match="samples: 3; allowed: at least 4 samples for akima"):
            driving_functions(self.mechanism, motion, Interpolation.akima)
        assert driving_functions(self.mechanism, motion, Interpolation.linear).error < 1e-12

    def test_quintic_through_recorded_samples(self):
        with pytest.raises(InputError, match="quintic; allowed: linear or akima"):
            driving_functions(self.mechanism, still(), Interpolation.quintic)

    @pytest.mark.parametrize("name", ["forces.mat", "2forces.m", "my-forces.m", "end.m", "ppval.m", "m"])
    def test_names_that_matlab_cannot_call(self, name, tmp_path):
        with pytest.raises(OutputError, match="allowed: "):
            check_output("matlab", tmp_path / name)
        check_output("matlab", tmp_path / "endForces_2.m")


def test_names_in_the_header_stay_in_the_comments(tmp_path):
    name = "Plattform größer ! % # " + "]" * 150
    mechanism = replace(Mechanism.load("wu2012"), name=name)
    motion = partial(bundled, "line", mechanism)
    at = np.linspace(0, 2, 9)
    for kind, reader in READERS.items():
        path = written(tmp_path, kind, mechanism, motion, 1e-3)
        assert path.read_bytes().isascii()
        assert np.isfinite(reader(path, at)).all()
        if kind == "adams":
            assert max(map(len, path.read_text().splitlines())) <= 80


def test_samples_of_a_file_are_fitted_and_counted():
    mechanism = Mechanism.load("tsai2000")
    motion = fitted(bundled("sinusoids", Mechanism.load("wu2012"), 200), mechanism)
    found = driving_functions(mechanism, motion, Interpolation.akima, 1e-2)
    assert (found.checked, found.everywhere) == (200, False)
    assert summary(found).startswith(f"{len(found.time)} knots, error ")
    assert summary(found).endswith("at the motion's samples")


class TestCommand:
    def run(self, folder, *arguments):
        command = [sys.executable, "-m", "compare", "export", "driving-functions", *map(str, arguments)]
        return subprocess.run(command, cwd=folder, capture_output=True, text=True)

    def test_bundled_motion_and_default_bound(self, tmp_path):
        done = self.run(tmp_path, "wu2012", "line", "--format", "adams", "--output", "forces.adm")
        assert (done.returncode, done.stderr) == (0, "")
        assert re.fullmatch(
            r"forces\.adm: \d+ knots, error \S+ N within 0\.00033 N everywhere\n", done.stdout
        )
        assert [path.name for path in tmp_path.iterdir()] == ["forces.adm"]
        mechanism = Mechanism.load("wu2012")
        motion = bundled("line", mechanism, 500)
        error = np.abs(read_adams(tmp_path / "forces.adm", motion.time) - inverse_dynamics(mechanism, motion))
        assert error.max() <= 3.32e-4

    def test_motion_file_and_a_bound_of_the_user(self, tmp_path):
        mechanism = Mechanism.load("wu2012")
        bundled("sinusoids", mechanism, 200).save(tmp_path / "path.csv")
        arguments = ["--format", "json", "--output", "forces.json", "--tolerance", "1e-3"]
        done = self.run(tmp_path, "wu2012", "path.csv", *arguments)
        assert (done.returncode, done.stderr) == (0, "")
        content = json.loads((tmp_path / "forces.json").read_text())
        assert (content["tolerance_rel"], content["motion"]) == (1e-3, "path")
        assert content["bound_holds"] == "at the samples of the motion"
        assert content["error_N"] <= content["bound_N"]

    @pytest.mark.parametrize(
        ("arguments", "says"),
        [
            (
                ["--format", "adams", "--output", "f.adm", "--tolerance", "0"],
                "--tolerance: 0.0; allowed: 1e-12",
            ),
            (["--format", "adams", "--output", "f.adm", "--tolerance", "nan"], "--tolerance: nan; allowed"),
            (["--format", "adams", "--output", "f.adm", "--tolerance", "much"], "much"),
            (["--format", "adams", "--output", "f.txt"], "f.txt: output: .txt; allowed: .adm for adams"),
            (["--format", "simulink", "--output", "f.m"], "simulink"),
            (["--format", "matlab", "--output", "nowhere/f.m"], "nowhere/f.m: output: its folder"),
        ],
    )
    def test_bad_options_are_refused_in_one_line_and_the_old_output_stays(self, arguments, says, tmp_path):
        (tmp_path / "f.adm").write_text("of last week\n")
        done = self.run(tmp_path, "wu2012", "line", *arguments)
        assert (done.returncode, done.stdout) == (2, "")
        assert len(done.stderr.splitlines()) == 1
        assert says in done.stderr
        assert (tmp_path / "f.adm").read_text() == "of last week\n"
        assert [path.name for path in tmp_path.iterdir()] == ["f.adm"]

    def test_a_motion_that_is_also_the_output_is_refused(self, tmp_path):
        bundled("line", Mechanism.load("wu2012"), 20).save(tmp_path / "path.csv")
        before = (tmp_path / "path.csv").read_bytes()
        done = self.run(tmp_path, "wu2012", "path.csv", "--format", "csv", "--output", "path.csv")
        assert done.returncode == 2
        assert "an input of this command" in done.stderr
        assert (tmp_path / "path.csv").read_bytes() == before


def test_a_singular_pose_between_two_samples_is_refused(wu2012):
    """Turned by a right angle about z the hexapod is singular; no sample need lie there."""
    from scipy.spatial.transform import Rotation

    time = np.linspace(0, 1, 30)
    zero = np.zeros((30, 3))
    motion = sixsps.Motion(
        time=time,
        position=np.tile([0.0, 0.0, 0.5], (30, 1)),
        quaternion=Rotation.from_rotvec(np.outer(2.2 * time, [0, 0, 1])).as_quat(scalar_first=True),
        velocity=zero,
        angular_velocity=np.tile([0, 0, 2.2], (30, 1)),
        acceleration=zero,
        angular_acceleration=zero,
    )
    with pytest.raises(sixsps.MotionError, match=r"between t = 0\.\d+ s and 0\.\d+ s: a singular pose"):
        driving_functions(wu2012, motion, "akima")
