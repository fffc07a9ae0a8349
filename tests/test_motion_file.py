"""Motions in CSV and Parquet: read exactly, written exactly, and refused with the row at fault."""

import errno
import math
import os
import re
import stat
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from sixsps.errors import MotionError, OutputError
from sixsps.files import output_folder, write_atomically
from sixsps.motion import Motion
from sixsps.tables import write_table

FIELDS = (
    "time",
    "position",
    "quaternion",
    "velocity",
    "angular_velocity",
    "acceleration",
    "angular_acceleration",
    "force",
    "moment",
)
DERIVATIVES = ("velocity", "angular_velocity", "acceleration", "angular_acceleration")
QUATERNION = ("qw", "qx", "qy", "qz")
TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
ACCELERATIONS = ("ax", "ay", "az", "ex", "ey", "ez")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
FORMATS = ("csv", "parquet")
HEADER = ",".join(("t", "x", "y", "z", *TWIST, *ACCELERATIONS))
REST = ",0" * 12


def table(n=8, **columns):
    """Columns of a motion at rest; a column given as None is left out."""
    rest = dict.fromkeys((*TWIST, *ACCELERATIONS), np.zeros(n))
    content = {"t": np.arange(n) / 10, "x": np.zeros(n), "y": np.ones(n), "z": np.linspace(1, 2, n)} | rest
    return {name: values for name, values in (content | columns).items() if values is not None}


def poses(n=40, **columns):
    return table(n, **dict.fromkeys((*TWIST, *ACCELERATIONS)) | columns)


def put(folder, columns, form="csv"):
    path = folder / f"path.{form}"
    if form == "parquet":
        pa.parquet.write_table(pa.table(columns), path)
    else:
        cells = [[repr(value) if value is not None else "" for value in np.asarray(column, dtype=object)]
                 for column in columns.values()]  # fmt: skip
        lines = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
        path.write_text("\n".join(lines) + "\n")
    return path


def csv(folder, *rows, header=HEADER):
    """A CSV file at rest whose rows start as in `rows`."""
    return text(folder, "\n".join([header, *(row + REST for row in rows)]) + "\n")


def text(folder, content):
    path = folder / "path.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refusal(path, **options):
    """Returns the message with which a file is refused: one printable line that starts with the file."""
    with pytest.raises(MotionError) as caught:
        Motion.load(path, **options)
    message = str(caught.value)
    assert message.isprintable()
    assert message.startswith(f"{path}: ")
    assert "; allowed: " in message
    return message.removeprefix(f"{path}: ")


def row(number, form):
    """How a message names a row: data rows count from 1, the header is line 1 of a CSV file."""
    return f"row {number} (line {number + 1})" if form == "csv" else f"row {number}"


def numbered(message, form):
    """A Parquet file has no lines; whether a message counts them all the same is left open."""
    return re.sub(r" \(line \d+\)", "", message) if form == "parquet" else message


def loaded_or_refused(path, **options):
    """Returns the motion in a file and nothing, or nothing and the message that refuses it."""
    try:
        return Motion.load(path, **options), None
    except MotionError as error:
        return None, str(error)


def bits(motion):
    return [np.ascontiguousarray(getattr(motion, name), dtype="<f8").tobytes() for name in FIELDS]


def motion(n=4, **fields):
    zero = np.zeros((n, 3))
    return Motion(**{"time": np.arange(n), "position": zero, **dict.fromkeys(DERIVATIVES, zero)} | fields)


# Beyond 1e50 the squares and products of a mechanism's numbers are no floats any more.
NUMBER = st.floats(min_value=-1e50, max_value=1e50)
TIMES = st.lists(NUMBER, min_size=2, max_size=5, unique=True)


@st.composite
def motions(draw):
    time = sorted(draw(TIMES))
    n = len(time)
    rows = st.lists(st.tuples(NUMBER, NUMBER, NUMBER), min_size=n, max_size=n)
    turns = draw(st.lists(st.integers(0, 2**32 - 1), min_size=n, max_size=n))
    quaternion = np.array([Rotation.random(rng=turn).as_quat(scalar_first=True) for turn in turns])
    off = np.array(draw(st.lists(st.floats(-9e-4, 9e-4), min_size=n, max_size=n)))
    vectors = {name: draw(rows) for name in FIELDS if name not in ("time", "quaternion")}
    return Motion(time=time, quaternion=quaternion * (1 + off[:, None]), **vectors)


