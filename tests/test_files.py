"""Output files and folders: there whole or not at all, and refused in one line where none can be."""

import errno
import stat
from contextlib import suppress

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from cases import still
from texts import FORMATS

from sixsps.errors import OutputError
from sixsps.files import filled_folder, output_folder, write_atomically


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
        still().save(path)
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
    still().save(tmp_path / "path.csv")
    modes = {stat.S_IMODE(path.stat().st_mode) for path in (plain, tmp_path / "path.csv")}
    assert len(modes) == 1


@pytest.mark.parametrize("name", ["nowhere/m.csv", "file/m.csv", "folder.csv", "m" * 300 + ".csv"])
def test_an_output_that_cannot_be_written_is_refused_in_one_line(tmp_path, name):
    (tmp_path / "file").write_text("in the way\n")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(OutputError, match=r"output: .*; allowed: ") as caught:
        still().save(tmp_path / name)
    assert str(caught.value).isprintable()
    assert {path.name for path in tmp_path.iterdir()} == {"file", "folder.csv"}


@pytest.mark.parametrize("name", ["m.txt", "m", "m.csv.gz", ".csv"])
def test_another_suffix_is_refused(tmp_path, name):
    with pytest.raises(OutputError, match=r"output: .*; allowed: \.csv or \.parquet"):
        still().save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_an_output_folder_is_made_where_its_parent_exists(tmp_path):
    (tmp_path / "file").write_text("in the way\n")
    assert output_folder(tmp_path / "new").is_dir()
    assert list((tmp_path / "new").iterdir()) == []
    for path in (tmp_path / "file", tmp_path / "file" / "x", tmp_path / "a" / "b", tmp_path / ("x" * 300)):
        with pytest.raises(OutputError, match=r"output: .*; allowed: "):
            output_folder(path)
    assert {path.name for path in tmp_path.iterdir()} == {"file", "new"}


@pytest.mark.parametrize("failure", [None, ValueError(), KeyboardInterrupt()])
def test_a_folder_that_stays_empty_goes_again(tmp_path, failure):
    with suppress(ValueError, KeyboardInterrupt), filled_folder(tmp_path / "new") as folder:
        assert folder.is_dir()
        if failure:
            raise failure
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_something_in_it_or_that_was_there_stays(tmp_path):
    (tmp_path / "old").mkdir()
    for name in ("old", "new"):
        with suppress(ValueError), filled_folder(tmp_path / name) as folder:
            if name == "new":
                (folder / "part").write_text("kept")
            raise ValueError
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")} == {"old", "new", "new/part"}
