"""Simulation: forces put into forward dynamics give the planned motion back, or say why not."""

from dataclasses import replace

import numpy as np
import pytest
from cases import BUNDLED

from compare.forward import FORWARD
from compare.forward.closed_form import ClosedForm
from compare.registry import load_entry
from compare.simulation.feedforward import Gains, feedforward
from compare.simulation.linearisation import Linearisation
from compare.simulation.modes import Mode
from compare.simulation.open_loop import open_loop
from compare.simulation.plan import Plan
from compare.simulation.recover import recover
from compare.simulation.simulate import Request, simulate
from sixsps.errors import InputError, UnknownNameError
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import PAPER_FORCE, bundled, quintic


def engine(name, mechanism):
    return load_entry(name, FORWARD[name])(mechanism)


def hover(mechanism, duration=1.0, samples=201):
    """The home pose, held against the paper's force."""
    still = np.zeros((samples, 3))
    return Motion(
        time=np.linspace(0, duration, samples),
        position=still + home_position(mechanism),
        velocity=still, angular_velocity=still, acceleration=still, angular_acceleration=still,
        force=still + PAPER_FORCE, name="hover",
    )  # fmt: skip


def silent(_done):
    pass


class TestRecover:
    @pytest.mark.parametrize("name", ["closed-form", "pinocchio"])
    @pytest.mark.parametrize("bundled_name", BUNDLED)
    def test_accelerations_come_back(self, name, bundled_name):
        mechanism = Mechanism.load(bundled_name)
        for motion in ("line", "sinusoids", "quintic"):
            outcome = recover(engine(name, mechanism), mechanism, bundled(motion, mechanism, 11), silent)
            measures = outcome.measures(mechanism.characteristic_length)
            assert measures["max_acceleration_error"] <= 1e-9
            assert measures["max_position_error_m"] is None
            assert measures["max_closure_error_m"] < 1e-14

    def test_progress_counts_to_the_last_sample(self, wu2012):
        seen = []
        recover(ClosedForm(wu2012), wu2012, bundled("line", wu2012, 5), seen.append)
        assert seen == [1, 2, 3, 4, 5]

    def test_singular_samples_are_left_out_and_told(self, wu2012):
        motion = bundled("line", wu2012, 5)
        position = np.array(motion.position)
        position[3] = [0.01, 0.02, 0.0]
        outcome = recover(ClosedForm(wu2012), wu2012, replace(motion, position=position), silent)
        assert len(outcome.trajectory.planned) == 4
        assert outcome.stopped.t == motion.time[3]
        assert "singular at 1 sample, which has no leg forces" in outcome.stopped.reason

    def test_error_is_absolute_where_nothing_accelerates(self, wu2012):
        outcome = recover(ClosedForm(wu2012), wu2012, hover(wu2012, samples=3), silent)
        linear, angular = outcome.trajectory.acceleration_error()
        expected = max(linear.max(), 0.1 * angular.max())
        assert outcome.measures(0.1)["max_acceleration_error"] == expected