AWKWARD = np.array(
    [
        [5e-324, -0.0, 9.999999999999999e49],
        [0.1 + 0.2, 1 / 3, -2.2250738585072014e-308],
        [2**53 + 2.0, 1e22, 123456789.12345679],
        [1e-5, 1e16, 9007199254740993.0],
    ]
)


@pytest.mark.parametrize("form", FORMATS)
@settings(max_examples=60)
@given(drawn=motions())
@example(drawn=motion(position=AWKWARD, velocity=-AWKWARD, force=AWKWARD[::-1]))
def test_saving_and_loading_gives_the_same_motion_bit_for_bit(tmp_path_factory, form, drawn):
    path = tmp_path_factory.getbasetemp() / f"again.{form}"
    drawn.save(path)
    again = Motion.load(path)
    assert bits(again) == bits(drawn)
    assert again.sha256 == drawn.sha256
    assert dict(again.estimated) == {}


@given(st.lists(NUMBER, min_size=2, max_size=20))
@example(AWKWARD.ravel().tolist())
def test_a_float_written_by_python_is_read_as_that_float(tmp_path_factory, values):
    n = len(values)
    loaded = Motion.load(put(tmp_path_factory.getbasetemp(), table(n, x=values)))
    assert loaded.position[:, 0].tobytes() == np.array(values).tobytes()


@pytest.mark.parametrize("form", FORMATS)
def test_results_are_written_exactly_and_nan_as_nan(tmp_path, form):
    columns = {
        "t": np.arange(4.0),
        "f1": AWKWARD[:, 1],
        "f2": [1.7976931348623157e308, -1e-310, 0.1, math.nan],
    }
    path = tmp_path / f"forces.{form}"
    write_table(columns, path)
    if form == "parquet":
        read = pa.parquet.read_table(path).to_pydict()
    else:
        header, *rows = path.read_text().splitlines()
        cells = zip(*(map(float, row.split(",")) for row in rows), strict=True)
        read = dict(zip(header.split(","), cells, strict=True))
    assert list(read) == ["t", "f1", "f2"]
    for name, values in columns.items():
        assert_array_equal(read[name], values)
        assert_array_equal(np.signbit(read[name]), np.signbit(values))


@pytest.mark.parametrize("form", FORMATS)
def test_columns_may_stand_in_any_order(tmp_path, form):
    rng = np.random.default_rng(0)
    columns = {name: rng.standard_normal(5) for name in ("x", "y", "z", *TWIST, *ACCELERATIONS, *WRENCH)}
    columns |= {"t": np.arange(5.0)}
    quaternion = Rotation.random(5, rng=rng).as_quat(scalar_first=True)
    columns |= dict(zip(QUATERNION, quaternion.T, strict=True))
    names = list(columns)
    for order in (names, names[::-1], sorted(names), list(rng.permutation(names))):
        loaded = Motion.load(put(tmp_path, {str(name): columns[name] for name in order}, form))
        assert_array_equal(loaded.time, columns["t"])
        assert_array_equal(loaded.position, np.column_stack([columns[name] for name in ("x", "y", "z")]))
        assert_array_equal(loaded.quaternion, quaternion)
        for parts, group in (
            (("velocity", "angular_velocity"), TWIST),
            (("acceleration", "angular_acceleration"), ACCELERATIONS),
            (("force", "moment"), WRENCH),
        ):
            both = np.hstack([getattr(loaded, part) for part in parts])
            assert_array_equal(both, np.column_stack([columns[name] for name in group]))


@pytest.mark.parametrize("form", FORMATS)
def test_euler_angles_turn_about_x_then_the_new_y_then_the_new_z(tmp_path, form):
    angles = np.random.default_rng(1).uniform(-4, 4, (50, 3))
    angles[:3] = [[0, math.pi / 2, 0], [0.3, -math.pi / 2, 0.2], [math.pi, 0, -math.pi]]
    names = ("alpha", "beta", "gamma")
    loaded = Motion.load(put(tmp_path, table(50, **dict(zip(names, angles.T, strict=True))), form))
    alpha, beta, gamma = (Rotation.from_euler("xyz"[i], angles[:, [i]]) for i in range(3))
    assert_allclose(loaded.rotation, (alpha * beta * gamma).as_matrix(), rtol=0, atol=1e-14)
    # and so that no change of scipy's convention goes unseen
    a, b, c = angles[7]
    assert loaded.rotation[7][0] == pytest.approx(
        [math.cos(b) * math.cos(c), -math.cos(b) * math.sin(c), math.sin(b)], abs=1e-14
    )
    assert loaded.rotation[7][1, 2] == pytest.approx(-math.sin(a) * math.cos(b), abs=1e-14)


