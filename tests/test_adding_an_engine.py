"""The README's recipe for an engine of one's own, followed to the letter."""

import dataclasses
import re
from pathlib import Path

import pytest

from compare import registry, tolerances
from compare.comparison import compare
from sixsps.trajectories import bundled

README = (Path(__file__).parents[1] / "README.md").read_text()
RECIPE = README[README.index("## Add an engine") :]


def block(language):
    return re.search(rf"```{language}\n(.*?)```", RECIPE, flags=re.DOTALL).group(1)


def line(start):
    """The value of the line in the README's recipe that begins with `start`."""
    (found,) = [line for line in block("text").splitlines() if line.startswith(start)]
    return found.removeprefix(start).strip().rstrip(",")


@pytest.fixture
def svd(tmp_path, monkeypatch):
    """The engine of the README, added by its file, its registry line and its tolerance row."""
    (tmp_path / "svd.py").write_text(block("py"))
    monkeypatch.syspath_prepend(tmp_path)
    entry = eval("Entry" + line('"svd": Entry'), vars(registry))
    monkeypatch.setitem(registry.ENGINES, "svd", dataclasses.replace(entry, module="svd"))
    row = eval("Tolerance" + line('"svd": Tolerance'), vars(tolerances))
    monkeypatch.setitem(tolerances.TOLERANCES, "svd", row)
    return entry


def test_engine_of_the_readme_agrees(svd, wu2012):
    assert svd.module == "compare.engines.svd"
    comparison = compare(wu2012, bundled("sinusoids", wu2012, 50), ["svd"], requested=["svd"])
    entry = comparison.results["engines"]["svd"]
    assert entry["status"] == "ok", entry["reason"]
    assert comparison.agreed
    assert entry["digits"] > 13
    assert entry["loops"]


def test_recipe_names_all_four_places():
    for place in ("compare/engines/svd.py", "compare/registry.py", "compare/tolerances.py", "pyproject.toml"):
        assert place in RECIPE
    assert re.search(r"^svd = \[", block("text"), flags=re.MULTILINE)