class TestOpenLoop:
    def test_deviations_grow_at_the_largest_eigenvalue(self, wu2012):
        plan = Plan.of(wu2012, hover(wu2012))
        outcome = open_loop(engine("pinocchio", wu2012), plan, silent)
        measures = outcome.measures(0.1)
        assert measures["growth_rate_per_s"] == pytest.approx(measures["eigenvalue_per_s"], rel=1e-3)
        assert measures["largest_eigenvalue_per_s"] == pytest.approx(measures["eigenvalue_per_s"], rel=1e-6)
        assert 0.3 < measures["horizon_s"] < 1.0
        assert outcome.stopped is None

    def test_growth_is_that_of_the_run_and_not_of_what_comes_after(self, wu2012):
        figures = open_loop(ClosedForm(wu2012), Plan.of(wu2012, bundled("line", wu2012, 101)), silent).more
        assert figures["growth_rate_per_s"] == pytest.approx(figures["eigenvalue_per_s"], rel=0.05)
        assert figures["measured_growth"]["window_s"] == figures["horizon_s"]
        mean = figures["measured_growth"]["mean_eigenvalue_per_s"]
        assert figures["growth_rate_per_s"] == pytest.approx(mean, rel=0.01)
        assert figures["largest_eigenvalue_per_s"] > 1.3 * figures["eigenvalue_per_s"]

    @pytest.mark.parametrize(
        ("mechanism", "motion", "samples"),
        [
            ("wu2012", "line", 101), ("wu2012", "line", 201), ("wu2012", "line", 2001),
            ("tsai2000", "quintic", 201), ("wu2012", "sinusoids", 101),
            ("wu2012", "hover", 201), ("tsai2000", "hover", 201),
        ],
    )  # fmt: skip
    def test_up_to_the_horizon_the_run_is_as_near_as_stated(self, mechanism, motion, samples):
        mechanism = Mechanism.load(mechanism)
        given = (
            hover(mechanism, samples=samples) if motion == "hover" else bundled(motion, mechanism, samples)
        )
        outcome = open_loop(ClosedForm(mechanism), Plan.of(mechanism, given), silent)
        path, size = outcome.trajectory, mechanism.characteristic_length
        off = np.hypot(path.position_error(), size * path.orientation_error())
        assert off.max() <= outcome.settings["lost_m"]
        assert path.planned.time[-1] == pytest.approx(outcome.more["horizon_s"], abs=0.03)
        assert outcome.more["horizon_s"] > 0.4

    @pytest.mark.parametrize("samples", [2, 21])
    def test_horizon_does_not_depend_on_the_samples(self, wu2012, samples):
        plan = Plan.of(wu2012, bundled("line", wu2012, 201))
        reference = open_loop(ClosedForm(wu2012), plan, silent).more["horizon_s"]
        outcome = open_loop(ClosedForm(wu2012), Plan.of(wu2012, bundled("line", wu2012, samples)), silent)
        assert outcome.more["horizon_s"] == pytest.approx(reference, abs=0.01)
        assert len(outcome.trajectory.planned) > 2
        assert outcome.stopped is None

    def test_estimated_rates_are_told_to_shorten_it(self, wu2012):
        time = np.linspace(0, 0.5, 51)
        noise = np.random.default_rng(1).normal(scale=1e-5, size=(51, 3))
        motion = Motion.from_poses(time, home_position(wu2012) + noise)
        outcome = open_loop(ClosedForm(wu2012), Plan.of(wu2012, motion), silent)
        assert any("rates and accelerations are estimated" in note for note in outcome.notes)

    def test_nothing_to_simulate_is_a_stop(self, wu2012):
        time = np.linspace(0, 60, 7)
        motion = Motion.from_poses(time, home_position(wu2012) + 1e-3 * np.sin(time / 10)[:, None])
        outcome = open_loop(ClosedForm(wu2012), Plan.of(wu2012, motion), silent)
        assert "nothing was simulated" in outcome.stopped.reason

    def test_eigenvalues_without_velocity_come_in_pairs(self, wu2012):
        """A conservative system at rest: with every eigenvalue its negative, squares real."""
        values = Linearisation.along(Plan.of(wu2012, hover(wu2012, samples=3))).eigenvalues[0]
        squares = np.sort((values**2).real)
        np.testing.assert_allclose((values**2).imag, 0, atol=1e-4)
        np.testing.assert_allclose(squares[::2], squares[1::2], rtol=1e-5, atol=1e-3)

    def test_horizon_adds_up_the_growth(self):
        time = np.linspace(0, 2, 201)
        linear = Linearisation(time, np.tile(np.diag([10.0] + [0.0] * 11), (201, 1, 1)))
        assert linear.time_to_grow(np.e**5) == pytest.approx(0.5)
        assert linear.time_to_grow(np.e**50) == np.inf
        assert linear.mean_rate(1.0) == pytest.approx(10.0)


