"""Reading input files with a bound, and writing output files in one step."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sixsps.errors import InputError, OutputError


def exists(path: Path) -> bool:
    """Returns whether `path` is there, as far as one may look; a name that no file can have is not."""
    try:
        return path.exists()
    except PermissionError:
        return True
    except (OSError, ValueError):
        return False


def check_readable(path: Path, place: str, error: Callable[..., InputError]) -> None:
    """Raises `error` unless `path` is a readable file with content."""
    source = str(path)
    if not exists(path):
        raise error(place, "no such file", "an existing file", source)
    try:
        if path.is_dir():
            raise error(place, "a directory", "a file", source)
        if path.is_file():  # a pipe is not to be opened twice
            if path.stat().st_size == 0:
                raise error(place, "an empty file", "a file with content", source)
            path.open("rb").close()
    except OSError as problem:
        raise error(place, _reason(problem), "a readable file", source) from None


def read_bytes(path: Path, place: str, error: Callable[..., InputError], largest: int) -> bytes:
    """Returns the content of `path`.

    Args:
        path: file to read.
        place: what the file is, for the message.
        error: class of the error that is raised.
        largest: number of bytes beyond which it is refused unread.

    Raises:
        InputError: as `error`, when it is missing, a directory, empty, unreadable or too large.
    """
    check_readable(path, place, error)
    with path.open("rb") as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise error(place, f"more than {largest} bytes", f"at most {largest} bytes", str(path))
    return content


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Yields a temporary path beside `path`, which takes its name when the block ends well.

    An interrupted or failing block leaves whatever stood at `path` before.

    Raises:
        OutputError: the folder does not exist or cannot be written.
    """
    source = str(path)
    if exists(path) and path.is_dir():
        raise OutputError("output", "a directory", "a file name", source)
    if not (exists(path.parent) and path.parent.is_dir()):
        raise OutputError("output", "its folder does not exist", "a file in an existing folder", source)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name[:40]}.", suffix=path.suffix, dir=path.parent)
    except (OSError, ValueError) as error:
        raise OutputError("output", _reason(error), "a writable folder", source) from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except (OSError, ValueError) as error:
        raise OutputError("output", _reason(error), "a writable file", source) from None
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_json(content: dict[str, Any], path: Path) -> Path:
    """Writes a file for people and machines to read, without NaN; returns its path.

    Raises:
        OutputError: it cannot be written.
    """
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    with write_atomically(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return path


def output_folder(path: Path) -> Path:
    """Returns `path` as a writable folder, made where its parent exists.

    Raises:
        OutputError: its parent does not exist, it is a file, or it cannot be written.
    """
    source = str(path)
    if exists(path) and not path.is_dir():
        raise OutputError("output", "a file", "a folder", source)
    if not exists(path) and not (exists(path.parent) and path.parent.is_dir()):
        raise OutputError("output", "its parent folder does not exist", "a folder in an existing one", source)
    try:
        path.mkdir(exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except (OSError, ValueError) as error:
        raise OutputError("output", _reason(error), "a writable folder", source) from None
    return path


@contextmanager
def filled_folder(path: Path) -> Iterator[Path]:
    """Yields `output_folder(path)`; takes it away again if it was made here and the block left it empty.

    Raises:
        OutputError: as `output_folder`.
    """
    there = exists(path)
    folder = output_folder(path)
    try:
        yield folder
    finally:
        if not there:
            with suppress(OSError):  # it is not empty
                folder.rmdir()


def _reason(error: OSError | ValueError) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
