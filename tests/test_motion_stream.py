"""Motion files in blocks: the same bits, and refusals in the same words, as when read at once."""

import math

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from cases import FIELDS, random_mechanism, random_motion
from scipy.spatial.transform import Rotation
from texts import ACCELERATIONS, FORMATS, TWIST, damaged, motion_refusal, put, table

from sixsps import table_stream
from sixsps.errors import MotionError, OutputError
from sixsps.motion import Motion
from sixsps.motion_stream import open_motion
from sixsps.table_stream import row_count, writing

QUATERNION = ("qw", "qx", "qy", "qz")
EULER = ("alpha", "beta", "gamma")
ROWS = 40
SIZES = (1, 2, 7, 13, 39, 40, 100)


@pytest.fixture(autouse=True)
def small_reads(monkeypatch):
    """Few rows of a CSV file are read at once, so that a small file has many blocks."""
    monkeypatch.setattr(table_stream, "_CSV_BLOCK_BYTES", 2500)


def blocks(path, size):
    return [block() for block in open_motion(path).blocks(size)]


def refusal(path, size):
    """Returns the message with which a file is refused, in whichever block, without the file's name."""
    with pytest.raises(MotionError) as caught:
        blocks(path, size)
    message = str(caught.value)
    assert message.isprintable()
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def message_or_nothing(path):
    try:
        blocks(path, 7)
    except MotionError as error:
        return str(error)
    return None


def some(n=ROWS, **columns):
    """Columns of a motion whose numbers are all different; a column given as None is left out."""
    rng = np.random.default_rng(n)
    given = {name: rng.standard_normal(n) for name in ("x", "y", "z", *TWIST, *ACCELERATIONS)}
    return table(n, **given | columns)


def with_cell(name, row, value, **columns):
    content = some(**columns)
    values = np.asarray(content[name], dtype=object).copy()
    values[row] = value
    return content | {name: values.tolist()}


