"""The command line on bad input: status 2, one line that helps, and nothing written."""

import subprocess
import sys
from pathlib import Path

import pytest
from texts import MECHANISM, edited

from sixsps.trajectories import bundled_motions

MISSING = None
DIRECTORY = object()

HEADER = "t,x,y,z,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz,ax,ay,az,ex,ey,ez"
ROW_1 = "0,0,0.2,0.45,1,0,0,0"
ROW_2 = "0.1,0,0.2,0.45,1,0,0,0"
ROW_3 = "0.2,0,0.2,0.45,1,0,0,0"
REST = ",0" * 12


def four_in_one():
    lines = MECHANISM.splitlines(keepends=True)
    lines[5:8] = [lines[4]] * 3
    return "".join(lines)


def csv(*rows, header=HEADER):
    return "\n".join([header, *(row + REST for row in rows)]) + "\n"


def put(path, content):
    if content is DIRECTORY:
        path.mkdir()
    elif content is not MISSING:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())


def tree(folder):
    """Everything below `folder`: path -> content, None for a directory."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def run(folder, *arguments):
    command = [sys.executable, "-m", "compare", *arguments]
    return subprocess.run(
        command, cwd=folder, capture_output=True, encoding="utf-8", timeout=100, check=False
    )


def refused(folder, *arguments):
    """Returns the one line that a refused command says, after checking that it did nothing else."""
    before = tree(folder)
    process = run(folder, *arguments)
    assert process.returncode == 2, process.stderr
    assert process.stdout == ""
    assert process.stderr.endswith("\n")
    lines = process.stderr.splitlines()
    assert len(lines) == 1, process.stderr
    assert lines[0].isprintable()
    assert tree(folder) == before
    return lines[0]


MECHANISMS = {
    "missing": (MISSING, ["no such file"]),
    "directory": (DIRECTORY, ["a directory"]),
    "empty": ("", ["an empty file"]),
    "binary": (bytes(range(256)) * 10, ["binary", "UTF-8"]),
    "syntax error": (edited("gravity: [0, 0, -9.81]", "gravity: [0, 0, -9.81"), ["line 3", "expected"]),
    "unknown key": (
        edited("  mass: 1.25", "  mass: 1.25\n  weight: 9.81"),
        [":20:", "platform.weight", "9.81", "mass"],
    ),
    "repeated key": (
        edited("  mass: 1.25", "  mass: 1.25\n  mass: 2.0"),
        [":20:", "platform.mass", "repeated"],
    ),
    "missing key": (edited("gravity: [0, 0, -9.81]\n", ""), ["gravity", "missing", "required"]),
    "five anchors": (
        edited("    - [-0.06, -0.24, 0]\n", ""),
        [":4:", "base.anchors", "5 entries", "6 entries"],
    ),
    "a string for a number": (edited("1.25", "'1.0 kg'"), [":19:", "platform.mass", "1.0 kg", "a number"]),
    "NaN": (edited("1.25", ".nan"), [":19:", "platform.mass", "nan", "finite"]),
    "infinity": (edited("-9.81", "-.inf"), [":2:", "gravity.2", "-inf", "finite"]),
    "zero mass": (edited("1.25", "0"), [":19:", "platform.mass", "0", "> 0"]),
    "negative mass": (edited("mass: 0.3", "mass: -0.3"), [":23:", "legs.upper.mass", "-0.3", "> 0"]),
    "inertia not positive definite": (
        edited("yy: 0.0025", "yy: -0.0025"),
        [":20:", "platform.inertia", "-0.0025", "positive"],
    ),
    "inertia against the triangle inequality": (
        edited("zz: 0.005", "zz: 0.0051"),
        [":20:", "platform.inertia", "0.0051", "sum of the other two"],
    ),
    "coincident anchors": (four_in_one(), [":4:", "base.anchors", "4 anchors coincide", "at most three"]),
}


@pytest.mark.parametrize(("content", "says"), MECHANISMS.values(), ids=MECHANISMS)
def test_a_bad_mechanism_is_refused_in_one_line(tmp_path, content, says):
    put(tmp_path / "bench.yaml", content)
    line = refused(tmp_path, "ik", "bench.yaml", "line", "--output", "lengths.csv")
    for words in ("sixsps: bench.yaml", "; allowed: ", *says):
        assert words in line


MOTIONS = {
    "missing": (MISSING, ["no such file"]),
    "directory": (DIRECTORY, ["a directory"]),
    "empty": ("", ["an empty file"]),
    "binary": (bytes(range(256)) * 10, ["binary", "CSV"]),
    "without t": (csv(ROW_1, ROW_2, header=HEADER.replace("t,", "mx,")), ["column t", "missing", "seconds"]),
    "unknown column": (csv(ROW_1, ROW_2, header=HEADER.replace("z", "height", 1)), ["height", "t, x, y, z"]),
    "half a derivative group": (
        csv(ROW_1, ROW_2, header=HEADER.replace("ey,ez", "mx,my")),
        ["ey, ez missing", "ax, ay, az, ex, ey, ez"],
    ),
    "repeated time": (csv(ROW_1, ROW_2, ROW_2), ["t, row 3 (line 4)", "0.1 after 0.1", "increase"]),
    "time backwards": (csv(ROW_1, ROW_3, ROW_2), ["t, row 3 (line 4)", "0.1 after 0.2", "increase"]),
    "NaN": (csv(ROW_1, ROW_2.replace("0.45", "nan")), ["z, row 2 (line 3)", "nan", "finite"]),
    "an empty cell": (csv(ROW_1, ROW_2.replace("0.45", "")), ["z, row 2 (line 3)", "empty", "finite"]),
    "text": (csv(ROW_1, ROW_2.replace("0.45", "high")), ["z, row 2 (line 3)", "high", "a number"]),
    "zero quaternion": (
        csv(ROW_1, ROW_2.replace(",1,", ",0,")),
        ["quaternion, row 2 (line 3)", "length 0", "0.001"],
    ),
    "one row": (csv(ROW_1), ["rows", "1", "at least 2"]),
    "no rows": (HEADER + "\n", ["rows", "0", "at least 2"]),
    "ragged row": (csv(ROW_1, "0.1,0", ROW_3), ["row 2 (line 3)", "14 cells", "20"]),
}


@pytest.mark.parametrize(("content", "says"), MOTIONS.values(), ids=MOTIONS)
def test_a_bad_motion_is_refused_in_one_line_and_the_old_output_stays(tmp_path, content, says):
    put(tmp_path / "path.csv", content)
    (tmp_path / "lengths.csv").write_text("of last week\n")
    line = refused(tmp_path, "ik", "wu2012", "path.csv", "--output", "lengths.csv")
    for words in ("sixsps: path.csv", "; allowed: ", *says):
        assert words in line


def test_a_parquet_file_that_is_not_parquet_is_refused_in_one_line(tmp_path):
    put(tmp_path / "path.parquet", csv(ROW_1, ROW_2))
    line = refused(tmp_path, "forces", "wu2012", "path.parquet", "--output", "forces.parquet")
    assert line.startswith("sixsps: path.parquet: ")
    assert line.endswith("; allowed: a Parquet file")


# A path below a regular file is refused by the kernel whoever asks, root included.
OUTPUTS = {
    "folder does not exist": (["ik", "wu2012", "line", "--output", "nowhere/l.csv"], "nowhere/l.csv"),
    "folder is a file": (["ik", "wu2012", "line", "--output", "file/l.csv"], "file/l.csv"),
    "file is a folder": (["ik", "wu2012", "line", "--output", "folder.csv"], "folder.csv"),
    "report folder is a file": (["compare", "wu2012", "line", "--output", "file"], "file"),
}


@pytest.mark.parametrize(("arguments", "named"), OUTPUTS.values(), ids=OUTPUTS)
def test_an_output_that_cannot_be_written_is_refused_and_nothing_is_left(tmp_path, arguments, named):
    put(tmp_path / "file", "in the way\n")
    put(tmp_path / "folder.csv", DIRECTORY)
    line = refused(tmp_path, *arguments)
    assert line.startswith("sixsps: ")
    for words in (named, "output", "; allowed: "):
        assert words in line


def test_exporting_beside_the_mechanism_file_does_not_overwrite_it(tmp_path):
    put(tmp_path / "bench.yaml", MECHANISM)
    process = run(tmp_path, "export", "urdf", "bench.yaml", "--output", ".")
    assert (tmp_path / "bench.yaml").read_text() == MECHANISM, process.stdout
    assert process.returncode in (0, 2), process.stderr


LINE = ["ik", "wu2012", "line", "--output", "l.csv"]
ARGUMENTS = {
    "motion": (["ik", "wu2012", "lime", "--output", "l.csv"], ["lime", *bundled_motions()]),
    "engine": (
        ["forces", "wu2012", "line", "--engine", "adams", "--output", "f.csv"],
        ["engine", "adams", "kane, casadi, fast, lagrange, newton-euler, virtual-work, pinocchio"],
    ),
    "too few samples": ([*LINE, "--samples", "-7"], ["--samples", "-7", "2"]),
    "more samples than memory": ([*LINE, "--samples", "100000000000000"], ["samples", "100000000000000"]),
    "cutoff": ([*LINE, "--cutoff", "-3"], ["cutoff", "-3"]),
    "tolerance": (
        ["compare", "--tolerance", "inf", "--samples", "3", "--engine", "kane"],
        ["tolerance", "inf"],
    ),
}


@pytest.mark.parametrize(("arguments", "says"), ARGUMENTS.values(), ids=ARGUMENTS)
def test_a_bad_argument_is_refused_with_its_value_and_what_is_allowed(tmp_path, arguments, says):
    line = refused(tmp_path, *arguments)
    for words in says:
        assert words in line


def test_the_files_that_the_cases_start_from_are_good(tmp_path):
    put(tmp_path / "bench.yaml", MECHANISM)
    put(tmp_path / "path.csv", csv(ROW_1, ROW_2, ROW_3))
    process = run(tmp_path, "ik", "bench.yaml", "path.csv", "--output", "lengths.csv")
    assert (process.returncode, process.stdout, process.stderr) == (0, "", "")
    assert len((tmp_path / "lengths.csv").read_text().splitlines()) == 4


def test_exporting_a_bundled_mechanism_does_not_overwrite_a_mechanism_file_of_that_name(tmp_path):
    put(tmp_path / "wu2012.yaml", MECHANISM)
    line = refused(tmp_path, "export", "urdf", "wu2012", "--output", ".")
    assert "holds no closures" in line
    assert (tmp_path / "wu2012.yaml").read_text() == MECHANISM
    assert [path.name for path in tmp_path.iterdir()] == ["wu2012.yaml"]


@pytest.mark.parametrize("command", ["ik", "forces"])
def test_an_output_that_is_an_input_is_refused(tmp_path, command):
    motion = csv(ROW_1, ROW_2, ROW_3)
    put(tmp_path / "path.csv", motion)
    line = refused(tmp_path, command, "wu2012", "path.csv", "--output", "path.csv")
    assert "an input of this command" in line
    assert (tmp_path / "path.csv").read_text() == motion


def test_a_cutoff_where_nothing_is_estimated_is_refused(tmp_path):
    put(tmp_path / "path.csv", csv(ROW_1, ROW_2, ROW_3))
    line = refused(tmp_path, "ik", "wu2012", "path.csv", "--cutoff", "5", "--output", "l.csv")
    assert "cutoff: 5.0" in line


def test_standard_output_that_cannot_be_written_is_one_line(tmp_path):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "compare", "export", "mjcf", "wu2012", "--output", "out"],
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