def test_orientation_absent_is_identity_and_wrench_absent_is_zero(tmp_path):
    loaded = Motion.load(put(tmp_path, table(3)))
    assert_array_equal(loaded.quaternion, [[1, 0, 0, 0]] * 3)
    assert_array_equal(loaded.rotation, [np.eye(3)] * 3)
    assert_array_equal(loaded.force, np.zeros((3, 3)))
    assert_array_equal(loaded.moment, np.zeros((3, 3)))
    assert loaded.name == "path"


@pytest.mark.parametrize("norm", [1 - 9.9e-4, 1 - 1e-9, 1 + 9.9e-4])
def test_a_quaternion_slightly_off_unit_length_is_stored_as_given(tmp_path, norm):
    quaternion = norm * Rotation.random(4, rng=2).as_quat(scalar_first=True)
    columns = table(4, **dict(zip(QUATERNION, quaternion.T, strict=True)))
    loaded = Motion.load(put(tmp_path, columns))
    assert loaded.quaternion.tobytes() == np.ascontiguousarray(quaternion).tobytes()
    assert_allclose(loaded.rotation @ loaded.rotation.transpose(0, 2, 1), [np.eye(3)] * 4, atol=1e-14)
    assert_allclose(loaded.rotation, Rotation.random(4, rng=2).as_matrix(), atol=1e-14)


@pytest.mark.parametrize("norm", [0.0, 1 - 1.01e-3, 1 + 1.01e-3, -2.0, 1e30])
@pytest.mark.parametrize("derivatives", [table, poses])
def test_a_quaternion_off_unit_length_is_refused_with_its_row(tmp_path, norm, derivatives):
    w = np.ones(8)
    w[5] = norm
    columns = derivatives(8, **dict(zip(QUATERNION, [w, 0 * w, 0 * w, 0 * w], strict=True)))
    message = refusal(put(tmp_path, columns))
    assert message.startswith("quaternion, row 6 (line 7): length ")
    assert message.endswith("; allowed: length 1 within 0.001")


def test_a_quaternion_too_large_to_square_is_refused_without_a_warning(tmp_path):
    columns = table(3, qw=[1, 1e200, 1], qx=np.zeros(3), qy=np.zeros(3), qz=np.zeros(3))
    assert ", row 2 (line 3): " in refusal(put(tmp_path, columns))


@pytest.mark.parametrize("form", FORMATS)
def test_given_derivatives_are_used_as_they_are_however_wrong(tmp_path, form):
    rng = np.random.default_rng(3)
    given_values = {name: rng.standard_normal(30) for name in (*TWIST, *ACCELERATIONS)}
    loaded = Motion.load(put(tmp_path, table(30, **given_values), form))
    twist = np.hstack([loaded.velocity, loaded.angular_velocity])
    accelerations = np.hstack([loaded.acceleration, loaded.angular_acceleration])
    assert_array_equal(twist, np.column_stack([given_values[name] for name in TWIST]))
    assert_array_equal(accelerations, np.column_stack([given_values[name] for name in ACCELERATIONS]))
    assert dict(loaded.estimated) == {}


@pytest.mark.parametrize(
    ("given_group", "fields"),
    [(TWIST, ("velocity", "angular_velocity")), (ACCELERATIONS, ("acceleration", "angular_acceleration"))],
)
def test_only_the_derivatives_that_are_missing_are_estimated_and_said_to_be(tmp_path, given_group, fields):
    values = np.random.default_rng(4).standard_normal((40, 6))
    columns = poses(40, **dict(zip(given_group, values.T, strict=True)))
    loaded = Motion.load(put(tmp_path, columns))
    assert_array_equal(np.hstack([getattr(loaded, name) for name in fields]), values)
    assert set(loaded.estimated) == set(DERIVATIVES) - set(fields)
    assert all(how.strip() for how in loaded.estimated.values())


