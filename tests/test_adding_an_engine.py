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


def values():
    """The registry's and the tolerances' value of the two lines in the README's recipe."""
    lines = [line for line in block("text").splitlines() if line.startswith('"svd": ')]
    return [line.removeprefix('"svd": ').rstrip(",") for line in lines]


@pytest.fixture
def svd(tmp_path, monkeypatch):
    """The engine of the README, added by its file, its registry line and its tolerance row."""
    (tmp_path / "svd.py").write_text(block("py"))
    monkeypatch.syspath_prepend(tmp_path)
    place, tolerance = values()
    entry = eval(place, vars(registry))
    monkeypatch.setitem(registry.ENGINES, "svd", dataclasses.replace(entry, module="svd"))
    monkeypatch.setitem(tolerances.TOLERANCES, "svd", eval(tolerance, vars(tolerances)))
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
