"""What errors are taken from, and that no slip of an engine hides another."""

import dataclasses
import sys

import numpy as np
import pytest
from cases import at_rest
from test_runner import fake  # noqa: F401  a fixture

import sixsps
from compare import metrics
from compare.comparison import compare
from compare.registry import ENGINES, load
from compare.report import markdown
from compare.runner import run
from compare.summary import answer
from compare.terminal import terminal
from compare.tolerances import TOLERANCES
from sixsps.bodies import Platform
from sixsps.trajectories import bundled


class Slips:
    """`run` with errors added to engines: (engine, sample, leg) -> newtons."""

    def __init__(self, errors):
        self.errors = errors

    def __call__(self, *arguments, **options):
        outcomes = run(*arguments, **options)
        for outcome in outcomes:
            for (engine, sample, leg), error in self.errors.items():
                if outcome.engine == engine:
                    outcome.forces[sample, leg] += error
        return outcomes


@pytest.fixture
def slip(monkeypatch):
    return lambda errors: monkeypatch.setattr("compare.comparison.run", Slips(errors))


class TestCertification:
    def test_the_worst_sample_of_an_engine_is_certified(self, fake, wu2012):  # noqa: F811
        motion = bundled("line", wu2012, 400)
        comparison = compare(wu2012, motion, ["kane", fake("Disagrees")])
        assert 3 in comparison.reference.samples
        engines = comparison.results["engines"]
        force = abs(comparison.outcomes[0].forces[3, 4])
        assert engines["Disagrees"]["max_abs_error_N"] == pytest.approx(0.01 * force, rel=1e-9)
        assert engines["kane"]["max_rel_error"] < 1e-14

    def test_a_slip_in_kane_hides_nothing(self, wu2012, slip):
        """Where `kane` is wrong, certified samples say so and another engine stands in for it."""
        motion = bundled("line", wu2012, 400)
        slip({("kane", 7, 2): 1e-3})
        comparison = compare(wu2012, motion, ["kane", "casadi", "pinocchio"])
        entries = comparison.results["engines"]
        assert comparison.results["reference"]["stand_in"] == "newton-euler"
        assert entries["kane"]["within_tolerance"] is False
        assert entries["kane"]["worst"] == {"t": motion.time[7], "leg": 3}
        assert entries["casadi"]["within_tolerance"] is entries["pinocchio"]["within_tolerance"] is True
        assert "kane disagrees with the certified forces" in answer(comparison.results)

    def test_a_slip_of_an_engine_that_runs_alone_is_found(self, wu2012, slip):
        slip({("kane", 35, 0): 1e-6})
        comparison = compare(wu2012, bundled("line", wu2012, 400), ["kane"])
        assert not comparison.agreed
        assert comparison.results["engines"]["kane"]["worst"]["t"] == comparison.motion.time[35]

    def test_two_engines_that_slip_at_different_samples_are_both_found(self, wu2012, slip):
        slip({("kane", 33, 0): 1e-6, ("casadi", 41, 3): 1e-6})
        comparison = compare(wu2012, bundled("line", wu2012, 400), ["kane", "casadi"])
        entries = comparison.results["engines"]
        assert entries["kane"]["within_tolerance"] is entries["casadi"]["within_tolerance"] is False

    def test_a_sample_near_a_singularity_does_not_draw_attention_from_a_small_slip(self, wu2012, slip):
        motion = bundled("line", wu2012, 60)
        position = np.array(motion.position)
        position[50] = [0.01, 0.02, 1e-7]
        nearly_flat = dataclasses.replace(motion, position=position)
        slip({("kane", 35, 2): 5e-10 * 300})
        comparison = compare(wu2012, nearly_flat, ["kane", "casadi", "lagrange"])
        entries = comparison.results["engines"]
        assert entries["kane"]["within_tolerance"] is False
        assert entries["kane"]["worst_of_allowed"]["t"] == motion.time[35]
        assert entries["casadi"]["within_tolerance"] is entries["lagrange"]["within_tolerance"] is True
        assert f"kane: at t = {motion.time[35]:.5g} s in leg 3 the error is" in markdown(comparison.results)

    def test_when_every_engine_is_wrong_none_is_let_off(self, fake, wu2012):  # noqa: F811
        comparison = compare(wu2012, bundled("line", wu2012, 10), [fake("Disagrees")])
        assert comparison.results["engines"]["Disagrees"]["within_tolerance"] is False

    def test_when_no_engine_is_confirmed_the_report_says_so(self, wu2012, slip, monkeypatch):
        wrong = 1.001 * sixsps.inverse_dynamics(wu2012, bundled("line", wu2012, 100))
        monkeypatch.setattr("compare.reference.inverse_dynamics", lambda *_: wrong)
        slip({("casadi", sample, 1): 1.0 for sample in range(100)})
        comparison = compare(wu2012, bundled("line", wu2012, 100), ["casadi"])
        assert comparison.results["reference"]["stand_in"] == ""
        assert comparison.results["engines"]["casadi"]["within_tolerance"] is False
        assert "They confirm no engine" in markdown(comparison.results)

    def test_nan_from_kane_is_no_reason_to_look_away(self, wu2012, slip):
        slip({("kane", 12, 0): np.nan, ("casadi", 12, 3): 1.0})
        comparison = compare(wu2012, bundled("line", wu2012, 100), ["kane", "casadi"])
        entries = comparison.results["engines"]
        assert entries["casadi"]["within_tolerance"] is entries["kane"]["within_tolerance"] is False

    def test_forces_that_vanish_are_certified_and_judged_by_the_load(self, wu2012):
        """Weightless legs, a platform that its external force carries: the true forces are tiny or zero."""
        floating = dataclasses.replace(wu2012, gravity=[0.0, 0.0, 0.0])
        comparison = compare(floating, at_rest([0.0, 0.0, 0.5]), ["kane", "casadi", "lagrange"])
        assert comparison.agreed
        assert comparison.results["reference"]["engine"] == "certified"
        assert "exactly" in answer(comparison.results)

    def test_loads_that_cancel_allow_the_rounding_of_the_loads(self, wu2012):
        heavy = dataclasses.replace(
            wu2012, platform=Platform(1e7, wu2012.platform.com, wu2012.platform.inertia)
        )
        carried = at_rest([0.01, -0.02, 0.5], force=[0, 0, 9.81e7])
        assert compare(heavy, carried, ["kane", "casadi", "lagrange", "newton-euler", "virtual-work"]).agreed

    def test_says_so_without_python_flint(self, wu2012, monkeypatch):
        monkeypatch.setitem(sys.modules, "sixsps.certified", None)
        comparison = compare(wu2012, bundled("line", wu2012, 5), ["kane", "casadi"])
        reference = comparison.results["reference"]
        assert reference["engine"] == reference["stand_in"] == "kane"
        assert reference["samples"] == 5
        assert reference["bound"] == TOLERANCES["kane"].rounding(comparison.largest_error_growth)
        assert "python-flint is not there" in reference["missing"]
        assert comparison.results["engines"]["kane"]["digits"] == metrics.digits(reference["bound"])
        assert "not certified: python-flint is not there" in markdown(comparison.results)
        assert answer(comparison.results).startswith("casadi agrees with kane to ")
        assert terminal(comparison.results)

    def test_says_so_without_a_regular_sample(self, wu2012):
        comparison = compare(wu2012, at_rest([0.01, 0.02, 0.0]), ["kane"])
        assert comparison.results["reference"]["missing"] == "no regular sample"


