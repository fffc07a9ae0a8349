"""The main job in process: what it measures, and what it says of engines that are wrong."""

import dataclasses
import json
import re
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from cases import at_rest
from test_runner import fake  # noqa: F401  a fixture

import sixsps
from compare import metrics
from compare.comparison import compare
from compare.report import markdown
from compare.results import read_results, write_forces, write_results
from compare.summary import answer
from compare.terminal import terminal
from compare.tolerances import TOLERANCES
from sixsps.trajectories import bundled, fitted


@pytest.fixture(scope="module")
def paper():
    """The paper's example, 300 samples, all engines."""
    mechanism = sixsps.Mechanism.load("wu2012")
    return compare(mechanism, bundled("line", mechanism, 300), ["kane", "casadi", "pinocchio"])


class TestPaperExample:
    def test_all_engines_agree_to_rounding(self, paper):
        assert paper.agreed
        for entry in paper.results["engines"].values():
            assert entry["status"] == "ok"
            assert entry["within_tolerance"] is True
            assert 0 < entry["max_rel_error"] <= TOLERANCES["kane"].rounding(paper.largest_error_growth)
            assert 1e-14 < entry["tolerance_rel"] == TOLERANCES["kane"].rounding(paper.largest_error_growth)
            assert 0 < entry["worst_of_allowed"]["ratio"] < 0.2
            assert entry["microseconds_per_sample"] > 0
            assert 13 < entry["digits"] <= metrics.MOST_DIGITS

    def test_errors_are_against_the_certified_forces(self, paper):
        truth = paper.reference.forces[paper.reference.samples]
        for outcome in paper.outcomes:
            entry = paper.results["engines"][outcome.engine]
            error = np.abs(outcome.forces[paper.reference.samples] - truth)
            # The certified forces are rounded to float64 here, the errors are against what they are.
            assert abs(entry["max_abs_error_N"] - error.max()) <= 2 * np.spacing(np.abs(truth).max())
            assert entry["max_rel_error"] == entry["max_abs_error_N"] / paper.reference.largest
            assert entry["worst"]["t"] in paper.motion.time[paper.reference.samples]

    def test_reference_says_what_is_certified(self, paper):
        reference = paper.results["reference"]
        assert (reference["engine"], reference["bound"]) == ("certified", 1e-20)
        assert reference["stand_in"] == "kane"
        assert 16 <= reference["samples"] <= 24
        assert {0, 299} <= set(paper.reference.samples)
        assert f"at {reference['samples']} samples (first, last," in markdown(paper.results)

    def test_ranges_and_condition(self, paper):
        legs = paper.results["legs"]
        assert min(leg["length_min_m"] for leg in legs) == pytest.approx(0.460, abs=5e-4)
        assert max(leg["length_max_m"] for leg in legs) == pytest.approx(0.879, abs=5e-4)
        kane = paper.outcomes[0].forces
        assert [leg["force_max_N"] for leg in legs] == pytest.approx(kane.max(axis=0), rel=1e-14)
        assert paper.results["max_condition"]["value"] == pytest.approx(14.28, abs=0.01)
        assert paper.results["limit_violations"] == []
        assert paper.results["power_balance_residual"] < 1e-14

    def test_results_survive_the_disk(self, paper, tmp_path):
        path = write_results(paper.results, tmp_path)
        assert read_results(path) == paper.results
        table = pq.read_table(write_forces(paper, tmp_path)).to_pydict()
        assert list(table)[:8] == ["engine", "t", "f1", "f2", "f3", "f4", "f5", "f6"]
        assert len(table["t"]) == 3 * 300
        assert table["f3"][:300] == list(paper.outcomes[0].forces[:, 2])

    def test_report_tells_given_from_assumed(self, paper):
        text = markdown(paper.results)
        assert "3 engines agree with the certified forces to" in text
        assert "Given by: Wu, Xiong & Kong".replace("&", "&amp;") in text
        assert "Assumed, not given: `base.anchors`" in text
        assert paper.results["mechanism"]["sha256"] in text

    def test_terminal_table_fits_80_columns(self, paper):
        from rich.console import Console

        console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
        console.print(terminal(paper.results))
        console.file.close()
        text = console.export_text(clear=False)
        assert all(len(line) <= 80 for line in text.splitlines())
        assert "…" not in text
        for words in ("pinocchio", "casadi 3.", "14."):
            assert words in text


