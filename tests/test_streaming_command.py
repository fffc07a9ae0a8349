"""`sixsps forces` and `sixsps ik` on long files, as a user runs them: memory, interruptions, full disks."""

import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from terminals import on_terminal

import sixsps
from sixsps.motion import Motion

COMMAND = [sys.executable, "-m", "compare"]
# The same command, which says on its way out how much memory it had, as no parent can tell it.
MEASURED = """
import atexit, sys
from pathlib import Path
from compare.cli import main
atexit.register(lambda: sys.stdout.write(Path("/proc/self/status").read_text()))
main()
"""
REST = ("vx", "vy", "vz", "wx", "wy", "wz", "ax", "ay", "az", "ex", "ey", "ez")
LONG, LONGER = 1_000_000, 3_000_000
HOME = sixsps.home.home_position(sixsps.Mechanism.load("wu2012"))


def write_long(path, rows, **cells):
    """Writes a long motion that takes little space, with (row, value) in some columns."""
    t = np.arange(rows) / 1000
    columns = {"t": t, "x": np.full(rows, HOME[0]), "y": np.full(rows, HOME[1])}
    columns |= {"z": HOME[2] + 0.02 * np.sin(np.arange(rows) % 5000)} | {
        name: np.zeros(rows) for name in REST
    }
    for name, (row, value) in cells.items():
        columns[name][row] = value
    pa.parquet.write_table(pa.table(columns), path)
    return path


def forces(*arguments, **options):
    command = [*COMMAND, "forces", "wu2012", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


def values(path, rows=slice(None)):
    columns = (
        pa.parquet.read_table(path).slice(rows.start or 0, (rows.stop or 2**62) - (rows.start or 0)).columns
    )
    return np.column_stack([column.to_numpy() for column in columns])


@pytest.fixture(scope="module")
def longer(tmp_path_factory):
    return write_long(tmp_path_factory.mktemp("long") / "longer.parquet", LONGER)


@pytest.fixture
def folder(tmp_path):
    """A folder with an older output."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "f.parquet").write_text("precious")
    return tmp_path / "out"


def assert_untouched(folder):
    assert [path.name for path in folder.iterdir()] == ["f.parquet"]
    assert (folder / "f.parquet").read_text() == "precious"


def peak(motion, output):
    """Returns the peak of resident memory [bytes] of computing forces."""
    arguments = ["forces", "wu2012", str(motion), "--engine", "fast", "--output", str(output)]
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *arguments], capture_output=True, text=True, check=True
    )
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024


@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="this system does not tell a process's memory"
)
def test_memory_is_bounded_whatever_the_length(tmp_path, longer):
    long = peak(write_long(tmp_path / "long.parquet", LONG), tmp_path / "f.parquet")
    much_longer = peak(longer, tmp_path / "g.parquet")
    # Two million samples are 418 MB in, 112 MB out; a tenth is left for how blocks happen to meet.
    assert much_longer - long < 50e6
    assert much_longer < 2**30


def test_every_sample_has_its_forces(tmp_path, longer, wu2012):
    assert forces(longer, "--engine", "fast", "--output", tmp_path / "f.parquet").returncode == 0
    whole = Motion.load(longer)
    found = values(tmp_path / "f.parquet")
    assert np.array_equal(found[:, 0], whole.time)
    assert found[:, 1:].tobytes() == sixsps.compile(wu2012).inverse_dynamics(whole).tobytes()


def interrupted(number, motion, folder):
    """Sends a signal when something is written, and returns how the command ended."""
    arguments = ["forces", "wu2012", str(motion), "--engine", "fast", "--output", str(folder / "f.parquet")]
    process = subprocess.Popen(
        [*COMMAND, *arguments], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline = time.monotonic() + 100
    while not any(path.stat().st_size > 8 for path in folder.iterdir() if path.name.startswith(".")):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.002)
    process.send_signal(number)
    _, error = process.communicate(timeout=60)
    return process.returncode, error


@pytest.mark.parametrize(
    ("number", "status", "said"),
    [
        (signal.SIGINT, 130, "sixsps: interrupted; nothing was left half-written\n"),
        (signal.SIGTERM, 143, ""),
        (signal.SIGHUP, 129, ""),
    ],
)
def test_an_interruption_leaves_what_was_there(longer, folder, number, status, said):
    assert interrupted(number, longer, folder) == (status, said)
    assert_untouched(folder)


def test_a_kill_leaves_what_was_there_under_its_name(longer, folder):
    assert interrupted(signal.SIGKILL, longer, folder) == (-signal.SIGKILL, "")
    assert (folder / "f.parquet").read_text() == "precious"


def test_who_asked_not_to_be_hung_up_is_not(tmp_path, longer):
    """As by nohup: the signal is ignored from the start."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        status, error = interrupted(signal.SIGHUP, longer, tmp_path)
    finally:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    assert (status, error) == (0, "")
    assert pa.parquet.read_metadata(tmp_path / "f.parquet").num_rows == LONGER


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_full_disk_is_told_and_leaves_what_was_there(longer, folder, form):
    """A limit to the size of files stands for the disk."""
    (folder / "f.parquet").rename(folder / f"f.{form}")
    done = forces(
        longer, "--engine", "fast", "--output", folder / f"f.{form}",
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (30_000_000, 30_000_000)),
    )  # fmt: skip
    assert done.returncode == 2
    assert (
        done.stderr == f"sixsps: {folder / f'f.{form}'}: output: File too large; allowed: a writable file\n"
    )
    (folder / f"f.{form}").rename(folder / "f.parquet")
    assert_untouched(folder)