@pytest.mark.parametrize("form", FORMATS)
def test_missing_derivatives_are_estimated_from_the_poses(tmp_path, form):
    t = np.linspace(0, 2, 401)
    angle = 0.4 * np.sin(3 * t)
    half = [np.cos(angle / 2), 0 * t, 0 * t, np.sin(angle / 2)]
    columns = poses(401, t=t, x=np.sin(2 * t), z=t**2, **dict(zip(QUATERNION, half, strict=True)))
    loaded = Motion.load(put(tmp_path, columns, form))
    assert set(loaded.estimated) == set(DERIVATIVES)
    zero = 0 * t
    for name, expected in (
        ("velocity", [2 * np.cos(2 * t), zero, 2 * t]),
        ("acceleration", [-4 * np.sin(2 * t), zero, zero + 2]),
        ("angular_velocity", [zero, zero, 1.2 * np.cos(3 * t)]),
        ("angular_acceleration", [zero, zero, -3.6 * np.sin(3 * t)]),
    ):
        assert_allclose(getattr(loaded, name)[20:-20], np.column_stack(expected)[20:-20], atol=1e-3)


def test_estimated_derivatives_are_given_once_they_are_saved(tmp_path):
    first = Motion.load(put(tmp_path, poses()))
    first.save(tmp_path / "full.csv")
    again = Motion.load(tmp_path / "full.csv")
    assert bits(again) == bits(first)
    assert set(first.estimated) == set(DERIVATIVES)
    assert dict(again.estimated) == {}


ROWS = ("0,1,2,3", "0.5,1,2,3", "1,1.5,2,3")
GOOD = "\n".join([HEADER, *(row + REST for row in ROWS)]) + "\n"
LAYOUTS = {
    "byte order mark": "\ufeff" + GOOD,
    "windows": GOOD.replace("\n", "\r\n"),
    "windows with byte order mark": "\ufeff" + GOOD.replace("\n", "\r\n"),
    "no line end at the end": GOOD.rstrip("\n"),
    "empty line at the end": GOOD + "\n",
    "blanks around names": GOOD.replace(HEADER, " " + HEADER.replace(",", " ,\t ") + " "),
    "blanks around values": GOOD.replace(",", " , "),
    "quoted names": GOOD.replace(HEADER, '"' + HEADER.replace(",", '","') + '"'),
    "quoted values": GOOD.replace("1.5", '"1.5"'),
    "other ways to write floats": GOOD.replace("0.5,", "5e-1,").replace("1.5", "15.00E-1"),
    "explicit plus": GOOD.replace("1.5", "+1.5"),
}


@pytest.mark.parametrize("content", LAYOUTS.values(), ids=LAYOUTS)
def test_the_layout_of_a_csv_file_does_not_matter(tmp_path, content):
    loaded = Motion.load(text(tmp_path, content))
    assert_array_equal(loaded.time, [0, 0.5, 1])
    assert_array_equal(loaded.position, [[1, 2, 3], [1, 2, 3], [1.5, 2, 3]])


def test_integers_are_numbers_in_csv_and_parquet(tmp_path):
    content = HEADER + "\n0,1,2,3" + REST + "\n1,-4,2,3" + REST + "\n"
    for path in (
        text(tmp_path, content),
        put(tmp_path, table(2, t=np.array([0, 1]), x=np.array([1, -4], dtype="i2")), "parquet"),
    ):
        loaded = Motion.load(path)
        assert loaded.time.dtype == loaded.position.dtype == np.float64
        assert_array_equal(loaded.time, [0, 1])
        assert_array_equal(loaded.position[:, 0], [1, -4])


@pytest.mark.parametrize("form", FORMATS)
def test_integers_beyond_the_exact_floats_are_rounded_or_refused(tmp_path, form):
    path = put(tmp_path, table(8, t=2**60 + 1024 * np.arange(8)), form)
    loaded, refused = loaded_or_refused(path)
    if refused:
        assert f"{path}: t" in refused
    else:
        assert_array_equal(loaded.time, 2.0**60 + 1024 * np.arange(8))


def test_single_precision_parquet_is_read(tmp_path):
    loaded = Motion.load(put(tmp_path, table(8, x=np.full(8, 0.1, dtype="f4")), "parquet"))
    assert_array_equal(loaded.position[:, 0], np.full(8, np.float32(0.1), dtype=np.float64))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["t", "y", "ez"])
def test_what_is_not_finite_is_refused_with_its_row(tmp_path, form, name, value):
    values = np.arange(8.0)
    values[4] = value
    message = numbered(refusal(put(tmp_path, table(8, **{name: values}), form)), form)
    assert message.startswith(f"{name}, {row(5, form)}: {value}; allowed: a finite number")


