"""MuJoCo's forward dynamics: settings, its own steps, and how they end."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from cases import at_rest
from scipy.integrate import solve_ivp
from test_forward_engines import lighter, load, state

import sixsps
from compare.forward.closed_form import ClosedForm
from sixsps.kinematics import inverse_kinematics
from sixsps.legs import Legs
from sixsps.trajectories import bundled

NOTHING = np.zeros(6), np.zeros(3), np.zeros(3)
TIMES = np.linspace(0, 0.05, 11)


@cache
def first_forces(mechanism):
    motion = bundled("sinusoids", mechanism, 3)
    return sixsps.inverse_dynamics(mechanism, motion)[0], motion.force[0]


def swinging(mechanism, t, y):
    """Forces that take the platform well away from where it would go by itself."""
    forces, force = first_forces(mechanism)
    return forces * (1 + np.sin(20 * t)), force, np.array([0.0, 0.1, 0.2])


def integrated(engine, mechanism):
    forces_at = partial(swinging, mechanism)
    start = engine.initial(state(bundled("sinusoids", mechanism)))
    solution = solve_ivp(
        lambda t, y: engine.rates(y, *forces_at(t, y)), (0, TIMES[-1]), start,
        method="DOP853", t_eval=TIMES, rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    return solution.y.T


def assert_on_the_way_of_the_closed_form(engine, states, mechanism, allowed):
    closed = ClosedForm(mechanism)
    for y, other in zip(states, integrated(closed, mechanism), strict=True):
        found, expected = engine.platform(y), closed.platform(other)
        np.testing.assert_allclose(found.position, expected.position, atol=allowed)
        np.testing.assert_allclose(found.rotation, expected.rotation, atol=10 * allowed)
        np.testing.assert_allclose(found.velocity, expected.velocity, atol=100 * allowed)
        assert engine.closure_error(y) < allowed


class TestMujoco:
    @pytest.fixture
    def make(self):
        return load("mujoco")

    def test_impedance_beyond_its_limit_makes_nothing_harder(self, make, wu2012):
        """Why the engine scales `body_invweight0`: the settings that are recommended leave 1e-4 of R."""
        import mujoco

        motion = bundled("line", wu2012, 3)
        forces = sixsps.inverse_dynamics(wu2012, motion)[0], motion.force[0], motion.moment[0]
        errors = []
        for impedance in (0.9999, 0.999999):
            engine = make(wu2012)
            engine.tree.model.eq_solimp[:, :2] = impedance
            engine.tree.model.body_invweight0[:] *= 1e7
            y = engine.initial(state(motion))
            with pytest.raises(
                sixsps.EngineError, match=r"^MuJoCo's closures give way by .* m/s\^2; allowed"
            ):
                engine.rates(y, *forces)
            found = engine.tree.data.qacc[engine.tree.platform_columns][:3]
            errors.append(np.abs(found - motion.acceleration[0]).max())
        assert errors[0] == errors[1] > 1e-3
        assert mujoco.mjMAXIMP == 0.9999

    def test_a_mujoco_that_forgets_how_the_closures_turn_is_refused(self, make, wu2012, monkeypatch):
        """With a_ref = -b J v - k r alone accelerations would be silently wrong at r = 0."""
        import mujoco

        whole = mujoco.mj_fwdVelocity

        def without_drift(model, data):
            whole(model, data)
            stiffness, damping, impedance, _ = data.efc_KBIP.T
            data.efc_aref[:] = -damping * data.efc_vel - stiffness * impedance * data.efc_pos

        monkeypatch.setattr(mujoco, "mj_fwdVelocity", without_drift)
        with pytest.raises(sixsps.EngineError, match=r"^MuJoCo .* closes no loop that moves: J' v"):
            make(wu2012)

    def test_run_agrees_with_the_closed_form(self, make, wu2012):
        motion = bundled("sinusoids", wu2012)
        engine = make(wu2012)
        start = engine.initial(state(motion))
        states = engine.run(start, TIMES, partial(swinging, wu2012))
        assert np.array_equal(states[0], start)
        assert_on_the_way_of_the_closed_form(engine, states, wu2012, 1e-9)

    def test_run_is_of_order_four(self, make, wu2012, monkeypatch):
        motion = bundled("sinusoids", wu2012)
        ends = []
        for step in (1e-3, 5e-4, 2.5e-4, 6.25e-5):
            monkeypatch.setattr("compare.forward.mujoco.TIME_STEP", step)
            engine = make(wu2012)
            push = partial(pushing, 100.0)
            ends.append(
                engine.platform(engine.run(engine.initial(state(motion)), [0, 0.02], push)[-1]).position
            )
        errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
        assert errors[0] / errors[1] > 10
        assert errors[1] / errors[2] > 10

    def test_run_tracks_the_line_of_the_paper(self, make, wu2012):
        """Feed-forward and a PD on the leg lengths, in the first tenth of a second."""
        motion = bundled("line", wu2012)[:101]
        forces = sixsps.inverse_dynamics(wu2012, motion)
        legs = inverse_kinematics(wu2012, motion)
        engine, feedback = make(wu2012), []

        def forces_at(t, y):
            there = engine.platform(y)
            now = inverse_kinematics(wu2012, at_rest(there.position[0], there.quaternion[0]))
            rates = now.jacobian[0] @ np.hstack([there.velocity[0], there.angular_velocity[0]])
            plan, dplan, force = (
                np.array([np.interp(t, motion.time, column) for column in table.T])
                for table in (legs.lengths, legs.length_rates, forces)
            )
            feedback.append(1e5 * (plan - now.lengths[0]) + 1e3 * (dplan - rates))
            return force + feedback[-1], motion.force[0], motion.moment[0]

        states = engine.run(engine.initial(state(motion)), motion.time[::20], forces_at)
        ends = np.array([engine.platform(y).position[0] for y in states])
        # Linear interpolation of the lengths over a millisecond is off by 1e-8 m.
        assert np.abs(ends - motion.position[::20]).max() < 2e-8
        assert max(engine.closure_error(y) for y in states) < 1e-11

    def test_run_lets_the_forces_ask_the_engine(self, make, wu2012):
        engine = make(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        plain = engine.run(y, [0, 1e-3], partial(pushing, 1.0))

        def curious(t, y):
            engine.rates(y, *NOTHING)
            engine.closure_error(y)
            return pushing(1.0, t, y)

        assert np.array_equal(engine.run(y, [0, 1e-3], curious), plain)

    def test_run_ends_with_what_the_forces_raise(self, make, wu2012):
        import mujoco

        engine = make(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        before, asked = mujoco.get_mjcb_control(), []

        def forces_at(t, y):
            asked.append(t)
            if t > 1e-3:
                raise KeyError("enough")
            return NOTHING

        with pytest.raises(KeyError, match="enough"):
            engine.run(y, [0, 1], forces_at)
        assert max(asked) == asked[-1] == pytest.approx(1e-3, abs=2e-4)
        assert mujoco.get_mjcb_control() is before

    def test_run_that_diverges_is_an_error(self, make, wu2012, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        engine = make(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        with pytest.raises(sixsps.EngineError, match=r"^MuJoCo's steps diverged at t = 0\.00\d+ s$"):
            engine.run(y, [0, 0.01, 0.02], partial(pushing, 1e30))
        assert list(tmp_path.iterdir()) == []

    def test_a_quaternion_without_length_is_divergence(self, make, wu2012):
        """MuJoCo's steps leave one where a body turns too fast for its numbers."""
        import mujoco

        engine = make(wu2012)
        data = mujoco.MjData(engine.tree.model)
        assert len(engine._checked(data)) == 67
        data.qpos[engine._quaternions[-1]] = 0.0
        with pytest.raises(sixsps.EngineError, match=r"^MuJoCo's steps diverged at t = 0 s$"):
            engine._checked(data)

    def test_run_is_watched_and_ends_where_told(self, make, wu2012):
        engine = make(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        seen = []

        def watch(t, y):
            seen.append(t)
            assert y.shape == (67,)
            return t < 0.0145

        states = engine.run(y, [0, 0.0051, 0.01, 0.02, 0.03], partial(pushing, 1.0), watch)
        assert len(states) == 3
        assert {0.0051, 0.01} <= set(seen)
        assert max(seen) == seen[-1] == pytest.approx(0.015)
        assert np.diff(seen).max() <= 1.001e-3

    def test_times_need_not_be_multiples_of_the_step(self, make, wu2012):
        engine = make(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        odd = engine.run(y, [1.0, 1.00037, 1.00201, 1.005], partial(pushing, 10.0))[-1]
        even = engine.run(y, [1.0, 1.005], partial(pushing, 10.0))[-1]
        np.testing.assert_allclose(odd, even, atol=1e-9)
        assert engine.run(y, [1.0], partial(pushing, 10.0)).shape == (1, 67)

    def test_refuses_what_mujoco_refuses(self, make, wu2012):
        slim = replace(wu2012, legs=tuple(lighter(leg, 1e-13) for leg in wu2012.legs))
        with pytest.raises(sixsps.EngineError, match=r"^MuJoCo refuses the mechanism: mass and inertia.*$"):
            make(slim)

    def test_inverse_dynamics_keeps_its_own_open_tree(self, make, wu2012):
        from compare.engines.mujoco import Tree

        before = Tree(wu2012, Legs.sps).model
        make(wu2012)
        after = Tree(wu2012, Legs.sps).model
        assert before.opt.disableflags == after.opt.disableflags
        assert np.array_equal(before.body_invweight0, after.body_invweight0)


def pushing(size, t, y):
    return size * np.arange(6) * np.cos(50 * t), np.array([0.0, 0.0, size]), np.zeros(3)
