"""The direction of imports, and what importing costs."""

import ast
import os
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
    "casadi": {
        *(str(path.relative_to(ROOT)) for path in (ROOT / "sixsps" / "symbolic").glob("*.py")),
        "sixsps/formulations/lagrange.py",
        "sixsps/kernels/graph.py",
    },
    "dartpy": {"compare/engines/dart.py"},
    "exudyn": {"compare/engines/exudyn.py", "compare/forward/exudyn.py"},
    "flint": {"sixsps/assembly/exact.py", "sixsps/certified.py"},
    "llvmlite": {"sixsps/kernels/emission.py"},
    "mujoco": {"compare/engines/mujoco.py", "compare/forward/mujoco.py", "compare/traps/mujoco.py"},
    "numba": {
        "sixsps/kernels/compiled.py",
        "sixsps/kernels/emission.py",
        "sixsps/machine_code.py",
    },
    "opensim": {"compare/engines/opensim.py"},
    "pinocchio": {
        "compare/engines/pinocchio.py",
        "compare/forward/pinocchio.py",
        "compare/payload/robot.py",
        "compare/payload/whole_tree.py",
        "compare/traps/pinocchio.py",
        "urdf/pinocchio_hexapod.py",
        "urdf/pinocchio_model.py",
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


def modules_after(statements, **environment):
    """Top-level packages that are there after statements in a process of their own."""
    code = f"import sys\n{statements}\nprint('\\n', *sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | environment
    )
    assert done.returncode == 0, done.stderr
    return {name.split(".")[0] for name in done.stdout.splitlines()[-1].split()}


COMPILERS = {"casadi", "numba", "llvmlite"}


def test_import_sixsps_alone_is_light():
    heavy = COMPILERS | {"pinocchio", "scipy", "pydantic", "pyarrow", "rich", "typer"}
    assert not modules_after("import sixsps") & heavy


HELP = """
from compare.cli import main
sys.argv = ["sixsps", "--help"]
try:
    main()
except SystemExit as end:
    assert not end.code
"""


@pytest.mark.parametrize("statements", ["import compare.cli", HELP], ids=["import", "help"])
def test_command_line_imports_nothing_heavy_before_it_works(statements):
    assert not modules_after(statements) & (COMPILERS | {"pinocchio", "scipy", "numpy", "pyarrow"})


FORCES = """
import sixsps
from sixsps.trajectories import bundled
mechanism = sixsps.Mechanism.load("wu2012")
assert sixsps.compile(mechanism).inverse_dynamics(bundled("line", mechanism, 5)).all()
"""


def test_machine_code_on_disk_needs_no_casadi(tmp_path):
    """The first run compiles, which takes the graph; those after it find the code that it left."""
    folder = {"NUMBA_CACHE_DIR": str(tmp_path)}
    assert modules_after(FORCES, **folder) >= COMPILERS
    left = sorted(path.name for path in tmp_path.rglob("*.nb*"))
    assert left
    assert "casadi" not in modules_after(FORCES, **folder)
    assert sorted(path.name for path in tmp_path.rglob("*.nb*")) == left


def test_import_urdf_does_without_pinocchio():
    assert "pinocchio" not in modules_after("import urdf")


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
