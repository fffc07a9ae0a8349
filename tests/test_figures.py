"""The picture: there for every outcome, and the same for the same data."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from cases import at_rest
from test_runner import fake  # noqa: F401  a fixture

from compare import figures
from compare.comparison import compare
from sixsps.trajectories import bundled

pytest.importorskip("matplotlib")


@pytest.fixture
def comparison(wu2012):
    return compare(wu2012, bundled("line", wu2012, 30), ["kane", "casadi"])


def test_is_svg_with_legs_and_engines(comparison, wu2012, tmp_path):
    path = figures.write_figure(comparison, wu2012, tmp_path)
    words = [element.text for element in ET.parse(path).iter() if element.tag.endswith("text")]
    assert {"1", "2", "3", "4", "5", "6", "casadi", "what rounding may do", "time [s]"} <= set(words)
    assert [file.name for file in tmp_path.iterdir()] == ["report.svg"]


def test_same_data_same_bytes(comparison, wu2012, tmp_path):
    first = figures.write_figure(comparison, wu2012, tmp_path).read_bytes()
    assert figures.write_figure(comparison, wu2012, tmp_path).read_bytes() == first


def test_thinning_keeps_the_largest_difference(wu2012, tmp_path, monkeypatch):
    """A single wrong sample among thousands has to show."""
    comparison = compare(wu2012, bundled("line", wu2012, 5000), ["kane", "casadi"])
    comparison.outcomes[1].forces[3217, 2] += 1.0
    drawn = []
    from matplotlib.axes import Axes

    fill = Axes.fill_between
    monkeypatch.setattr(
        Axes, "fill_between", lambda axes, *a, **k: drawn.append((a, k)) or fill(axes, *a, **k)
    )
    figures.write_figure(comparison, wu2012, tmp_path)
    (band,) = [arguments[2] for arguments, options in drawn if "against kane" in options.get("label", "")]
    assert len(band) <= 800
    largest = np.abs(comparison.outcomes[0].forces).max()
    assert band.max() == pytest.approx(1.0 / largest, rel=1e-9)


def test_an_engine_that_is_wrong_is_drawn_all_along(fake, wu2012, tmp_path, monkeypatch):  # noqa: F811
    comparison = compare(wu2012, bundled("line", wu2012, 20), ["kane", fake("Disagrees")])
    drawn = []
    from matplotlib.axes import Axes

    plot = Axes.plot
    monkeypatch.setattr(Axes, "plot", lambda axes, *a, **k: drawn.append((a, k)) or plot(axes, *a, **k))
    figures.write_figure(comparison, wu2012, tmp_path)
    lines = [a[1] for a, options in drawn if options.get("zorder") == 3]
    assert len(lines) == 1
    assert len(lines[0]) == 20


def test_draws_without_any_forces(wu2012, tmp_path):
    flat = compare(wu2012, at_rest([0.01, 0.02, 0.0]), ["kane", "casadi"])
    assert figures.write_figure(flat, wu2012, tmp_path).stat().st_size > 1000