@pytest.mark.parametrize("form", FORMATS)
def test_an_empty_cell_is_refused_with_its_row(tmp_path, form):
    path = put(tmp_path, table(8, vx=[1.0, 2.0, None, 4.0, None, 6.0, 7.0, 8.0]), form)
    message = numbered(refusal(path), form)
    assert message.startswith(f"vx, {row(3, form)}: an empty cell; allowed: a finite number")


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("last", [0.2, 0.1, -5.0])
@pytest.mark.parametrize("derivatives", [table, poses])
def test_times_that_do_not_increase_are_refused_with_their_row(tmp_path, form, last, derivatives):
    t = np.array([0, 0.1, 0.2, last, 0.4, 0.5, 0.6, 0.7])
    message = numbered(refusal(put(tmp_path, derivatives(8, t=t), form)), form)
    assert message == f"t, {row(4, form)}: {last} after 0.2; allowed: times that strictly increase [s]"


@pytest.mark.parametrize(
    "cell", ["high", "1,5", "0x10", "1_0", "1e", "--1", "NA", "null", "None", "٣", "1 2", " "]
)
def test_a_cell_that_is_no_number_is_refused_with_its_row_and_column(tmp_path, cell):
    message = refusal(csv(tmp_path, ROWS[0], f'0.5,"{cell}",2,3', ROWS[2]))
    assert message.startswith("x, row 2 (line 3): ")
    assert "; allowed: a " in message
    assert "number" in message
    if cell.isascii() and cell.strip():
        assert f": {cell};" in message


@pytest.mark.parametrize("cell", ["nan", "high", ""])
def test_an_empty_line_does_not_shift_the_line_that_an_error_names(tmp_path, cell):
    path = csv(tmp_path, ROWS[0], ROWS[1], f"1,{cell},2,3")
    path.write_text(path.read_text().replace("\n0.5", "\n\n\n0.5"))
    assert path.read_text().splitlines()[5].startswith(f"1,{cell},2,3")
    message = refusal(path)
    assert message.startswith("x, row 3 ")
    assert "(line 6)" in message


def test_an_empty_line_before_the_header_does_not_hide_the_row(tmp_path):
    path = csv(tmp_path, ROWS[0], "0.5,high,2,3")
    path.write_text("\n" + path.read_text())
    assert refusal(path).startswith("x, row 2 ")


BAD_COLUMNS = {
    "without t": ({"t": None}, ["column t", "missing", "seconds"]),
    "without x, y, z": ({"x": None, "y": None, "z": None}, ["x, y, z", "missing", "metres"]),
    "without z": ({"z": None}, ["z missing", "x, y, z"]),
    "without wy": ({"wy": None}, ["wy missing", "vx, vy, vz, wx, wy, wz"]),
    "ax only": (dict.fromkeys(ACCELERATIONS[1:]), ["ay, az, ex, ey, ez missing"]),
    "fz only": ({"fz": np.ones(8)}, ["fx, fy, mx, my, mz missing"]),
    "no qz": ({"qw": np.ones(8), "qx": np.zeros(8), "qy": np.zeros(8)}, ["qz missing"]),
    "alpha only": ({"alpha": np.zeros(8)}, ["beta, gamma missing"]),
    "two orientations": (
        {name: np.full(8, name == "qw", dtype=float) for name in (*QUATERNION, "alpha", "beta", "gamma")},
        ["quaternion and Euler angles", "only one"],
    ),
    "unknown": ({"pressure": np.zeros(8)}, ["column: pressure", "t, x, y, z, qw"]),
    "capital": ({"X": np.zeros(8)}, ["column: X", "t, x, y, z, qw"]),
    "without a name": ({"": np.zeros(8)}, ["column: without a name"]),
}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("changes", "says"), BAD_COLUMNS.values(), ids=BAD_COLUMNS)
def test_columns_that_make_no_motion_are_refused(tmp_path, form, changes, says):
    message = refusal(put(tmp_path, table(8, **changes), form))
    for words in says:
        assert words in message


def test_a_column_that_stands_twice_is_refused(tmp_path):
    path = text(tmp_path, GOOD.replace("t,x,y,z", "t,x,x,z"))
    assert refusal(path) == "column: x twice; allowed: each column once"
    columns = table(4)
    twice = pa.Table.from_arrays([pa.array(v) for v in columns.values()], ["t", "x", "x", *list(columns)[3:]])
    path = tmp_path / "path.parquet"
    pa.parquet.write_table(twice, path)
    assert "x" in refusal(path)


