"""The C files: what they say, whatever a mechanism is called, and that they come out whole or not at all."""

import math
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from cases import BUNDLED, random_mechanism, random_motion
from hypothesis import given
from hypothesis import strategies as st

from compare.c_export import EXAMPLE, export_c, parameters_text
from sixsps import symbolic
from sixsps.errors import EngineError, OutputError
from sixsps.mechanism import Mechanism
from sixsps.parameters import PARAMETERS, parameter_vector
from sixsps.singularity import REGULAR_CONDITION, SINGULAR_CONDITION
from sixsps.symbolic import c_code
from sixsps.symbolic.c_header import PARAMETER_GROUPS, comment, parameter_ranges

FILES = ["example.c", "hexapod.c", "hexapod.h", "hexapod_parameters.h"]
COMMAND = [sys.executable, "-m", "compare", "export", "c"]
NAMES = [
    "*/ #error ended /*",
    "*/",
    "/*",
    "/*/",
    "**//**",
    "*??/",
    "??/",
    "????/",
    "*\\",
    "\\",
    "// \\",
    '" ??/" \' \\',
    "*" * 200,
    "*/" * 100,
    "%s {0} {name} %n",
    "Bühne 六足 🤖",
    "🤖" * 200,
    "#include <stdio.h>",
    "_Pragma(\"GCC error\")",
]  # fmt: skip


def code(text):
    """What a compiler of C99 sees: trigraphs replaced, lines joined, comments taken out."""
    text = text.replace("??/", "\\").replace("\\\n", "")
    return re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL).split()


def run_expressions(text, function, arguments):
    """Executes the expressions of one C function as Python; returns its values."""
    body = re.search(rf"void {function}_values\(.*?\n{{\n(.*?)\n}}", text, re.DOTALL).group(1)
    statements = [line.strip() for line in body.splitlines() if not line.strip().startswith("double ")]
    program = "\n".join(statement.removesuffix(";") for statement in statements)
    values = {}
    names = {"square": lambda x: x * x, "smaller": lambda x, y: y if y < x else x, "sqrt": math.sqrt}
    exec(program, names | arguments | {"values": values})
    return np.array([values[k] for k in range(len(values))])


@pytest.mark.parametrize("name", ["leg_forces", "leg_motion", "leg_force_derivatives"])
def test_the_expressions_are_those_of_the_model_to_the_last_bit(name):
    mechanism = random_mechanism(3)
    motion = random_motion(mechanism, 3, samples=1)
    fields = ("position", "quaternion", "velocity", "angular_velocity", "acceleration")
    fields += ("angular_acceleration", "force", "moment")
    given = {field: getattr(motion, field)[0].tolist() for field in fields}
    given["parameters"] = parameter_vector(mechanism).tolist()
    function = {"leg_forces": "forces", "leg_force_derivatives": "force_derivatives"}.get(name, name)
    expected = symbolic.evaluate(getattr(symbolic, function)(), mechanism, motion)
    found = run_expressions(c_code.source(derivatives=True), f"hexapod_{name}", given)
    assert np.array_equal(found, np.concatenate([value[0].ravel() for value in expected.values()]))


def test_derivatives_come_only_when_asked_for():
    for text in (c_code.source(), c_code.header()):
        assert "hexapod_leg_forces(" in text
        assert "hexapod_leg_motion(" in text
        assert "derivatives(" not in text
    for text in (c_code.source(derivatives=True), c_code.header(derivatives=True)):
        assert "int hexapod_leg_force_derivatives(" in text


def test_groups_of_parameters_cover_the_vector_in_order():
    ranges = parameter_ranges()
    assert [k for places in ranges.values() for k in places] == list(range(len(PARAMETERS)))
    for key, places in ranges.items():
        assert all(PARAMETERS[k].startswith(key) for k in places)
        span = f"{places[0]} to {places[-1]}" if len(places) > 1 else f"{places[0]}"
        assert f"{span}: {key}, {PARAMETER_GROUPS[key]}"[:60] in " ".join(c_code.header().split())


@pytest.mark.parametrize("name", BUNDLED)
def test_parameters_are_written_to_the_last_bit(name):
    mechanism = Mechanism.load(name)
    text = parameters_text(mechanism)
    (table,) = re.findall(r"= \{(.*?)\};", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL), re.DOTALL)
    found = [float(number) for number in table.split(",") if number.strip()]
    assert np.array_equal(found, parameter_vector(mechanism))
    assert mechanism.sha256 in text
    assert all(key in text for key in mechanism.assumed)


