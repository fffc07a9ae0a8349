"""Calls that are wrong without a word: wrong, and apart from the engines."""

import re

import numpy as np
import pytest

import sixsps
from compare.comparison import compare
from compare.registry import TRAPS
from compare.report import markdown
from sixsps.trajectories import bundled


@pytest.fixture(scope="module")
def caught():
    """Every trap that needs no extra, in one comparison."""
    mechanism = sixsps.Mechanism.load("wu2012")
    traps = ["wu2012-printed", "euler-rates", "massless-legs", "pinocchio-tree", "pinocchio-contact"]
    return compare(mechanism, bundled("sinusoids", mechanism, 50), ["kane"], traps=traps)


class TestTraps:
    def test_all_are_wrong_and_count_for_nothing(self, caught):
        assert caught.agreed
        assert list(caught.results["engines"]) == ["kane"]
        assert len(caught.results["traps"]) == 5
        for name, entry in caught.results["traps"].items():
            assert entry["status"] == "ok", (name, entry["reason"])
            assert entry["within_tolerance"] is False
            assert entry["max_rel_error"] > 1e-4
            assert entry["why"].endswith(".")

    def test_stand_apart_in_the_report(self, caught):
        report = markdown(caught.results)
        before, after = report.split("## Traps")
        for name in caught.results["traps"]:
            assert name not in before
            assert name in after

    def test_contact_dynamics_close_no_loop(self, caught):
        tree, contact = (caught.traps[index].forces for index in (3, 4))
        assert np.abs(tree - contact).max() < 1e-12 * np.abs(tree).max()

    def test_harmless_where_nothing_turns(self, wu2012):
        comparison = compare(wu2012, bundled("line", wu2012, 5), ["kane"], traps=["euler-rates"])
        assert comparison.results["traps"]["euler-rates"]["within_tolerance"] is True
        assert "On this motion it does no harm" in markdown(comparison.results)

    def test_every_trap_says_why(self):
        for trap in TRAPS.values():
            assert re.fullmatch(r"[A-Za-z`_].*\.", trap.why)
            assert ". " not in trap.why