@pytest.mark.parametrize("name", ["two\nlines", "\x1b[31m", "größe", "q" * 5000])
@pytest.mark.parametrize("form", FORMATS)
def test_a_strange_column_name_gives_one_printable_line(tmp_path, form, name):
    column = f'"{name}"' if form == "csv" else name
    message = refusal(put(tmp_path, table(8) | {column: np.zeros(8)}, form))
    assert message.startswith("column: ")
    assert len(message) < 500


def test_a_parquet_column_name_that_is_no_text_is_refused(tmp_path):
    path = put(tmp_path, table(8, pressure=np.zeros(8)), "parquet")
    path.write_bytes(path.read_bytes().replace(b"pressure", b"pres\xff\xfere"))
    refusal(path)


@pytest.mark.parametrize("n", [0, 1])
@pytest.mark.parametrize("form", FORMATS)
def test_fewer_than_two_rows_are_refused(tmp_path, form, n):
    assert refusal(put(tmp_path, table(n), form)) == f"rows: {n}; allowed: at least 2 samples"


def test_two_rows_are_enough_with_derivatives_and_six_without(tmp_path):
    assert len(Motion.load(put(tmp_path, table(2)))) == 2
    assert len(Motion.load(put(tmp_path, poses(6)))) == 6
    message = refusal(put(tmp_path, poses(5)))
    assert "5 samples" in message
    assert "at least 6" in message


CONTENTS = {
    "empty": b"",
    "header only": HEADER.encode(),
    "blank lines": b"\n\n\n",
    "blanks": b"   \n",
    "byte order mark only": "\ufeff".encode(),
    "binary": bytes(range(256)) * 20,
    "binary without NUL": bytes(range(1, 256)) * 20,
    "UTF-16": GOOD.encode("utf-16"),
    "Latin-1 header": GOOD.replace("z", "höhe", 1).encode("latin-1"),
    "Latin-1 cell": GOOD.replace("1.5", "½").encode("latin-1"),
    "no header": GOOD.removeprefix(HEADER + "\n").encode(),
    "semicolons": GOOD.replace(",", ";").encode(),
    "short row": GOOD.replace("1,1.5,2,3" + REST, "1,1.5,2").encode(),
    "long row": GOOD.replace("1,1.5,2,3", "1,1.5,2,3,4").encode(),
    "open quote": GOOD.replace("1.5", '"1.5').encode(),
    "late NUL": GOOD.encode() + b"\0\0\n",
    "Parquet": b"PAR1" + bytes(100) + b"PAR1",
    "HTML": b"<!DOCTYPE html>\n<html><body>404, not found</body></html>\n",
}


@pytest.mark.parametrize("content", CONTENTS.values(), ids=CONTENTS)
def test_what_is_no_table_of_a_motion_is_refused_in_one_line(tmp_path, content):
    path = text(tmp_path, content)
    message = refusal(path)
    assert "list index" not in message
    path.rename(path.with_suffix(".parquet"))
    refusal(path.with_suffix(".parquet"))


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="this system does not name open files")
def test_a_pipe_is_read_or_refused():
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as pipe:
        pipe.write(GOOD)
    loaded, refused = loaded_or_refused(f"/dev/fd/{reading}")
    os.close(reading)
    assert refused or len(loaded) == 3


def test_a_ragged_row_is_named(tmp_path):
    message = refusal(text(tmp_path, GOOD.replace("0.5,1,2,3" + REST, "0.5,1,2")))
    assert message == "row 2 (line 3): 3 cells; allowed: 16 as in the header"


def test_a_header_without_a_line_end_is_a_table_without_rows(tmp_path):
    assert refusal(text(tmp_path, HEADER)) == "rows: 0; allowed: at least 2 samples"


PARQUET_COLUMNS = {
    "text": ["1"] * 8,
    "booleans": [True] * 8,
    "nothing": [None] * 8,
    "lists": [[1.0]] * 8,
    "dates": np.arange(8).astype("M8[s]"),
}


@pytest.mark.parametrize("values", PARQUET_COLUMNS.values(), ids=PARQUET_COLUMNS)
def test_parquet_columns_that_are_no_numbers_are_refused(tmp_path, values):
    message = refusal(put(tmp_path, table(8, x=values), "parquet"))
    assert message.startswith("column x: ")


