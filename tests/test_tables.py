"""Tables in CSV and Parquet: layouts, cells and rows, read exactly or refused with the place at fault."""

import math
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from cases import still
from numpy.testing import assert_array_equal
from texts import (
    ACCELERATIONS,
    AWKWARD,
    FORMATS,
    TWIST,
    damaged,
    loaded_or_refused,
    motion_refusal,
    numbered,
    put,
    row,
    table,
)

from sixsps.errors import MotionError
from sixsps.motion import Motion
from sixsps.tables import write_table

HEADER = ",".join(("t", "x", "y", "z", *TWIST, *ACCELERATIONS))
REST = ",0" * 12
ROWS = ("0,1,2,3", "0.5,1,2,3", "1,1.5,2,3")
GOOD = "\n".join([HEADER, *(row + REST for row in ROWS)]) + "\n"


def text(folder, content):
    path = folder / "path.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def csv(folder, *rows, header=HEADER):
    """A CSV file at rest whose rows start as in `rows`."""
    return text(folder, "\n".join([header, *(row + REST for row in rows)]) + "\n")


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
    message = numbered(motion_refusal(put(tmp_path, table(8, **{name: values}), form)), form)
    assert message.startswith(f"{name}, {row(5, form)}: {value}; allowed: a finite number")


@pytest.mark.parametrize("form", FORMATS)
def test_an_empty_cell_is_refused_with_its_row(tmp_path, form):
    path = put(tmp_path, table(8, vx=[1.0, 2.0, None, 4.0, None, 6.0, 7.0, 8.0]), form)
    message = numbered(motion_refusal(path), form)
    assert message.startswith(f"vx, {row(3, form)}: an empty cell; allowed: a finite number")


@pytest.mark.parametrize(
    "cell", ["high", "1,5", "0x10", "1_0", "1e", "--1", "NA", "null", "None", "٣", "1 2", " "]
)
def test_a_cell_that_is_no_number_is_refused_with_its_row_and_column(tmp_path, cell):
    message = motion_refusal(csv(tmp_path, ROWS[0], f'0.5,"{cell}",2,3', ROWS[2]))
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
    message = motion_refusal(path)
    assert message.startswith("x, row 3 ")
    assert "(line 6)" in message


def test_an_empty_line_before_the_header_does_not_hide_the_row(tmp_path):
    path = csv(tmp_path, ROWS[0], "0.5,high,2,3")
    path.write_text("\n" + path.read_text())
    assert motion_refusal(path).startswith("x, row 2 ")


def test_a_column_that_stands_twice_is_refused(tmp_path):
    path = text(tmp_path, GOOD.replace("t,x,y,z", "t,x,x,z"))
    assert motion_refusal(path) == "column: x twice; allowed: each column once"
    columns = table(4)
    twice = pa.Table.from_arrays([pa.array(v) for v in columns.values()], ["t", "x", "x", *list(columns)[3:]])
    path = tmp_path / "path.parquet"
    pa.parquet.write_table(twice, path)
    assert "x" in motion_refusal(path)


@pytest.mark.parametrize("name", ["two\nlines", "\x1b[31m", "größe", "q" * 5000])
@pytest.mark.parametrize("form", FORMATS)
def test_a_strange_column_name_gives_one_printable_line(tmp_path, form, name):
    column = f'"{name}"' if form == "csv" else name
    message = motion_refusal(put(tmp_path, table(8) | {column: np.zeros(8)}, form))
    assert message.startswith("column: ")
    assert len(message) < 500


def test_a_parquet_column_name_that_is_no_text_is_refused(tmp_path):
    path = put(tmp_path, table(8, pressure=np.zeros(8)), "parquet")
    path.write_bytes(path.read_bytes().replace(b"pressure", b"pres\xff\xfere"))
    motion_refusal(path)


@pytest.mark.parametrize("n", [0, 1])
@pytest.mark.parametrize("form", FORMATS)
def test_fewer_than_two_rows_are_refused(tmp_path, form, n):
    assert motion_refusal(put(tmp_path, table(n), form)) == f"rows: {n}; allowed: at least 2 samples"


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
    message = motion_refusal(path)
    assert "list index" not in message
    path.rename(path.with_suffix(".parquet"))
    motion_refusal(path.with_suffix(".parquet"))


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="this system does not name open files")
def test_a_pipe_is_read_or_refused():
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as pipe:
        pipe.write(GOOD)
    loaded, refused = loaded_or_refused(f"/dev/fd/{reading}")
    os.close(reading)
    assert refused or len(loaded) == 3


def test_a_ragged_row_is_named(tmp_path):
    message = motion_refusal(text(tmp_path, GOOD.replace("0.5,1,2,3" + REST, "0.5,1,2")))
    assert message == "row 2 (line 3): 3 cells; allowed: 16 as in the header"


def test_a_header_without_a_line_end_is_a_table_without_rows(tmp_path):
    assert motion_refusal(text(tmp_path, HEADER)) == "rows: 0; allowed: at least 2 samples"


PARQUET_COLUMNS = {
    "text": ["1"] * 8,
    "booleans": [True] * 8,
    "nothing": [None] * 8,
    "lists": [[1.0]] * 8,
    "dates": np.arange(8).astype("M8[s]"),
}


@pytest.mark.parametrize("values", PARQUET_COLUMNS.values(), ids=PARQUET_COLUMNS)
def test_parquet_columns_that_are_no_numbers_are_refused(tmp_path, values):
    message = motion_refusal(put(tmp_path, table(8, x=values), "parquet"))
    assert message.startswith("column x: ")


def test_a_damaged_parquet_file_never_ends_in_another_error(tmp_path):
    still(20, force=np.random.default_rng(5).standard_normal((20, 3))).save(tmp_path / "good.parquet")
    good = (tmp_path / "good.parquet").read_bytes()
    path = tmp_path / "bad.parquet"
    refused = 0
    for content in damaged(good, 300):
        path.write_bytes(content)
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
