"""The direction of imports, and what importing costs."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("sixsps", "urdf", "compare")
FORBIDDEN = {"sixsps": {"urdf", "compare"}, "urdf": {"compare"}, "compare": set()}
# Library -> files that may import it.
# Every engine library in the file of its engine, and in that of the traps that are set in it.
HOMES = {
    "casadi": {"sixsps/symbolic.py", "sixsps/formulations/lagrange.py"},
    "dartpy": {"compare/engines/dart.py"},
    "exudyn": {"compare/engines/exudyn.py", "compare/forward/exudyn.py"},
    "flint": {"sixsps/certified.py"},
    "mujoco": {"compare/engines/mujoco.py", "compare/forward/mujoco.py", "compare/traps/mujoco.py"},
    "opensim": {"compare/engines/opensim.py"},
    "pinocchio": {
        "compare/engines/pinocchio.py",
        "compare/forward/pinocchio.py",
        "compare/traps/pinocchio.py",
    },
    "pydrake": {"compare/engines/drake.py", "compare/traps/drake.py"},
    "sympy": {"compare/engines/sympy.py"},
    "xacro": {"urdf/render.py"},
}


def files(room):
    return sorted((ROOT / room).rglob("*.py"))


def imported(path):
    """Top-level packages that a file imports anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return found


@pytest.mark.parametrize("room", ROOMS)
def test_arrows_between_rooms_point_one_way(room):
    for path in files(room):
        assert not imported(path) & FORBIDDEN[room], path


@pytest.mark.parametrize("library", HOMES)
def test_libraries_are_imported_in_their_own_file_only(library):
    users = {
        str(path.relative_to(ROOT)) for room in ROOMS for path in files(room) if library in imported(path)
    }
    assert users <= HOMES[library]


def modules_after(statement):
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in done.stdout.split()}


def test_import_sixsps_alone_is_light():
    heavy = {"casadi", "pinocchio", "numba", "scipy", "pydantic", "pyarrow", "rich", "typer"}
    assert not modules_after("import sixsps") & heavy


def test_command_line_imports_nothing_heavy_before_it_works():
    assert not modules_after("import compare.cli") & {"casadi", "pinocchio", "scipy", "numpy", "pyarrow"}


def test_everything_public_is_there():
    import sixsps

    for name in sixsps.__all__:
        assert getattr(sixsps, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'kaen'"):
        sixsps.kaen  # noqa: B018


def test_no_file_has_grown_past_its_job():
    for room in ROOMS:
        for path in files(room):
            assert len(path.read_text().splitlines()) <= 400, path