class TestBlocks:
    @pytest.mark.parametrize("size", SIZES)
    @pytest.mark.parametrize("form", FORMATS)
    def test_are_the_motion_bit_for_bit(self, tmp_path, form, size):
        path = tmp_path / f"path.{form}"
        mechanism = random_mechanism(1)
        random_motion(mechanism, 1, ROWS).save(path)
        whole, parts = Motion.load(path), blocks(path, size)
        assert sum(map(len, parts)) == ROWS
        for name in FIELDS:
            assert (
                np.concatenate([getattr(part, name) for part in parts]).tobytes()
                == getattr(whole, name).tobytes()
            )
        assert all(not part.estimated and part.name == whole.name for part in parts)

    @pytest.mark.parametrize("row_group", [1, 3, 16, 1000])
    @pytest.mark.parametrize("size", [1, 5, 16, 40])
    def test_of_parquet_have_the_size_that_was_asked_for_whatever_the_row_groups(
        self, tmp_path, size, row_group
    ):
        path = tmp_path / "path.parquet"
        pa.parquet.write_table(pa.table(some()), path, row_group_size=row_group)
        lengths = [len(block) for block in blocks(path, size)]
        assert lengths == [size] * (ROWS // size) + [ROWS % size] * (ROWS % size > 0)

    def test_longer_than_what_is_read_at_once(self, tmp_path, monkeypatch):
        monkeypatch.setattr(table_stream, "_MOST_READ", 4)
        assert [len(block) for block in blocks(put(tmp_path, some(), "parquet"), 18)] == [20, 20]

    def test_of_csv_are_many(self, tmp_path):
        assert len(blocks(put(tmp_path, some()), 1)) > 4

    @pytest.mark.parametrize("form", FORMATS)
    @pytest.mark.parametrize("size", [7, 40])
    def test_with_euler_angles(self, tmp_path, form, size):
        angles = np.random.default_rng(0).uniform(-4, 4, (ROWS, 3))
        path = put(tmp_path, some(**dict(zip(EULER, angles.T, strict=True))), form)
        found = np.concatenate([block.quaternion for block in blocks(path, size)])
        assert found.tobytes() == Motion.load(path).quaternion.tobytes()

    def test_with_integers_and_single_precision(self, tmp_path):
        columns = some(t=np.arange(ROWS), x=np.arange(ROWS, dtype="i2"), y=np.full(ROWS, 0.1, dtype="f4"))
        path = put(tmp_path, columns, "parquet")
        found = np.concatenate([block.position for block in blocks(path, 7)])
        assert found.tobytes() == Motion.load(path).position.tobytes()

    def test_say_how_many_samples_there_are_where_the_file_does(self, tmp_path):
        assert open_motion(put(tmp_path, some(), "parquet")).samples == ROWS
        assert open_motion(put(tmp_path, some(), "csv")).samples is None

    @pytest.mark.parametrize("form", FORMATS)
    @pytest.mark.parametrize("missing", [TWIST, ACCELERATIONS, TWIST + ACCELERATIONS])
    def test_are_not_given_where_derivatives_have_to_be_estimated(self, tmp_path, form, missing):
        assert open_motion(put(tmp_path, some(**dict.fromkeys(missing)), form)) is None


# First row, rows in the middle, and the last; blocks of 7 and 13 rows end beside some of them.
@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("row", [0, 6, 7, 13, 39])
class TestABadRow:
    @pytest.mark.parametrize("value", [math.nan, math.inf, -1.1e50, None])
    @pytest.mark.parametrize("name", ["t", "ez"])
    def test_is_named_with_its_value(self, tmp_path, form, row, value, name):
        path = put(tmp_path, with_cell(name, row, value), form)
        for size in SIZES:
            assert refusal(path, size) == motion_refusal(path)

    def test_that_is_no_number_is_named(self, tmp_path, form, row):
        path = put(tmp_path, with_cell("vy", row, "high"), "csv")
        for size in SIZES:
            assert refusal(path, size) == motion_refusal(path)

    def test_with_a_quaternion_off_unit_length_is_named(self, tmp_path, form, row):
        turns = Rotation.random(ROWS, rng=3).as_quat(scalar_first=True)
        turns[row] *= 1.002
        path = put(tmp_path, some(**dict(zip(QUATERNION, turns.T, strict=True))), form)
        for size in SIZES:
            assert refusal(path, size) == motion_refusal(path)

    @pytest.mark.parametrize("step", [0.0, -1e-9, -100.0])
    def test_whose_time_does_not_increase_is_named_on_any_side_of_a_border(self, tmp_path, form, row, step):
        time = np.arange(ROWS) / 7
        if row:
            time[row] = time[row - 1] + step
        else:
            time[1] = time[0] + step
        path = put(tmp_path, some(t=time), form)
        assert f"row {max(row, 1) + 1}" in motion_refusal(path)
        for size in SIZES:
            assert refusal(path, size) == motion_refusal(path)


def test_of_two_bad_rows_the_first_block_s_is_named(tmp_path):
    columns = with_cell("x", 30, math.nan) | {"ez": with_cell("ez", 5, math.nan)["ez"]}
    path = put(tmp_path, columns, "parquet")
    assert refusal(path, 7).startswith("ez, row 6: nan")
    assert refusal(path, 40) == motion_refusal(path)


def test_empty_lines_do_not_shift_the_rows_of_later_blocks(tmp_path):
    path = put(tmp_path, with_cell("vy", 35, math.nan))
    lines = path.read_text().splitlines()
    path.write_text("\n\n" + "\n\n".join(lines) + "\n")
    assert refusal(path, 1) == motion_refusal(path)
    assert "vy, row 36 (line " in motion_refusal(path)


def test_a_ragged_row_is_named_in_whichever_block(tmp_path):
    path = put(tmp_path, some())
    lines = path.read_text().splitlines()
    lines[30] = "1,2,3"
    path.write_text("\n".join(lines))
    assert refusal(path, 1) == motion_refusal(path)


COLUMNS = {
    "no time": some(t=None),
    "no position": some(x=None, y=None, z=None),
    "half a position": some(y=None),
    "half a twist": some(wy=None),
    "no acceleration about z": some(ez=None),
    "half a quaternion": some(qw=np.ones(ROWS)),
    "half a wrench": some(mx=np.ones(ROWS)),
    "an unknown column": some(speed=np.ones(ROWS)),
    "two orientations": some(**dict.fromkeys((*QUATERNION, *EULER), np.full(ROWS, 0.5))),
    "no rows": some(0),
    "one row": some(1),
}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("columns", COLUMNS.values(), ids=COLUMNS)
def test_what_is_no_motion_is_refused_in_the_same_words(tmp_path, form, columns):
    path = put(tmp_path, columns, form)
    assert refusal(path, 7) == motion_refusal(path)


@pytest.mark.parametrize(
    "values", [["1"] * ROWS, [True] * ROWS, [None] * ROWS, np.arange(ROWS).astype("M8[s]")]
)
def test_a_column_that_is_no_numbers_is_refused_in_the_same_words(tmp_path, values):
    path = put(tmp_path, some(x=values), "parquet")
    assert refusal(path, 7) == motion_refusal(path)


def test_a_column_that_stands_twice_is_refused(tmp_path):
    columns = some()
    path = tmp_path / "path.parquet"
    names = ["t", "x", "x", *list(columns)[3:]]
    pa.parquet.write_table(pa.Table.from_arrays([pa.array(v) for v in columns.values()], names), path)
    assert refusal(path, 7) == motion_refusal(path)


@pytest.mark.parametrize(
    "content",
    [b"", b"\n\n\n", b"PAR1", bytes(range(256)) * 20, ",".join(some()).encode(), b"h\xf6he\n1\n2\n"],
)
@pytest.mark.parametrize("form", FORMATS)
def test_what_is_no_table_is_refused_as_when_read_at_once(tmp_path, form, content):
    path = tmp_path / f"path.{form}"
    path.write_bytes(content)
    assert refusal(path, 7) == motion_refusal(path)


def test_a_damaged_parquet_file_never_ends_in_another_error(tmp_path):
    good = put(tmp_path, some(), "parquet").read_bytes()
    path = tmp_path / "bad.parquet"
    refused = 0
    for content in damaged(good, 300):
        path.write_bytes(content)
        message = message_or_nothing(path)
        if message:
            refused += 1
            assert message.isprintable()
    assert refused > 30


@pytest.mark.parametrize("form", FORMATS)
def test_rows_are_counted_or_estimated_without_reading_them(tmp_path, form):
    path = put(tmp_path, some(500), form)
    rows, exact = row_count(path)
    assert exact == (form == "parquet")
    # of CSV from the six rows and a part of one that are read here
    assert rows == 500 if exact else abs(rows - 500) < 500 / 6


class TestWriting:
    @pytest.mark.parametrize("form", FORMATS)
    @pytest.mark.parametrize("size", [1, 7, 100])
    def test_in_pieces_gives_what_was_given(self, tmp_path, monkeypatch, form, size):
        monkeypatch.setattr(table_stream, "_ROW_GROUP", 16)
        values = np.random.default_rng(0).standard_normal((50, 2))
        values[17, 1] = math.nan
        path = tmp_path / f"out.{form}"
        with writing(path, ["t", "f"]) as append:
            for part in np.split(values, range(size, 50, size)):
                append({"f": part[:, 1], "t": part[:, 0]})
            assert not path.exists()
        if form == "parquet":
            found = np.column_stack([column.to_numpy() for column in pa.parquet.read_table(path).columns])
        else:
            assert path.read_text().startswith("t,f\n")
            found = np.genfromtxt(path, delimiter=",", skip_header=1)
        np.testing.assert_array_equal(found, values)
        assert [file.name for file in tmp_path.iterdir()] == [path.name]

    @pytest.mark.parametrize("form", FORMATS)
    def test_nothing_gives_a_table_without_rows(self, tmp_path, form):
        path = tmp_path / f"out.{form}"
        with writing(path, ["t", "f"]):
            pass
        assert path.read_text() == "t,f\n" if form == "csv" else pa.parquet.read_table(path).num_rows == 0

    @pytest.mark.parametrize("form", FORMATS)
    @pytest.mark.parametrize("problem", [KeyboardInterrupt(), OSError(28, "disk full"), RuntimeError()])
    def test_what_ends_half_way_leaves_what_was_there(self, tmp_path, monkeypatch, form, problem):
        monkeypatch.setattr(table_stream, "_ROW_GROUP", 16)
        path = tmp_path / f"out.{form}"
        path.write_text("precious")

        def write():
            with writing(path, ["t"]) as append:
                append({"t": np.zeros(100)})
                raise problem

        with pytest.raises(OutputError if isinstance(problem, OSError) else type(problem)):
            write()
        assert path.read_text() == "precious"
        assert [file.name for file in tmp_path.iterdir()] == [path.name]

    def test_another_suffix_is_refused(self, tmp_path):
        with pytest.raises(OutputError, match=r"\.csv or \.parquet"), writing(tmp_path / "out.xlsx", ["t"]):
            pass