def test_a_damaged_parquet_file_never_ends_in_another_error(tmp_path):
    motion(20, force=np.random.default_rng(5).standard_normal((20, 3))).save(tmp_path / "good.parquet")
    good = (tmp_path / "good.parquet").read_bytes()
    rng = np.random.default_rng(6)
    path = tmp_path / "bad.parquet"
    refused = 0
    for _ in range(300):
        damaged = bytearray(good[: rng.integers(8, len(good))] if rng.random() < 0.1 else good)
        for place in rng.integers(0, len(damaged), 3):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        _, message = loaded_or_refused(path)
        if message:
            refused += 1
            assert message.isprintable()
    assert refused > 30


@pytest.mark.parametrize("name", ["m" * 300 + ".csv", "../" * 2000 + "m.csv", "a\0b.csv", "two\nlines.csv"])
def test_an_impossible_path_is_refused_in_one_line(name):
    with pytest.raises(MotionError) as caught:
        Motion.load(name)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("cutoff", [0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("derivatives", [table, poses])
def test_a_cutoff_that_is_no_frequency_is_refused(tmp_path, cutoff, derivatives):
    message = refusal(put(tmp_path, derivatives(20)), cutoff=cutoff)
    assert message.startswith("cutoff: ")


@pytest.mark.parametrize("cutoff", [5e-324, 1e-300, 1e-20, 1e-5, 1e5, 1e20, 1e300])
def test_an_extreme_cutoff_is_obeyed_or_refused(tmp_path, cutoff):
    path = put(tmp_path, poses(20, x=np.sin(np.arange(20.0))))
    loaded, refused = loaded_or_refused(path, cutoff=cutoff)
    if refused:
        assert "cutoff" in refused
    else:
        assert np.isfinite(loaded.acceleration).all()


RECORDINGS = {
    "steps of 1e-300 s": np.arange(20) * 1e-300,
    "steps below the smallest normal number": np.arange(20) * 1e-320,
    "steps of 1e300 s": np.arange(20) * 1e300,
    "a pause of a year": np.r_[np.arange(10.0), 3e7 + np.arange(10)],
    "a pause of a million years": np.r_[np.arange(10.0), 3e13 + np.arange(10)],
    "a burst": np.r_[np.arange(10) * 1e-12, np.arange(1, 11)],
    "epoch times": 1.7e9 + np.arange(20) / 100,
}


@pytest.mark.parametrize("t", RECORDINGS.values(), ids=RECORDINGS)
def test_any_increasing_times_give_finite_derivatives_or_a_refusal(tmp_path, t):
    path = put(tmp_path, poses(20, t=t, x=np.sin(np.arange(20.0))))
    loaded, refused = loaded_or_refused(path)
    if refused:
        assert refused.startswith(f"{path}: ")
    else:
        assert len(loaded.estimated) == 4


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e40, 1e160, 1e308])
def test_any_finite_positions_give_finite_derivatives_or_a_refusal(tmp_path, size):
    path = put(tmp_path, poses(20, x=size * np.sin(np.arange(20.0))))
    loaded, refused = loaded_or_refused(path)
    if refused:
        assert refused.startswith(f"{path}: ")
    else:
        assert len(loaded.estimated) == 4


CONSTRUCTORS = {
    "time shape": ({"time": np.zeros((4, 1))}, "time: shape (4, 1); allowed: shape (n)"),
    "time repeats": ({"time": [0, 1, 1, 2]}, "t, index 2: 1.0 after 1.0; allowed: times that strictly"),
    "time NaN": ({"time": [0, 1, math.nan, 2]}, "time[2]: nan; allowed: finite numbers"),
    "position shape": ({"position": np.zeros((3, 3))}, "position: shape (3, 3); allowed: shape ("),
    "position transposed": ({"position": np.zeros((3, 4))}, "position: shape (3, 4)"),
    "position flat": ({"position": np.zeros(3)}, "position: shape (3,)"),
    "position text": ({"position": "home"}, "position: home; allowed: numbers"),
    "velocity shape": ({"velocity": np.zeros((4, 6))}, "velocity: shape (4, 6)"),
    "acceleration infinite": ({"acceleration": np.full((4, 3), math.inf)}, "acceleration[0, 0]: inf"),
    "angular NaN": (
        {"angular_velocity": [[0, 0, 0]] * 3 + [[0, math.nan, 0]]},
        "angular_velocity[3, 1]: nan",
    ),
    "force for one sample": ({"force": np.zeros((1, 3))}, "force: shape (1, 3)"),
    "moment ragged": ({"moment": [[0, 0, 0]] * 3 + [[0]]}, "moment"),
    "quaternion shape": ({"quaternion": np.zeros((4, 3))}, "quaternion: shape (4, 3)"),
    "quaternion zero": ({"quaternion": [[1, 0, 0, 0]] * 3 + [[0] * 4]}, "quaternion, index 3: length 0"),
    "quaternion doubled": ({"quaternion": [[2, 0, 0, 0]] * 4}, "length 2; allowed: length 1 within 0.001"),
    "quaternion huge": ({"quaternion": [[1e200, 0, 0, 0]] * 4}, "quaternion"),
}


