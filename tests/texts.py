"""Files that tests start from: a mechanism in YAML, a motion in a table, and what refuses them."""

import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from sixsps.errors import MechanismError, MotionError
from sixsps.mechanism_file import parse
from sixsps.motion import Motion

MECHANISM = """\
name: bench
gravity: [0, 0, -9.81]
base:
  anchors:
    - [0.24, -0.06, 0]
    - [0.24, 0.06, 0]
    - [-0.06, 0.24, 0]
    - [-0.18, 0.18, 0]
    - [-0.18, -0.18, 0]
    - [-0.06, -0.24, 0]
platform:
  anchors:
    - [0.07, -0.07, 0]
    - [0.07, 0.07, 0]
    - [0.03, 0.1, 0]
    - [-0.1, 0.03, 0]
    - [-0.1, -0.03, 0]
    - [0.03, -0.1, 0]
  mass: 1.25
  inertia: {xx: 0.0025, yy: 0.0025, zz: 0.005}
legs:
  lower: {mass: 0.5, length: 0.45, inertia: {transverse: 0.008, axial: 1e-4}}
  upper: {mass: 0.3, length: 0.4, inertia: {transverse: 0.004, axial: 2e-5}}
"""

TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
ACCELERATIONS = ("ax", "ay", "az", "ex", "ey", "ez")
FORMATS = ("csv", "parquet")
AWKWARD = np.array(
    [
        [5e-324, -0.0, 9.999999999999999e49],
        [0.1 + 0.2, 1 / 3, -2.2250738585072014e-308],
        [2**53 + 2.0, 1e22, 123456789.12345679],
        [1e-5, 1e16, 9007199254740993.0],
    ]
)


def edited(old, new, text=MECHANISM):
    assert text.count(old) == 1, old
    return text.replace(old, new)


def line_of(words, text):
    return next(number for number, line in enumerate(text.splitlines(), 1) if words in line)


def read(text):
    return parse(text if isinstance(text, bytes) else text.encode(), "bench.yaml")


BENCH = read(MECHANISM)


def mechanism_refusal(text):
    """Returns the message with which `text` is refused, one printable line that names the file."""
    with pytest.raises(MechanismError) as caught:
        read(text)
    return _one_line(caught.value, "bench.yaml:")


def motion_refusal(path, **options):
    """Returns the message with which a file is refused, one printable line, without the file's name."""
    with pytest.raises(MotionError) as caught:
        Motion.load(path, **options)
    return _one_line(caught.value, f"{path}: ").removeprefix(f"{path}: ")


def _one_line(error, start):
    message = str(error)
    assert message.isprintable(), message
    assert message.startswith(start), message
    assert "; allowed: " in message, message
    return message


def loaded_or_refused(path, **options):
    """Returns the motion in a file and nothing, or nothing and the message that refuses it."""
    try:
        return Motion.load(path, **options), None
    except MotionError as error:
        return None, str(error)


def table(n=8, **columns):
    """Columns of a motion at rest; a column given as None is left out."""
    rest = dict.fromkeys((*TWIST, *ACCELERATIONS), np.zeros(n))
    content = {"t": np.arange(n) / 10, "x": np.zeros(n), "y": np.ones(n), "z": np.linspace(1, 2, n)} | rest
    return {name: values for name, values in (content | columns).items() if values is not None}


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


def row(number, form):
    """How a message names a row: data rows count from 1, the header is line 1 of a CSV file."""
    return f"row {number} (line {number + 1})" if form == "csv" else f"row {number}"


def numbered(message, form):
    """A Parquet file has no lines; whether a message counts them all the same is left open."""
    return re.sub(r" \(line \d+\)", "", message) if form == "parquet" else message


def damaged(content, number, seed=6):
    """Copies of a file's bytes, three of which are changed in each, one in ten cut short."""
    rng = np.random.default_rng(seed)
    for _ in range(number):
        copy = bytearray(content[: rng.integers(8, len(content))] if rng.random() < 0.1 else content)
        for place in rng.integers(0, len(copy), 3):
            copy[place] = rng.integers(256)
        yield bytes(copy)