class TestWrongEngines:
    @pytest.fixture
    def motion(self, wu2012):
        return bundled("line", wu2012, 10)

    def test_one_wrong_force_is_found_and_placed(self, fake, wu2012, motion):  # noqa: F811
        comparison = compare(wu2012, motion, ["kane", fake("Disagrees")])
        entry = comparison.results["engines"]["Disagrees"]
        assert not comparison.agreed
        assert entry["within_tolerance"] is False
        assert entry["worst"] == {"t": motion.time[3], "leg": 5}
        force = comparison.outcomes[0].forces[3, 4]
        assert entry["max_abs_error_N"] == pytest.approx(0.01 * abs(force), rel=1e-12)
        assert "Disagrees disagrees with the certified forces" in answer(comparison.results)
        assert "**disagrees**" in markdown(comparison.results)

    def test_tolerance_can_be_set(self, fake, wu2012, motion):  # noqa: F811
        comparison = compare(wu2012, motion, ["kane", fake("Disagrees")], tolerance=0.05)
        assert comparison.agreed
        assert comparison.results["engines"]["Disagrees"]["tolerance_rel"] == 0.05

    def test_failure_is_a_row_with_its_reason(self, fake, wu2012, motion):  # noqa: F811
        comparison = compare(wu2012, motion, ["kane", fake("Killed")])
        assert not comparison.agreed
        assert comparison.results["engines"]["Killed"]["status"] == "failed"
        assert "killed by SIGSEGV" in markdown(comparison.results)
        json.dumps(comparison.results, allow_nan=False)

    def test_missing_engine_fails_only_when_asked_for(self, fake, wu2012, motion):  # noqa: F811
        name = fake("GivesNan", "no_such_library")
        engines = ["kane", name]
        assert compare(wu2012, motion, engines).agreed
        assert not compare(wu2012, motion, engines, requested=[name]).agreed


@pytest.fixture(autouse=True)
def tolerances_of_fakes(monkeypatch):
    for name in ("Disagrees", "Killed", "GivesNan"):
        monkeypatch.setitem(TOLERANCES, name, TOLERANCES["kane"])


def test_reference_is_computed_where_it_is_not_compared(wu2012):
    comparison = compare(wu2012, bundled("line", wu2012, 5), ["casadi"])
    assert list(comparison.results["engines"]) == ["casadi"]
    assert comparison.results["reference"]["stand_in"] == "kane"
    assert 0 < comparison.results["engines"]["casadi"]["max_rel_error"] < 1e-13


def test_singular_samples_are_named_and_the_rest_compared(wu2012):
    motion = bundled("line", wu2012, 6)
    position = np.array(motion.position)
    position[4] = [0.01, 0.02, 0.0]
    comparison = compare(wu2012, dataclasses.replace(motion, position=position), ["kane", "casadi"])
    assert not comparison.agreed
    (sample,) = comparison.results["singular_samples"]
    assert (sample["sample"], sample["t"]) == (5, motion.time[4])
    assert sample["condition"] is None or sample["condition"] > 1e12
    assert comparison.results["engines"]["casadi"]["within_tolerance"] is True
    assert "sample 5 at t = 1.6 s is singular" in markdown(comparison.results)


def test_nothing_but_singular_samples(wu2012):
    flat = at_rest([0.01, 0.02, 0.0])
    comparison = compare(wu2012, flat, ["kane", "casadi", "pinocchio"])
    assert not comparison.agreed
    json.dumps(comparison.results, allow_nan=False)
    assert "nothing was compared; 1 singular sample without forces" in markdown(comparison.results)
    for entry in comparison.results["engines"].values():
        assert entry["status"] == "ok"
        assert entry["digits"] is entry["max_rel_error"] is entry["within_tolerance"] is None


def test_limit_violations_are_flagged_and_change_no_number(wu2012):
    tight = dataclasses.replace(
        wu2012,
        legs=tuple(dataclasses.replace(leg, length_limits=(0.5, 0.8)) for leg in wu2012.legs),
    )
    motion = bundled("line", wu2012, 50)
    comparison = compare(tight, motion, ["kane"])
    assert comparison.agreed
    found = comparison.results["limit_violations"]
    lengths = sixsps.inverse_kinematics(tight, motion).lengths
    assert sum(entry["samples"] for entry in found) == np.sum((lengths < 0.5) | (lengths > 0.8))
    assert max(entry["length_m"] for entry in found) == lengths.max()
    assert np.array_equal(comparison.outcomes[0].forces, sixsps.inverse_dynamics(wu2012, motion))