@pytest.mark.parametrize(("fields", "says"), CONSTRUCTORS.values(), ids=CONSTRUCTORS)
def test_a_motion_that_cannot_be_is_refused_by_the_constructor(fields, says):
    with pytest.raises(MotionError) as caught:
        motion(**fields)
    assert says in str(caught.value)


def test_a_motion_is_frozen_and_copies_what_it_is_given():
    position = np.zeros((4, 3))
    moving = motion(position=position)
    position[0, 0] = 7
    assert moving.position[0, 0] == 0
    for array in (*(getattr(moving, name) for name in FIELDS), moving.rotation, moving[1:].velocity):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(FrozenInstanceError):
        moving.name = "other"


def test_the_hash_is_of_the_numbers_whatever_the_file(tmp_path):
    moving = motion(position=AWKWARD)
    for form in FORMATS:
        moving.save(tmp_path / f"path.{form}")
        assert Motion.load(tmp_path / f"path.{form}").sha256 == moving.sha256
    assert motion().sha256 != moving.sha256


def snapshot(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("old", [None, b"of last week\n"])
@pytest.mark.parametrize("failure", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("form", FORMATS)
def test_a_write_that_fails_half_way_leaves_what_was_there(tmp_path, monkeypatch, form, old, failure):
    path = tmp_path / f"path.{form}"
    if old:
        path.write_bytes(old)
    before = snapshot(tmp_path)

    def half(_table, sink, *_):
        if hasattr(sink, "write"):
            sink.write(b"0,1")
        else:
            sink.write_bytes(b"PAR1")
        raise failure

    monkeypatch.setattr(pa.csv, "write_csv", half)
    monkeypatch.setattr(pa.parquet, "write_table", half)
    with pytest.raises(OutputError if isinstance(failure, OSError) else KeyboardInterrupt) as caught:
        motion().save(path)
    if isinstance(failure, OSError):
        assert str(caught.value) == f"{path}: output: No space left on device; allowed: a writable file"
    assert snapshot(tmp_path) == before


def test_the_old_file_stands_until_the_new_one_is_complete(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("old")
    with write_atomically(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.parent == tmp_path
    assert snapshot(tmp_path) == {"path.csv": b"new"}


def test_a_written_file_is_as_readable_as_any_other(tmp_path):
    plain = tmp_path / "plain"
    plain.write_text("")
    motion().save(tmp_path / "path.csv")
    modes = {stat.S_IMODE(path.stat().st_mode) for path in (plain, tmp_path / "path.csv")}
    assert len(modes) == 1


@pytest.mark.parametrize("name", ["nowhere/m.csv", "file/m.csv", "folder.csv", "m" * 300 + ".csv"])
def test_an_output_that_cannot_be_written_is_refused_in_one_line(tmp_path, name):
    (tmp_path / "file").write_text("in the way\n")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(OutputError, match=r"output: .*; allowed: ") as caught:
        motion().save(tmp_path / name)
    assert str(caught.value).isprintable()
    assert {path.name for path in tmp_path.iterdir()} == {"file", "folder.csv"}


@pytest.mark.parametrize("name", ["m.txt", "m", "m.csv.gz", ".csv"])
def test_another_suffix_is_refused(tmp_path, name):
    with pytest.raises(OutputError, match=r"output: .*; allowed: \.csv or \.parquet"):
        motion().save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_an_output_folder_is_made_where_its_parent_exists(tmp_path):
    (tmp_path / "file").write_text("in the way\n")
    assert output_folder(tmp_path / "new").is_dir()
    assert list((tmp_path / "new").iterdir()) == []
    for path in (tmp_path / "file", tmp_path / "file" / "x", tmp_path / "a" / "b", tmp_path / ("x" * 300)):
        with pytest.raises(OutputError, match=r"output: .*; allowed: "):
            output_folder(path)
    assert {path.name for path in tmp_path.iterdir()} == {"file", "new"}