class TestFeedforward:
    def test_paper_example_is_followed(self, wu2012):
        plan = Plan.of(wu2012, bundled("line", wu2012)[:401])
        outcome = feedforward(engine("pinocchio", wu2012), plan, Gains.of(plan), silent)
        measures = outcome.measures(0.1)
        assert measures["max_position_error_m"] <= 1e-9
        assert measures["max_orientation_error_rad"] <= 1e-8
        assert measures["max_feedback_force_N"] <= 1e-4
        assert measures["max_closure_error_m"] <= 1e-11
        assert outcome.settings["force_step_s"] == pytest.approx(0.005)
        assert len(outcome.trajectory.forces) == 401

    def test_errors_fall_at_the_order_of_the_interpolation(self, wu2012):
        plan = Plan.of(wu2012, bundled("sinusoids", wu2012)[:241])
        found = []
        for step in (0.02, 0.01, 0.005):
            outcome = feedforward(engine("pinocchio", wu2012), plan, Gains.of(plan), silent, step)
            assert outcome.notes == ()
            measures = outcome.measures(0.1)
            found.append([measures["max_feedback_force_N"], measures["max_position_error_m"]])
        orders = np.log2(np.array(found[:-1]) / found[1:])
        # The coarsest hardly resolve a quarter of a second, and their errors fall faster than they should.
        assert (orders > 3.8).all(), orders
        assert orders[1, 0] == pytest.approx(4, abs=0.4)

    def test_gains_can_be_given(self, wu2012):
        plan = Plan.of(wu2012, bundled("line", wu2012, 11))
        gains = Gains.of(plan, stiffness=1e5)
        assert gains.stiffness == 1e5
        assert gains.damping == pytest.approx(
            Gains.of(plan).damping * np.sqrt(1e5 / Gains.of(plan).stiffness)
        )
        assert Gains.of(plan, 1e5, 300.0) == Gains(1e5, 300.0)

    def test_samples_coarser_than_the_forces_are_told(self, wu2012):
        plan = Plan.of(wu2012, bundled("quintic", wu2012, 101)[:11])
        outcome = feedforward(engine("pinocchio", wu2012), plan, Gains.of(plan), silent)
        assert "up to 0.01 s apart" in outcome.notes[0]

    def test_gains_stay_bounded_near_a_singularity(self, wu2012):
        home = home_position(wu2012)
        motion = quintic(np.linspace(0, 0.5, 101), home, [0, 0, 1e-9])
        plan = Plan.of(wu2012, motion)
        gains = Gains.of(plan)
        assert gains.stiffness <= 2000**2 * Gains.of(plan, 1.0).damping ** 2 / 4 * (1 + 1e-12)
        assert gains.stiffness < 1e7

    def test_a_force_step_longer_than_the_motion_is_refused(self, wu2012):
        plan = Plan.of(wu2012, bundled("quintic", wu2012, 11))
        with pytest.raises(InputError, match=r"--force-step: 0.5; allowed: up to 0.333333 s"):
            feedforward(ClosedForm(wu2012), plan, Gains(1e5, 100.0), silent, 0.5)


class TestRequest:
    def test_figures_imply_a_simulated_trajectory(self):
        assert Request().mode_name == "recover"
        assert Request(figures=True).mode_name == "feedforward"
        assert Request("exudyn").mode_name == "driven"

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"engine": "exudyn", "mode": Mode.recover}, "--mode: recover; allowed: none with exudyn"),
            ({"figures": True, "mode": Mode.recover}, "--figures: with --mode recover"),
            ({"stiffness": 1.0}, "--stiffness: 1.0; allowed: only with --mode feedforward"),
            ({"force_step": 0.01, "mode": Mode.open_loop}, "--force-step: 0.01"),
        ],
    )
    def test_options_that_do_not_fit_are_refused(self, given, message):
        with pytest.raises(InputError, match=message):
            Request(**given)

    def test_unknown_engines_are_named(self):
        with pytest.raises(UnknownNameError, match="closed-form, pinocchio"):
            Request("adams")


def test_a_motion_too_short_for_feedforward_is_not_blamed_on_an_option(wu2012):
    motion = quintic(np.linspace(0, 0.008, 5), home_position(wu2012), home_position(wu2012))
    with pytest.raises(InputError, match=r"motion: 0.008 s long; allowed: more than 0.01 s"):
        simulate(wu2012, motion, Request(mode=Mode.feedforward))


def test_multipliers_beyond_the_tolerance_are_told(wu2012):
    pytest.importorskip("exudyn")
    time = np.linspace(0, 0.1, 21)
    noise = np.random.default_rng(1).normal(scale=1e-4, size=(21, 3))
    rough = simulate(wu2012, Motion.from_poses(time, home_position(wu2012) + noise), Request("exudyn"))
    assert rough.complete
    assert not rough.accurate
    assert rough.facts["within_tolerance"] is False
    assert any("of the largest force, more than 1e-05" in note for note in rough.facts["notes"])


def test_multipliers_of_a_driven_run_are_the_forces(wu2012):
    pytest.importorskip("exudyn")
    done = simulate(wu2012, bundled("sinusoids", wu2012)[:201], Request("exudyn"))
    assert done.complete
    assert done.facts["max_relative_force_difference"] < 1e-5
    assert done.facts["within_tolerance"] is True
    assert done.accurate
    assert 0 < done.facts["transient_s"] < 0.02
    assert done.facts["max_position_error_m"] < 1e-9
