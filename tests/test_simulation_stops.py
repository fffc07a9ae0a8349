"""Simulations that end early, with their reason and what they have."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.linalg import LinAlgError
from test_simulation import engine, hover, silent

from compare.forward.closed_form import ClosedForm
from compare.simulation.feedforward import Gains, feedforward
from compare.simulation.guard import Guard
from compare.simulation.integration import Accuracy, integrate
from compare.simulation.modes import Mode
from compare.simulation.plan import Plan
from compare.simulation.simulate import Request, simulate
from sixsps.bodies import Leg
from sixsps.dynamics import State
from sixsps.errors import EngineError, InputError
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled, quintic


class Failing(ClosedForm):
    """Fails or gives no numbers after some evaluations."""

    answers = 100
    error = None
    passes = 0

    def rates(self, *given):
        self.answers -= 1
        if self.answers < 0 and self.error:
            self.answers += self.passes
            raise self.error
        return super().rates(*given) * (np.nan if self.answers < 0 else 1.0)


def rising_beyond_limits(mechanism):
    """Legs of up to 0.7 m, and a plan that takes them further."""
    legs = tuple(Leg(leg.lower, leg.upper, (0.45, 0.7)) for leg in mechanism.legs)
    home = home_position(mechanism)
    return replace(mechanism, legs=legs), quintic(np.linspace(0, 0.5, 101), home, home + [0, 0, 0.15])


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
        assert "m, allowed 0.45 to 0.9 m" in done.stopped.reason
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

    @pytest.mark.parametrize(
        ("error", "reason"),
        [(EngineError("no more"), "no more"), (ValueError("zero norm"), "gave up: the run diverged")],
    )
    def test_an_engine_with_steps_of_its_own_keeps_what_it_did(self, wu2012, error, reason):
        class Steps(ClosedForm):
            steps_itself = True

            def run(self, y, times, drive, watch):
                for t in times[1:]:
                    if t > 0.5123:
                        raise self.error
                    assert watch(t, y)

        forward = Steps(wu2012)
        forward.error = error
        done = run(forward, Plan.of(wu2012, hover(wu2012)))
        assert reason in done.stopped.reason
        assert done.stopped.t == pytest.approx(0.51)
        assert len(done.y) == 103

    def test_an_engine_with_steps_of_its_own_is_watched_between_samples(self, wu2012):
        pytest.importorskip("mujoco")
        plan = falling(wu2012)
        coarse = replace(plan, motion=plan.motion[::50], forces=plan.forces[::50])
        done = run(engine("mujoco", wu2012), coarse)
        exact = run(ClosedForm(wu2012), plan)
        assert "leaves its limits" in done.stopped.reason
        assert done.stopped.t == pytest.approx(exact.stopped.t, abs=1.1e-3)
        assert len(done.y) == 1 + int(done.stopped.t / 0.25)

    @pytest.mark.parametrize("name", ["closed-form", "mujoco"])
    def test_gains_far_too_high_are_a_stop(self, wu2012, name, monkeypatch):
        monkeypatch.setattr("compare.simulation.integration._TRIED_STEPS", 100)
        if name == "mujoco":
            pytest.importorskip("mujoco")
        plan = Plan.of(wu2012, bundled("line", wu2012, 101))
        outcome = feedforward(engine(name, wu2012), plan, Gains.of(plan, 1e10), silent)
        assert "gave up" in outcome.stopped.reason or "diverged" in outcome.stopped.reason
        assert np.isfinite(outcome.trajectory.accelerations).all()

    def test_not_where_a_shorter_step_gets_through(self, wu2012):
        forward = Failing(wu2012)
        forward.error, forward.passes = EngineError("too far"), 1000
        done = run(forward, Plan.of(wu2012, hover(wu2012, duration=0.2, samples=41)))
        assert done.stopped is None
        assert len(done.y) == 41

    @pytest.mark.parametrize("error", [LinAlgError("no"), InputError("angular_velocity", 1e54, "less")])
    def test_where_the_arithmetic_fails(self, wu2012, error):
        forward = Failing(wu2012)
        forward.error = error
        done = run(forward, Plan.of(wu2012, hover(wu2012)))
        assert done.stopped.reason.startswith("the integrator gave up: the run diverged")

    def test_where_steps_bring_it_no_further(self, wu2012, monkeypatch):
        monkeypatch.setattr("compare.simulation.integration._TRIED_STEPS", 20)
        plan = Plan.of(wu2012, hover(wu2012))
        drive = lambda t, y: (plan.at(t).forces + 1e-3 * np.sin(1e6 * t), *plan.at(t)[1:3])  # noqa: E731
        forward = ClosedForm(wu2012)
        start, bounds = forward.initial(plan.start), Guard.of(plan)
        done = integrate(forward, start, plan.motion.time, drive, bounds, Accuracy(1e-13, 1e-13))
        assert "the integrator gave up: 20 steps brought it" in done.stopped.reason

    def test_before_a_singular_pose_between_samples_of_the_plan(self, wu2012):
        home = home_position(wu2012)
        motion = quintic(np.linspace(0, 0.5, 251), home, home, [0, 0, 2.0])
        plan = Plan.of(wu2012, motion)
        kept = len(plan.motion)
        assert plan.cut.reason == "the planned pose becomes singular between two samples"
        assert motion.time[kept - 1] < plan.cut.t < motion.time[kept]
        half = motion.quaternion[[kept - 1, kept]] @ [1, 0, 0, 0]
        assert 2 * np.arccos(half[0]) < np.pi / 2 < 2 * np.arccos(half[1])
        with pytest.raises(EngineError, match=r"becomes singular between two samples, at t = "):
            Plan.of(wu2012, motion[kept - 1 :])

    def test_where_the_plan_begins_beyond_the_limits(self, wu2012):
        legs = tuple(Leg(leg.lower, leg.upper, (0.45, 0.6)) for leg in wu2012.legs)
        done = run(ClosedForm(wu2012), Plan.of(replace(wu2012, legs=legs), hover(wu2012)))
        assert "leg 1 leaves its limits" in done.stopped.reason
        assert (done.stopped.t, len(done.y)) == (0.0, 1)

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

    @pytest.mark.parametrize("name", ["closed-form", "mujoco"])
    def test_a_plan_beyond_the_limits_is_simulated_up_to_them(self, wu2012, name):
        if name == "mujoco":
            pytest.importorskip("mujoco")
        short, motion = rising_beyond_limits(wu2012)
        done = simulate(short, motion, Request(name, Mode.feedforward))
        lengths = inverse_kinematics(short, motion).lengths.max(axis=1)
        assert "leaves its limits: 0.7" in done.facts["stopped"]["reason"]
        assert "m, allowed 0.45 to 0.7 m" in done.facts["stopped"]["reason"]
        assert done.facts["samples"] == np.argmax(lengths > 0.7)

    def test_recover_only_notes_a_plan_beyond_the_limits(self, wu2012):
        done = simulate(*rising_beyond_limits(wu2012), Request())
        assert done.complete
        assert done.facts["samples"] == 101
        assert "limit" in done.facts["notes"][0]


class TestDrivenStops:
    @pytest.fixture(autouse=True)
    def _exudyn(self):
        pytest.importorskip("exudyn")

    def test_at_a_singular_pose_between_samples(self, wu2012):
        home = home_position(wu2012)
        motion = quintic(np.linspace(0, 0.5, 251), home, home, [0, 0, 2.0])
        plan = Plan.of(wu2012, motion)
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

    def test_where_the_plan_takes_a_leg_beyond_its_limits(self, wu2012):
        short, motion = rising_beyond_limits(wu2012)
        done = simulate(short, motion, Request("exudyn"))
        lengths = inverse_kinematics(short, motion).lengths.max(axis=1)
        assert "leaves its limits: 0.7" in done.facts["stopped"]["reason"]
        assert done.facts["samples"] == np.argmax(lengths > 0.7)
