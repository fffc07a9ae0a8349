"""`sixsps workspace`: what it writes, prints and refuses."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pyarrow.parquet as pq
import pytest
from terminals import on_terminal
from texts import MECHANISM

from compare import workspace_figures
from compare.workspace import facts, table, write_cells
from sixsps.mechanism import Mechanism
from sixsps.workspace import constant_orientation_workspace, orientation_workspace

FILES = {"workspace.json", "workspace.parquet", "workspace.svg", "workspace.png"}
WITHOUT_MATPLOTLIB = """
import sys
sys.modules["matplotlib"] = None
sys.modules["matplotlib.figure"] = None
from compare.cli import main
sys.argv = ["sixsps", *{arguments!r}]
main()
"""


def command(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "compare", "workspace", *map(str, arguments)],
        capture_output=True,
        text=True,
        **options,
    )


@pytest.fixture(scope="module")
def pair():
    """Both workspaces, roughly."""
    mechanism = Mechanism.load("tsai2000")
    searches = (constant_orientation_workspace, orientation_workspace)
    return [search(mechanism, tolerance=0.2) for search in searches]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workspace")
    return folder, command("tsai2000", "--tolerance", 0.2, "--output", "out", cwd=folder)


class TestBoth:
    def test_ends_well_and_writes_all(self, done):
        folder, result = done
        assert (result.returncode, result.stderr) == (0, "")
        names = {path.name for path in (folder / "out").iterdir()}
        assert FILES - names <= {"workspace.svg", "workspace.png"}  # with matplotlib
        assert names <= FILES
        assert "written: out (workspace.json, workspace.parquet" in result.stdout

    def test_table_fits_80_columns_and_says_what_the_file_says(self, done, pair):
        folder, result = done
        assert "\x1b" not in result.stdout
        lines = result.stdout.splitlines()
        assert max(map(len, lines[:-1])) <= 80
        content = json.loads((folder / "out" / "workspace.json").read_text())["workspaces"]
        shown = re.findall(r"volume  (\S+) to (\S+) (m|rad)\^3", result.stdout)
        for (lower, upper, unit), workspace in zip(shown, pair, strict=True):
            bounds = content[workspace.kind][f"volume_{unit}3"]
            assert bounds == list(workspace.volume)
            assert [float(lower), float(upper)] == pytest.approx(bounds, rel=1e-5)

    def test_file_has_settings_versions_and_figures(self, done):
        folder, _ = done
        content = json.loads((folder / "out" / "workspace.json").read_text())
        assert content["command"] == "sixsps workspace tsai2000 --tolerance 0.2 --output out"
        assert content["settings"] == {"tolerance_rel": 0.2, "cells": 300_000, "singularity": True}
        assert {"python", "numpy", "sixsps"} <= set(content["versions"])
        assert content["mechanism"]["sha256"] == Mechanism.load("tsai2000").sha256
        assert len(content["workspaces"]["orientation"]["tilts"]) == 36
        assert [one["axis"] for one in content["workspaces"]["orientation"]["ranges"]] == [
            "roll",
            "pitch",
            "yaw",
        ]
        for entry in content["workspaces"].values():
            assert entry["converged"]
            assert 0 < entry["gap_rel"] <= 0.2

    def test_cells_add_up_to_the_volume(self, done):
        folder, _ = done
        cells = pq.read_table(folder / "out" / "workspace.parquet").to_pydict()
        content = json.loads((folder / "out" / "workspace.json").read_text())["workspaces"]
        columns = {name: np.array(values) for name, values in cells.items()}
        for kind, unit in (("translation", "m"), ("orientation", "rad")):
            here = columns["kind"] == kind
            lower = columns["lower"][here & columns["proven"]].sum()
            upper = columns["upper"][here & (columns["part"] == 0)].sum()
            assert [lower, upper] == pytest.approx(content[kind][f"volume_{unit}3"], rel=1e-12)
            assert set(columns["state"][here]) == {"inside", "boundary", "outside"}
            assert set(columns["limit"][here & (columns["state"] == "inside")]) == {""}
            assert set(columns["limit"][here & (columns["state"] != "inside")]) <= set(
                content[kind]["limits"]
            )
        # Centres are positions in the world.
        inside = (columns["kind"] == "translation") & (columns["state"] == "inside")
        assert columns["c3"][inside].min() > 0.3
        assert columns["c1"][inside].max() < -0.3


class TestOptions:
    def test_one_kind_at_another_pose_without_matplotlib(self, tmp_path):
        arguments = [
            "workspace",
            "tsai2000",
            "--kind",
            "orientation",
            "--position=-1.4,0,1.5",
            "--orientation",
        ]
        arguments += [
            "0.1,0,-0.2",
            "--no-singularity",
            "--tolerance",
            "0.3",
            "--output",
            str(tmp_path / "out"),
        ]
        code = WITHOUT_MATPLOTLIB.format(arguments=arguments)
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert result.returncode == 0
        assert result.stderr == 'sixsps: no picture without matplotlib: pip install "sixsps[figures]"\n'
        assert {path.name for path in (tmp_path / "out").iterdir()} == {"workspace.json", "workspace.parquet"}
        content = json.loads((tmp_path / "out" / "workspace.json").read_text())
        assert list(content["workspaces"]) == ["orientation"]
        assert content["reference_pose"]["position_m"] == [-1.4, 0, 1.5]
        assert content["reference_pose"]["euler_rad"] == pytest.approx([0.1, 0, -0.2], abs=1e-15)
        assert "singularity" not in content["workspaces"]["orientation"]["limits"]

    def test_progress_on_a_terminal(self, tmp_path):
        options = ["--kind", "translation", "--tolerance", "0.3", "--output", str(tmp_path / "out")]
        written, shown = on_terminal([sys.executable, "-m", "compare", "workspace", "tsai2000", *options])
        assert b"translation" in shown
        assert written.startswith(b"tsai2000: positions")

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["dietmaier1998"], r"length_limits: missing; allowed: shortest and longest length of every leg"),
            (["wu2012", "--tolerance", "0"], r"--tolerance: 0\.0; allowed: "),
            (["wu2012", "--cells", "10"], r"--cells: 10; allowed: "),
            (["wu2012", "--position", "1,2"], r"--position: 1,2; allowed: 3 finite numbers"),
            (["wu2012", "--orientation", "a,b,c"], r"--orientation: a,b,c; allowed: 3 finite numbers"),
            (["wu2012", "--kind", "all"], r"--kind.*translation"),
            (["no-such-mechanism"], r"no-such-mechanism"),
        ],
    )
    def test_bad_input_is_one_line_and_leaves_nothing(self, arguments, message, tmp_path):
        result = command(*arguments, "--output", tmp_path / "out")
        assert result.returncode == 2
        assert result.stdout == ""
        assert len(result.stderr.splitlines()) == 1
        assert re.search(message, result.stderr)
        assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())

    def test_a_home_that_breaks_a_limit(self, tmp_path):
        path = tmp_path / "cramped.yaml"
        path.write_text(MECHANISM + "limits: {clearance: 0.3}\n")
        result = command(path, "--output", tmp_path / "out")
        assert result.returncode == 1
        assert re.fullmatch(
            r"sixsps: no workspace: the reference pose at .* breaks a limit: leg-leg distance of leg "
            r"\d-\d is 0\.\d+ m, limit 0\.3 \(and \d+ more\)\n",
            result.stderr,
        )
        assert result.stdout == ""
        assert not (tmp_path / "out").exists()


def test_a_spent_budget_is_told(pair, tmp_path):
    workspace = constant_orientation_workspace(pair[0].mechanism, cells=2000, tolerance=1e-4)
    text = table(workspace)
    assert f"NOT within the 0.01% asked for, after {workspace.judged} cells, see --cells" in text
    assert max(map(len, text.splitlines())) <= 80
    entry = facts([workspace], "", 2000, True)["workspaces"]["translation"]
    assert entry["converged"] is False
    rows = pq.read_table(write_cells([workspace], tmp_path))
    assert rows.num_rows == len(workspace.cells)


class TestPicture:
    @pytest.fixture(autouse=True)
    def _needs_matplotlib(self):
        pytest.importorskip("matplotlib")

    def test_legend_names_what_bounds_the_sections(self, pair, tmp_path):
        svg, png = workspace_figures.write_figures(pair, tmp_path)
        words = [element.text for element in ET.parse(svg).iter() if element.tag.endswith("text")]
        assert {"x [m]", "z [m]", "r_x [rad]", "singularity", "leg 1 longest", "leg 2 shortest"} <= set(words)
        # Without joint limits there is nothing of them to be drawn.
        assert not [word for word in words if word and "cone" in word]
        assert png.read_bytes().startswith(b"\x89PNG")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["workspace.png", "workspace.svg"]

    def test_same_data_same_bytes(self, pair, tmp_path):
        first = workspace_figures.write_figures(pair[:1], tmp_path)[0].read_bytes()
        assert workspace_figures.write_figures(pair[:1], tmp_path)[0].read_bytes() == first

    def test_pieces_of_the_surface_lie_on_it(self, pair):
        for workspace in pair:
            centre, half, limit = workspace_figures._pieces(workspace)
            foot, normal, kept = workspace_figures._feet(workspace, centre, half, limit)
            assert kept.mean() > 0.5
            assert np.linalg.norm(normal, axis=1)[kept] == pytest.approx(1)
            ahead = workspace.margins(foot + 0.5 * half[:, None] * normal)
            behind = workspace.margins(foot - 0.5 * half[:, None] * normal)
            rows = np.flatnonzero(kept)
            crossed = (ahead[rows, limit[rows]] > 0) & (behind[rows, limit[rows]] < 0)
            assert crossed.mean() > 0.95

    def test_nothing_bounds_a_workspace_of_all_orientations(self, tmp_path):
        drawn = Mechanism.load("tsai2000")
        free = Mechanism.geometry("free", drawn.base_anchors, drawn.platform_anchors, (0, 100))
        workspace = orientation_workspace(free, [0, 0, 3.0], tolerance=0.3, singularity=False)
        assert len(workspace_figures._pieces(workspace)[0]) == 0
        assert len(workspace_figures.write_figures([workspace], tmp_path)) == 2

    def test_every_limit_has_a_style_of_its_own(self):
        joints = ("shortest", "longest", "base cone", "platform cone")
        names = [f"leg {leg} {what}" for leg in range(1, 7) for what in joints]
        names += ["legs 1-4 clearance", "singularity", "half turn"]
        assert len({workspace_figures.style_of(name) for name in names}) == len(names)


def test_a_mechanism_without_length_limits_leaves_no_folder(tmp_path):
    done = command("dietmaier1998", "--output", tmp_path / "left")
    assert done.returncode == 2
    assert "legs.length_limits: missing" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_reference_outside_the_limits_leaves_no_folder(tmp_path):
    done = command("wu2012", "--position", "0,0,9", "--output", tmp_path / "left")
    assert done.returncode == 1
    assert "the reference pose at 0, 0, 9 m breaks a limit" in done.stderr
    assert list(tmp_path.iterdir()) == []