@pytest.mark.parametrize("engine", ["fast", "kane"])
def test_a_bad_last_row_is_told_and_leaves_what_was_there(tmp_path, folder, engine):
    motion = write_long(tmp_path / "m.parquet", 140_000, wy=(-1, np.nan))
    done = forces(motion, "--engine", engine, "--output", folder / "f.parquet")
    allowed = "allowed: a finite number up to 1e+50"
    assert (done.returncode, done.stderr) == (2, f"sixsps: {motion}: wy, row 140000: nan; {allowed}\n")
    assert_untouched(folder)


@pytest.mark.parametrize("engine", ["fast", "kane"])
def test_singular_samples_of_any_block_are_told_in_a_few_lines(tmp_path, engine):
    singular = [5, 70_000, *range(135_000, 140_000)]
    motion = write_long(
        tmp_path / "m.parquet", 140_000, x=(singular, 0.0), y=(singular, 0.0), z=(singular, 0.0)
    )
    done = forces(motion, "--engine", engine, "--output", tmp_path / "f.parquet")
    assert done.returncode == 1
    numbers = [line.split()[2] for line in done.stderr.splitlines()[:-1]]
    assert numbers == ["6", "70001", "135001", "135002", "135003"]
    assert done.stderr.endswith("sixsps: and 4997 more singular samples\n")
    found = values(tmp_path / "f.parquet")[:, 1:]
    assert np.flatnonzero(np.isnan(found).all(axis=1)).tolist() == singular
    assert np.isnan(found).sum() == 6 * len(singular)


def test_csv_in_and_out_gives_the_same_bits(tmp_path):
    motion = write_long(tmp_path / "m.parquet", 140_000)
    Motion.load(motion).save(tmp_path / "m.csv")
    for form in ("csv", "parquet"):
        arguments = (tmp_path / f"m.{form}", "--engine", "fast", "--output", tmp_path / f"f.{form}")
        assert forces(*arguments).returncode == 0
    found = np.loadtxt(tmp_path / "f.csv", delimiter=",", skiprows=1)
    assert found.tobytes() == values(tmp_path / "f.parquet").tobytes()


def test_lengths_are_streamed_too(tmp_path, wu2012):
    motion = write_long(tmp_path / "m.parquet", 140_000)
    arguments = ["ik", "wu2012", str(motion), "--rates", "--output", str(tmp_path / "l.parquet")]
    assert subprocess.run([*COMMAND, *arguments], check=False).returncode == 0
    part = slice(131_000, 140_000)
    legs = sixsps.inverse_kinematics(wu2012, Motion.load(motion)[part])
    found = values(tmp_path / "l.parquet", part)
    assert found[:, 1:].tobytes() == np.hstack([legs.lengths, legs.length_rates]).tobytes()


def test_a_terminal_shows_how_much_is_done(tmp_path):
    motion = write_long(tmp_path / "m.parquet", 140_000)
    output = str(tmp_path / "f.csv")
    command = [*COMMAND, "forces", "wu2012", str(motion), "--engine", "fast", "--output", output]
    written, shown = on_terminal(command)
    assert written == b""
    assert b"fast" in shown
    assert b"/140000" in shown
