"""The benchmark of assembly modes runs, misses nothing, and would tell."""

import numpy as np
import pytest

from benchmarks import assembly


def test_finds_the_known_pose_of_every_kind():
    header, rule, *rows = assembly.table(2)
    assert len({line.count("|") for line in (header, rule, *rows)}) == 1
    cells = [[cell.strip() for cell in row.split("|")[1:-1]] for row in rows]
    assert [row[0] for row in cells][:4] == ["Dietmaier (1998)", "general", "planar base", "both planar"]
    assert {row[1] for row in cells[1:]} == {"2"}
    assert {row[2] for row in cells} == {"0"}


def test_tells_a_pose_that_is_not_there():
    case = assembly.random_case(np.random.default_rng(0))
    modes, seconds = case.modes()
    assert case.is_among(modes)
    assert seconds > 0
    moved = assembly.Case(case.base, case.platform, case.position + 1e-3, case.rotation)
    assert not moved.is_among(modes)


@pytest.mark.parametrize("missed", [0, 3])
def test_fails_where_one_is_missed(missed, monkeypatch, capsys):
    monkeypatch.setattr(assembly, "table", lambda count: [f"| general | {count} | {missed} | |"])
    monkeypatch.setattr("sys.argv", ["assembly", "--count", "7"])
    assert assembly.main() == int(missed > 0)
    assert "| 7 |" in capsys.readouterr().out