class TestTwins:
    """`fast` evaluates the graph of `casadi`: what the one says bears no witness for the other."""

    @pytest.fixture
    def others_wrong(self, wu2012, monkeypatch):
        """The two formulations that are always computed, wrong everywhere, so that neither stands in."""
        motion = bundled("line", wu2012, 100)
        wrong = 1.001 * sixsps.inverse_dynamics(wu2012, motion)
        monkeypatch.setattr("compare.reference.inverse_dynamics", lambda *_: wrong)
        return motion

    def test_do_not_confirm_each_other(self, wu2012, others_wrong):
        comparison = compare(wu2012, others_wrong, ["casadi", "fast"])
        assert comparison.results["reference"]["stand_in"] == ""
        assert "They confirm no engine" in markdown(comparison.results)

    def test_are_confirmed_by_another(self, wu2012, others_wrong):
        comparison = compare(wu2012, others_wrong, ["casadi", "fast", "lagrange"])
        assert comparison.results["reference"]["stand_in"] == "casadi"
        assert comparison.agreed

    def test_a_slip_of_both_is_found_by_another(self, wu2012, others_wrong, slip):
        slip({("casadi", 50, 1): 1e-6, ("fast", 50, 1): 1e-6})
        comparison = compare(wu2012, others_wrong, ["casadi", "fast", "lagrange"])
        entries = comparison.results["engines"]
        assert comparison.results["reference"]["stand_in"] == "lagrange"
        assert entries["casadi"]["within_tolerance"] is entries["fast"]["within_tolerance"] is False
        assert entries["lagrange"]["within_tolerance"] is True

    def test_a_slip_of_both_is_found_without_another(self, wu2012, slip):
        slip({("casadi", 50, 1): 1e-6, ("fast", 50, 1): 1e-6})
        comparison = compare(wu2012, bundled("line", wu2012, 100), ["casadi", "fast"])
        entries = comparison.results["engines"]
        assert comparison.results["reference"]["stand_in"] == "kane"
        assert entries["casadi"]["within_tolerance"] is entries["fast"]["within_tolerance"] is False

    @pytest.mark.parametrize("name", [name for name, entry in ENGINES.items() if entry.twin])
    def test_say_what_they_share(self, name):
        twin = ENGINES[name].twin
        assert not ENGINES[twin].twin
        assert twin in load(name).shares
        assert name in load(twin).shares
