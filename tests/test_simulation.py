"""Simulation: forces put into forward dynamics give the planned motion back, or say why not."""

from dataclasses import replace

import numpy as np
import pytest
from cases import BUNDLED

from compare.forward import FORWARD
from compare.forward.closed_form import ClosedForm
from compare.registry import load_entry
from compare.simulation.feedforward import Gains, feedforward
from compare.simulation.guard import Guard
from compare.simulation.integration import Accuracy, integrate
from compare.simulation.linearisation import Linearisation
from compare.simulation.modes import Mode
from compare.simulation.open_loop import open_loop
from compare.simulation.plan import Plan
from compare.simulation.recover import recover
from compare.simulation.simulate import Request, simulate
from sixsps.dynamics import State
from sixsps.errors import EngineError, InputError, UnknownNameError
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Leg, Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import PAPER_FORCE, bundled, home_position, quintic


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
        assert "singular at 1 samples" in outcome.stopped.reason

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
        growth = measures["measured_growth"]
        assert growth["rate_per_s"] == pytest.approx(measures["growth_rate_per_s"], rel=1e-3)
        assert growth["eigenvalue_per_s"] == pytest.approx(measures["growth_rate_per_s"], rel=1e-6)
        assert 0.3 < measures["horizon_s"] < 1.0
        assert outcome.stopped is None
        # Nothing but rounding disturbs the run: it stays near what the horizon is taken for.
        assert measures["max_position_error_m"] < 1e-5

    def test_moving_platforms_follow_their_eigenvalues_too(self, wu2012):
        plan = Plan.of(wu2012, bundled("line", wu2012)[:301])
        growth = open_loop(ClosedForm(wu2012), plan, silent).more["measured_growth"]
        assert growth["rate_per_s"] == pytest.approx(growth["eigenvalue_per_s"], rel=0.03)

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

    def test_a_force_step_longer_than_the_motion_is_refused(self, wu2012):
        plan = Plan.of(wu2012, bundled("quintic", wu2012, 11))
        with pytest.raises(InputError, match=r"--force-step: 0.5; allowed: up to 0.333333 s"):
            feedforward(ClosedForm(wu2012), plan, Gains(1e5, 100.0), silent, 0.5)


class Failing(ClosedForm):
    """Fails or gives no numbers after some evaluations."""

    answers = 100
    error = None

    def rates(self, *given):
        self.answers -= 1
        if self.answers < 0 and self.error:
            raise self.error
        return super().rates(*given) * (np.nan if self.answers < 0 else 1.0)


def falling(mechanism):
    """A plan without any leg force."""
    plan = Plan.of(mechanism, hover(mechanism))
    return replace(plan, forces=np.zeros_like(plan.forces))


def run(forward, plan):
    start = forward.initial(plan.start)
    drive = lambda t, y: plan.at(t)[:3]  # noqa: E731
    return integrate(forward, start, plan.motion.time, drive, Guard.of(plan), Accuracy(1e-9, 1e-9))


class TestStops:
    def test_where_a_leg_leaves_its_limits(self, wu2012):
        plan = falling(wu2012)
        done = run(ClosedForm(wu2012), plan)
        assert "leaves its limits" in done.stopped.reason
        assert "allowed: 0.45 to 0.9 m" in done.stopped.reason
        kept = len(done.y)
        assert 2 < kept < len(plan.motion)
        assert plan.motion.time[kept - 1] <= done.stopped.t < plan.motion.time[kept]

    def test_where_the_pose_becomes_singular(self, wu2012):
        legs = tuple(Leg(leg.lower, leg.upper, (0.0, 10.0)) for leg in wu2012.legs)
        plan = falling(replace(wu2012, legs=legs))
        done = run(ClosedForm(plan.mechanism), plan)
        assert done.stopped.reason == "the pose becomes singular"
        assert len(done.y) > 2

    def test_where_the_integrator_gives_up(self, wu2012):
        done = run(Failing(wu2012), Plan.of(wu2012, hover(wu2012)))
        assert "the integrator gave up" in done.stopped.reason
        assert len(done.y) >= 1

    def test_where_the_engine_fails(self, wu2012):
        forward = Failing(wu2012)
        forward.error = EngineError("no accelerations")
        done = run(forward, Plan.of(wu2012, hover(wu2012)))
        assert done.stopped.reason == "no accelerations"
        assert np.isfinite(done.y).all()

    def test_an_engine_with_steps_of_its_own_keeps_what_it_did(self, wu2012):
        class Steps(ClosedForm):
            steps_itself = True

            def run(self, y, times, drive):
                if times[0] > 0.4:
                    raise EngineError("diverged")
                return np.array([y for _ in times])

        done = run(Steps(wu2012), Plan.of(wu2012, hover(wu2012)))
        assert (done.stopped.reason, done.stopped.t) == ("diverged", pytest.approx(0.5))
        assert len(done.y) == 101

    def test_at_the_first_singular_pose_of_the_plan(self, wu2012):
        motion = hover(wu2012, samples=6)
        position = np.array(motion.position)
        position[4] = [0.01, 0.02, 0.0]
        plan = Plan.of(wu2012, replace(motion, position=position))
        assert len(plan.motion) == 4
        assert plan.cut.t == motion.time[4]
        position[1] = position[4]
        with pytest.raises(EngineError, match="singular"):
            Plan.of(wu2012, replace(motion, position=position))

    def test_a_plan_beyond_the_limits_is_told_and_simulated(self, wu2012):
        legs = tuple(Leg(leg.lower, leg.upper, (0.45, 0.6)) for leg in wu2012.legs)
        short = replace(wu2012, legs=legs)
        motion = hover(short, duration=0.05, samples=11)
        motion = replace(motion, position=motion.position + [0, 0, 0.2])
        done = simulate(short, motion, Request(mode=Mode.feedforward))
        assert done.complete
        assert "takes leg 1 to" in done.facts["notes"][0]
        assert "beyond its limit of 0.6 m" in done.facts["notes"][0]


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


