"""`sixsps fk` as a user runs it: motion files from leg lengths, every assembly mode, and what is refused."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from lengths import apart, lengths_of
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.errors import InputError
from sixsps.lengths_file import load
from sixsps.motion import Motion
from sixsps.tables import read_table, write_table
from sixsps.trajectories import bundled

WU = sixsps.Mechanism.load("wu2012")
MOTION = bundled("sinusoids", WU, 60)
NAMES = ("t", *(f"{kind}{leg}" for kind in ("l", "dl", "ddl") for leg in range(1, 7)))
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
TWIST, ACCELERATION = ("vx", "vy", "vz", "wx", "wy", "wz"), ("ax", "ay", "az", "ex", "ey", "ez")


def command(folder, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "compare", *map(str, arguments)], cwd=folder, capture_output=True, text=True
    )


def columns(motion=MOTION, levels=3):
    legs = sixsps.inverse_kinematics(WU, motion)
    parts = (motion.time[:, None], legs.lengths, legs.length_rates, legs.length_accelerations)[: 1 + levels]
    return dict(zip(NAMES, np.hstack(parts).T.copy(), strict=False))


def fk(folder, table, *options, output="motion.csv", name="lengths.csv"):
    write_table(table, folder / name)
    return command(folder, "fk", "wu2012", name, *options, "--output", output)


def table_of(path):
    names = path.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).T, strict=True))


@pytest.mark.parametrize(
    ("levels", "names"),
    [(1, POSE), (2, (*POSE, *TWIST)), (3, (*POSE, *TWIST, *ACCELERATION))],
    ids=["lengths", "rates", "accelerations"],
)
def test_motion_is_that_of_the_legs(tmp_path, levels, names):
    done = fk(tmp_path, columns(levels=levels))
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    found = table_of(tmp_path / "motion.csv")
    assert tuple(found) == ("t", *names)
    expected = np.hstack([
        MOTION.position, MOTION.quaternion, MOTION.velocity, MOTION.angular_velocity,
        MOTION.acceleration, MOTION.angular_acceleration,
    ])  # fmt: skip
    for k, name in enumerate(names):
        scale = np.abs(expected[:, k - k % 3 : k - k % 3 + 3]).max() + 1
        assert np.abs(found[name] - expected[:, k]).max() <= 1e-12 * scale, name


def test_there_and_back_again(tmp_path):
    """ik of fk of ik: what other commands read is what they wrote."""
    first, motion, last = "first.csv", "motion.parquet", "last.csv"
    for arguments in (
        ("ik", "wu2012", "sinusoids", "--samples", 50, "--rates", "--output", first),
        ("fk", "wu2012", first, "--output", motion),
        ("ik", "wu2012", motion, "--rates", "--output", last),
        ("forces", "wu2012", motion, "--output", "forces.csv"),
    ):
        done = command(tmp_path, *arguments)
        assert (done.returncode, done.stderr) == (0, ""), arguments
    one, other = (read_table(tmp_path / name, NAMES).columns for name in (first, last))
    assert one.keys() == other.keys()
    for name, values in one.items():
        assert np.abs(other[name] - values).max() <= 1e-13 * np.abs(values).max()


def test_rows_without_a_pose_are_told(tmp_path):
    table = columns()
    table["l4"][[7, 8, 30]] += 1.0
    table["l1"][40] = table["l3"][40] = table["l5"][40] = 0.85
    table["l2"][40] = table["l4"][40] = table["l6"][40] = 0.6
    done = fk(tmp_path, table)
    assert done.returncode == 1
    status = sixsps.forward_kinematics(
        WU, np.column_stack([table[f"l{leg}"] for leg in range(1, 7)]), on_failure="return"
    ).status
    unreachable = np.flatnonzero(status == "unreachable")
    assert len(unreachable) >= 3
    first = f"first at t = {MOTION.time[7]:g} s (row 8)"
    assert done.stderr.splitlines() == [
        f"sixsps: unreachable, no pose has such lengths: 3 of 60 rows, {first}",
        "sixsps: unreachable, none found from the guess or the row before (--all seeks everywhere): "
        f"{len(unreachable) - 3} of 60 rows, first at t = {MOTION.time[40]:g} s (row 41)",
    ]
    for name, values in table_of(tmp_path / "motion.csv").items():
        assert np.array_equal(np.isnan(values), (status != "ok") & (name != "t")), name


def test_single_row_and_other_start(tmp_path):
    pose = np.array([0.05, 0.02, -0.6]), Rotation.from_euler("XYZ", [0.1, 0.2, -0.1])
    lengths = lengths_of(WU, pose[0], pose[1].as_matrix())
    table = {"t": np.zeros(1)} | {f"l{leg}": lengths[leg - 1 : leg] for leg in range(1, 7)}
    done = fk(tmp_path, table, "--guess", "0,0,-0.65,0,0,0")  # below the base, where home is not
    assert (done.returncode, done.stderr) == (0, "")
    found = table_of(tmp_path / "motion.csv")
    rotation = Rotation.from_quat([found[name][0] for name in POSE[3:]], scalar_first=True).as_matrix()
    place = [found[name][0] for name in POSE[:3]]
    assert apart(WU, place, rotation, pose[0], pose[1].as_matrix()) <= 1e-13
    assert fk(tmp_path, table).returncode == 0
    assert table_of(tmp_path / "motion.csv")["z"][0] > 0


def test_geometry_alone(tmp_path):
    sixsps.Mechanism.geometry("bare", WU.base_anchors, WU.platform_anchors).save(tmp_path / "bare.yaml")
    write_table(columns(), tmp_path / "lengths.csv")
    done = command(tmp_path, "fk", "bare.yaml", "lengths.csv", "--output", "motion.csv")
    assert done.returncode == 2
    assert done.stderr.startswith("sixsps: --guess: missing; allowed: X,Y,Z,ALPHA,BETA,GAMMA [m, rad]")
    done = command(
        tmp_path, "fk", "bare.yaml", "lengths.csv", "--guess", "0,0,0.7,0,0,0", "--output", "m.parquet"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert np.abs(Motion.load(tmp_path / "m.parquet").position - MOTION.position).max() < 1e-13


def test_all_assembly_modes(tmp_path):
    table = {name: values[:3].copy() for name, values in columns(levels=1).items()}
    table["l4"][1] = 5.0
    done = fk(tmp_path, table, "--all", output="modes.csv")
    assert done.returncode == 1
    assert done.stderr == f"sixsps: no pose found: 1 of 3 rows, first at t = {MOTION.time[1]:g} s (row 2)\n"
    found = table_of(tmp_path / "modes.csv")
    assert tuple(found) == ("t", "mode", *POSE)
    assert set(found["t"]) == set(MOTION.time[[0, 2]])
    for sample in (0, 2):
        rows = found["t"] == MOTION.time[sample]
        assert list(found["mode"][rows]) == list(range(1, rows.sum() + 1))
        place = np.column_stack([found[name][rows] for name in POSE[:3]])
        turn = np.column_stack([found[name][rows] for name in POSE[3:]])
        rotation = Rotation.from_quat(turn, scalar_first=True).as_matrix()
        lengths = lengths_of(WU, place, rotation)
        assert (
            np.abs(lengths - lengths_of(WU, MOTION.position[sample], MOTION.rotation[sample])).max() < 1e-14
        )
        distance = apart(WU, place, rotation, MOTION.position[sample], MOTION.rotation[sample])
        assert (distance < 1e-12).sum() == 1
    done = fk(tmp_path, {name: values[:1] for name, values in table.items()}, "--all", output="modes.parquet")
    assert (done.returncode, done.stderr) == (0, "")
    written = pa.parquet.read_table(tmp_path / "modes.parquet")
    assert pa.types.is_integer(written["mode"].type)


HEADER = ",".join(NAMES[:7])
ROW = "0,.7,.7,.7,.7,.7,.7"
TABLES = {
    "missing": (None, ["lengths", "no such file"]),
    "empty": ("", ["lengths", "an empty file"]),
    "no rows": (HEADER + "\n", ["rows", "0", "at least 1 sample"]),
    "without t": (f"{HEADER[2:]}\n{ROW[2:]}\n", ["columns", "t missing"]),
    "a leg short": (HEADER.replace(",l6", "") + "\n0,1,1,1,1,1\n", ["l6 missing", "l1 to l6"]),
    "half the rates": (f"{HEADER},dl1,dl2\n{ROW},0,0\n", ["dl3, dl4, dl5, dl6 missing", "all of dl1 to dl6"]),
    "accelerations alone": (
        f"{HEADER},{','.join(NAMES[13:])}\n{ROW},0,0,0,0,0,0\n",
        ["ddl1 to ddl6 without rates"],
    ),
    "unknown column": (f"{HEADER},l7\n{ROW},1\n", ["l7", "t, l1, l2"]),
    "negative": (f"{HEADER}\n{ROW}\n1,.7,.7,-.7,.7,.7,.7\n", ["l3, row 2 (line 3)", "-0.7", "at least 0"]),
    "NaN": (f"{HEADER}\n{ROW}\n1,.7,.7,.7,nan,.7,.7\n", ["l4, row 2 (line 3)", "nan", "finite"]),
    "text": (f"{HEADER}\n{ROW}\n1,.7,.7,.7,.7,.7,long\n", ["l6, row 2 (line 3)", "long", "a number"]),
    "time backwards": (f"{HEADER}\n{ROW}\n{ROW}\n", ["t, row 2 (line 3)", "0.0 after 0.0", "increase"]),
}


@pytest.mark.parametrize(("content", "says"), TABLES.values(), ids=TABLES)
def test_lengths_that_cannot_be_used_are_refused_in_one_line(tmp_path, content, says):
    path = tmp_path / "lengths.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError) as caught:
        load(path)
    line = str(caught.value)
    assert line.isprintable()
    for words in (f"{path}: ", "; allowed: ", *says):
        assert words in line


def test_refusals_leave_the_old_output(tmp_path):
    (tmp_path / "lengths.csv").write_text(TABLES["negative"][0])
    (tmp_path / "motion.csv").write_text("of last week\n")
    done = command(tmp_path, "fk", "wu2012", "lengths.csv", "--output", "motion.csv")
    assert (done.returncode, done.stdout) == (2, "")
    assert (
        done.stderr == "sixsps: lengths.csv: l3, row 2 (line 3): -0.7; allowed: a length of at least 0 [m]\n"
    )
    assert (tmp_path / "motion.csv").read_text() == "of last week\n"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--guess", "0,0,1"], ["--guess", "0,0,1", "6 finite numbers"]),
        (["--guess", "0,0,1,0,0,0", "--all"], ["--guess", "with --all"]),
        (["--output", "motion.txt"], ["motion.txt", ".txt", ".csv or .parquet"]),
        (["--output", "lengths.csv"], ["lengths.csv", "an input"]),
    ],
)
def test_options_that_cannot_be_used_are_refused_in_one_line(tmp_path, options, says):
    (tmp_path / "lengths.csv").write_text(f"{HEADER}\n{ROW}\n")
    given = options if "--output" in options else [*options, "--output", "motion.csv"]
    done = command(tmp_path, "fk", "wu2012", "lengths.csv", *given)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    for words in ("sixsps: ", "; allowed: ", *says):
        assert words in line
    assert {path.name for path in tmp_path.iterdir()} == {"lengths.csv"}