def test_every_file_says_what_wrote_it_and_is_plain_ascii(tmp_path):
    for path in export_c(replace(Mechanism.load("wu2012"), name="Bühne 六足"), tmp_path):
        text = path.read_bytes().decode("ascii")
        assert re.match(r"/\*\n \* (Leg forces.*\n \*\n \* )?Written by sixsps \S+ with CasADi \d\S+\.", text)
        assert all(len(line) < 120 for line in text.splitlines())
        assert not re.search(r"[^\x20-\x7e\n]|\?\?", text)


def test_functions_are_the_same_for_every_mechanism(tmp_path):
    texts = []
    for seed in (1, 2):
        export_c(random_mechanism(seed), tmp_path / str(seed))
        texts.append([(tmp_path / str(seed) / name).read_bytes() for name in FILES])
    assert [one == other for one, other in zip(*texts, strict=True)] == [False, True, True, False]


@pytest.mark.parametrize("name", NAMES)
def test_a_name_changes_nothing_but_a_comment(name):
    plain = Mechanism.load("wu2012")
    named = replace(plain, name=name, source=f"{name}\n*/ {name}", assumed={f"{name} */": name, "*": "/"})
    text = parameters_text(named)
    assert code(text) == code(parameters_text(plain))
    assert len(re.findall(r"\*/", text)) == len(re.findall(r"/\*", text)) == 8
    assert text.isascii()


@given(st.text(alphabet="*/?\\ \n", min_size=10) | st.text(alphabet="*/?\ta\r\0ä\u202e\ud800") | st.text())
def test_no_text_ends_a_comment(text):
    found = comment(text)
    assert code(found) == []
    assert found.count("*/") == found.count("/*") == 1
    assert "??" not in found
    assert found.isascii()


def test_two_runs_write_the_same_bytes(tmp_path):
    for folder in ("one", "two"):
        arguments = ["tsai2000", "--output", str(tmp_path / folder), "--derivatives"]
        process = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True)
        assert (process.returncode, process.stderr) == (0, "")
        paths = [str(tmp_path / folder / name) for name in FILES]
        assert sorted(process.stdout.split()) == paths
    for name in FILES:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_the_threshold_is_that_of_the_kernels_and_keeps_what_the_header_says():
    emission = pytest.importorskip("sixsps.kernels.emission")
    assert f"values[6] >= {emission._REGULAR:.0e}" in c_code.source()
    assert 2 * REGULAR_CONDITION == SINGULAR_CONDITION
    # regularity = det^2 5^5 / 12^6, and |det| >= cond^-5 where the largest singular value is at least 1.
    assert emission._REGULAR < 100.0**-10 * 5**5 / 12**6


def test_c_of_another_form_is_refused(monkeypatch):
    monkeypatch.setattr(c_code, "_WORDS", {"casadi_real": "double"})
    with pytest.raises(EngineError, match=r"CasADi \d.* does not know: casadi_fmin casadi_sq"):
        c_code.source()


def refused(*arguments):
    process = subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True)
    assert process.returncode == 2
    assert process.stdout == ""
    assert len(process.stderr.splitlines()) == 1
    return process.stderr


def test_a_folder_that_cannot_be_written_is_refused_in_one_line(tmp_path):
    (tmp_path / "file").write_text("mine\n")
    assert "output: a file; allowed: a folder" in refused("wu2012", "--output", tmp_path / "file")
    assert "parent folder does not exist" in refused("wu2012", "--output", tmp_path / "a" / "b")
    assert "no such file or bundled name" in refused("wu2013", "--output", tmp_path / "new")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_somebody_s_own_file_is_not_overwritten(tmp_path):
    (tmp_path / EXAMPLE).write_text("int main(void) { return 42; }\n")
    line = refused("wu2012", "--output", tmp_path)
    assert f"{tmp_path / EXAMPLE}: output: a file that sixsps has not written" in line
    assert [path.name for path in tmp_path.iterdir()] == [EXAMPLE]
    assert "42" in (tmp_path / EXAMPLE).read_text()


def test_the_command_s_own_files_are_replaced(tmp_path):
    export_c(replace(Mechanism.load("wu2012"), name="🤖" * 200), tmp_path)
    export_c(Mechanism.load("tsai2000"), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES
    assert "tsai2000" in (tmp_path / "hexapod_parameters.h").read_text()


@pytest.mark.parametrize("name", FILES)
def test_an_export_that_fails_half_way_leaves_nothing(tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(OutputError, match=name):
        export_c(Mechanism.load("wu2012"), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