def test_multipliers_of_a_driven_run_are_the_forces(wu2012):
    pytest.importorskip("exudyn")
    done = simulate(wu2012, bundled("sinusoids", wu2012)[:201], Request("exudyn"))
    assert done.complete
    assert done.facts["max_relative_force_difference"] < 1e-5
    assert 0 < done.facts["transient_s"] < 0.02
    assert done.facts["max_position_error_m"] < 1e-9


class TestDrivenStops:
    @pytest.fixture(autouse=True)
    def _exudyn(self):
        pytest.importorskip("exudyn")

    def test_at_a_singular_pose_between_samples(self, wu2012):
        home = home_position(wu2012)
        motion = quintic(np.linspace(0, 0.5, 251), home, home, [0, 0, 2.0])
        plan = Plan.of(wu2012, motion)
        assert plan.cut is None
        done = simulate(wu2012, motion, Request("exudyn"))
        stop, path = done.outcome.stopped, done.outcome.trajectory
        kept = len(path.planned)
        assert not done.complete
        assert done.facts["stopped"] == {"reason": stop.reason, "t": stop.t}
        assert "singular" in stop.reason
        assert path.planned.time[-1] < stop.t <= motion.time[kept]
        assert done.facts["samples"] == len(path.state) == len(path.accelerations) == kept
        trouble = Guard.of(plan).trouble
        regular = [not trouble(State.of(motion[k : k + 1])) for k in range(len(motion))]
        assert kept == pytest.approx(np.argmin(regular), abs=2)
        assert all(regular[:kept])

    def test_at_the_first_singular_sample_of_the_plan(self, wu2012):
        motion = hover(wu2012, duration=0.05, samples=6)
        position = np.array(motion.position)
        position[4] = [0.01, 0.02, 0.0]
        done = simulate(wu2012, replace(motion, position=position), Request("exudyn"))
        assert "the planned pose is singular" in done.facts["stopped"]["reason"]
        assert done.facts["stopped"]["t"] == motion.time[4]
        assert done.facts["samples"] == 4

    def test_where_a_leg_leaves_its_limits_between_samples(self, wu2012):
        """The last sample is left upwards, and so it is come to from below."""
        motion = hover(wu2012, duration=0.6, samples=4)
        velocity = np.array(motion.velocity)
        velocity[-1, 2] = 0.5
        lengths = inverse_kinematics(wu2012, motion).lengths[0]
        legs = tuple(
            Leg(leg.lower, leg.upper, (length - 1e-3, length + 1e-3))
            for leg, length in zip(wu2012.legs, lengths, strict=True)
        )
        done = simulate(replace(wu2012, legs=legs), replace(motion, velocity=velocity), Request("exudyn"))
        assert "leaves its limits" in done.facts["stopped"]["reason"]
        assert 0.4 < done.facts["stopped"]["t"] < 0.6
        assert done.facts["samples"] == 3

    def test_legs_beyond_the_limits_by_plan_are_told_and_simulated(self, wu2012):
        legs = tuple(Leg(leg.lower, leg.upper, (0.45, 0.6)) for leg in wu2012.legs)
        short = replace(wu2012, legs=legs)
        motion = hover(short, duration=0.05, samples=11)
        motion = replace(motion, position=motion.position + [0, 0, 0.2])
        done = simulate(short, motion, Request("exudyn"))
        assert done.complete
        assert "beyond its limit of 0.6 m" in done.facts["notes"][0]
