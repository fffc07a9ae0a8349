"""Without Pinocchio, with a broken one, and with another module of that name: one line each."""

import subprocess
import sys

import pytest

from compare import registry
from sixsps.errors import EngineUnavailable

STAR = """
import sys, urdf
from urdf import *
assert "pinocchio" not in sys.modules
assert hasattr(urdf, "load_pinocchio") and hasattr(urdf, "PinocchioHexapod")
assert all(getattr(urdf, name) is not None for name in urdf.__all__)
"""
LOAD = """
import sys, sixsps, urdf
mechanism = sixsps.Mechanism.load("wu2012")
for _ in range(2):
    try:
        urdf.load_pinocchio(mechanism)
    except sixsps.EngineUnavailable as error:
        print(error)
"""
HIDDEN = "import sys; sys.modules['pinocchio'] = None\n"


def run(code, folder=None):
    prefix = f"import sys; sys.path.insert(0, {str(folder)!r})\n" if folder else ""
    done = subprocess.run([sys.executable, "-c", prefix + code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize("code", [STAR, HIDDEN + STAR.replace('"pinocchio" not in sys.modules', "True")])
def test_all_names_are_there_without_pinocchio(code):
    run(code)


def test_import_urdf_is_light():
    loaded = run("import urdf, urdf.options, sys; print(*sys.modules)")[0].split()
    assert not {"numpy", "scipy", "xacro", "yaml", "pinocchio"} & set(loaded)


def test_a_missing_pinocchio_is_told_in_one_line():
    expected = "engine pinocchio is not available: package pin is not installed"
    assert run(HIDDEN + LOAD) == [expected] * 2


BROKEN = {
    "raise RuntimeError('libfoo.so.3 not found')": "package pin does not import: RuntimeError: libfoo",
    "x = 1": "pinocchio.py is not that of package pin, or is broken: ",
}


@pytest.mark.parametrize("content", BROKEN)
def test_a_broken_pinocchio_is_told_in_one_line(content, tmp_path):
    (tmp_path / "pinocchio.py").write_text(content)
    lines = run(LOAD, tmp_path)
    assert len(lines) == 2
    for line in lines:
        assert BROKEN[content] in line
    engine = """
from compare import registry
from sixsps.errors import EngineUnavailable
for name in ("pinocchio", "pinocchio-ball", "pinocchio-payload", "pinocchio-tree"):
    try:
        registry.load(name)
    except EngineUnavailable as error:
        print(error.broken, error)
"""
    lines = run(engine, tmp_path)
    assert len(lines) == 4
    for line in lines:
        assert line.startswith("True engine pinocchio")
        assert BROKEN[content] in line


@pytest.mark.parametrize("library", ["another_json", "another_json.part"])
def test_what_a_library_lacks_is_its_fault(monkeypatch, tmp_path, library):
    (tmp_path / "another_json").mkdir()
    (tmp_path / "another_json" / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    for number, text in enumerate(
        (
            "import another_json\nanother_json.Model",
            "from another_json import Model",
            f"import {library}.none",
        )
    ):
        (tmp_path / f"user{library[-4:]}{number}.py").write_text(text)
        entry = registry.Entry(f"user{library[-4:]}{number}", "User", "another_json", "json-pack")
        with pytest.raises(EngineUnavailable, match=r"another_json at .* is not that of package json-pack"):
            registry.load_entry("any", entry)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("import json\n''.nothing", AttributeError),
        ("import no_such_module", ImportError),
        ("1 / 0", ArithmeticError),
    ],
)
def test_what_a_user_of_a_library_does_wrong_is_not_hidden(monkeypatch, tmp_path, text, error):
    monkeypatch.syspath_prepend(tmp_path)
    name = f"faulty_{error.__name__}"
    (tmp_path / f"{name}.py").write_text(text)
    with pytest.raises(error):
        registry.load_entry("any", registry.Entry(name, "User", "json", "json-pack"))