def test_recorded_motion_says_what_was_estimated(wu2012, recorded):
    comparison = compare(wu2012, fitted(recorded, wu2012), ["kane", "pinocchio-ball"])
    assert comparison.agreed
    assert set(comparison.results["motion"]["estimated"]) == {
        "velocity",
        "angular_velocity",
        "acceleration",
        "angular_acceleration",
    }
    assert "Estimated from the poses, not given: acceleration: quintic" in markdown(comparison.results)


def test_tolerance_is_in_proportion_to_the_condition_number():
    tolerance = TOLERANCES["pinocchio"]
    low, high = tolerance.relative(np.array([10, 1e10]))
    assert high == pytest.approx(1e9 * low, rel=1e-12)
    assert low < 1e-12


def test_a_sample_near_a_singularity_does_not_excuse_the_others(fake, wu2012):  # noqa: F811
    """One sample with cond(J) of 1e8 allows errors of 1e-7 there, and nowhere else."""
    motion = bundled("line", wu2012, 20)
    position = np.array(motion.position)
    position[11] = [0.01, 0.02, 1e-9]
    nearly_flat = dataclasses.replace(motion, position=position)
    comparison = compare(wu2012, nearly_flat, ["kane", "casadi", fake("Disagrees")])
    entries = comparison.results["engines"]
    assert entries["casadi"]["within_tolerance"] is True
    assert entries["Disagrees"]["tolerance_rel"] > 1e-8
    assert entries["Disagrees"]["within_tolerance"] is False


def test_far_from_the_origin_the_bound_holds_what_engines_differ_by(wu2012):
    shift = np.array([3e4, -1e5, 2e4])
    motion = bundled("line", wu2012, 20)
    far = dataclasses.replace(wu2012, base_anchors=wu2012.base_anchors + shift)
    moved = dataclasses.replace(motion, position=motion.position + shift)
    comparison = compare(far, moved, ["kane", "casadi", "pinocchio", "pinocchio-ball"])
    assert comparison.agreed
    bound = TOLERANCES["kane"].rounding(comparison.largest_error_growth)
    assert bound > 1e-9
    near = sixsps.inverse_dynamics(wu2012, motion)
    error = np.abs(comparison.reference.forces - near).max() / np.abs(near).max()
    assert error <= bound


def test_gimbal_lock_of_the_urdf_ball_is_told_and_the_true_ball_goes_on():
    """A leg at a right angle to its home direction: a regular pose that three revolutes cannot take."""
    from sixsps.home import home_position

    wu2012 = sixsps.Mechanism.load("wu2012")
    home = home_position(wu2012) + wu2012.platform_anchors - wu2012.base_anchors
    # The lock is where the leg lies along the x axis of its home frame.
    yaw = np.arctan2(home[0, 1], home[0, 0])
    pitch = np.arctan2(np.hypot(*home[0, :2]), home[0, 2])
    x_axis = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    locked = at_rest(wu2012.base_anchors[0] - wu2012.platform_anchors[0] + 0.6 * x_axis)
    assert sixsps.inverse_kinematics(wu2012, locked).condition[0] < 1e4
    comparison = compare(wu2012, locked, ["kane", "pinocchio", "pinocchio-ball"])
    entries = comparison.results["engines"]
    assert entries["pinocchio"]["status"] == "failed"
    assert "use pinocchio-ball" in entries["pinocchio"]["reason"]
    assert entries["pinocchio-ball"]["within_tolerance"] is True


def test_without_casadi_the_other_engines_stand(wu2012, monkeypatch):
    monkeypatch.setitem(sys.modules, "sixsps.symbolic", None)
    monkeypatch.delattr(sixsps, "symbolic", raising=False)
    comparison = compare(wu2012, bundled("line", wu2012, 5), ["kane"])
    assert comparison.agreed
    assert comparison.results["power_balance_residual"] is None
    assert "the rate of energy needs CasADi" in markdown(comparison.results)


def test_a_single_engine_agrees_with_the_certified_forces(wu2012):
    comparison = compare(wu2012, bundled("line", wu2012, 5), ["kane"])
    assert re.match(r"kane agrees with the certified forces to \d\.\de-1[56]", answer(comparison.results))


def test_a_fitted_motion_says_what_was_done_to_it(wu2012, recorded):
    comparison = compare(wu2012, fitted(recorded[:50], wu2012), ["kane"])
    (change,) = comparison.results["motion"]["changes"]
    assert change.startswith("translation scaled by ")
    assert "Changed: translation scaled by" in markdown(comparison.results)
