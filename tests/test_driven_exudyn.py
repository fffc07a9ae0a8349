"""The motion-driven run of Exudyn: multipliers of driven leg lengths against the leg forces."""

from dataclasses import replace

import numpy as np
import pytest
from cases import at_rest, random_mechanism, still

import sixsps
from compare.forward import FORWARD
from compare.registry import load_entry
from sixsps.bodies import Leg
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.trajectories import bundled, fitted, quintic, sinusoids

pytest.importorskip("exudyn")
driven = pytest.importorskip("compare.forward.exudyn")


def run(mechanism, motion, **given):
    return driven.Exudyn(mechanism).driven(motion, lambda done: None, **given)


def error(mechanism, motion, found):
    """Largest error of the forces after the transient, relative to the largest force."""
    reference = sixsps.inverse_dynamics(mechanism, motion)
    later = motion.time - motion.time[0] >= found.transient
    return np.abs(found.forces - reference)[later].max() / np.abs(reference).max()


def short(mechanism, samples=41):
    """The first 0.4 s of the bundled sinusoids."""
    return bundled("sinusoids", mechanism, 5 * (samples - 1) + 1)[:samples]


def lively(mechanism, time):
    """Sinusoids on all axes, each about 1 Hz, under a constant load."""
    size, mass = mechanism.characteristic_length, mechanism.platform.mass
    amplitude = [0.1 * size, 0.08 * size, 0.05 * size, 0.3, 0.2, 0.25]
    frequency, phase = [1, 1.3, 0.8, 1.1, 0.9, 1.2], [0, 0.4, 0.8, 1.2, 1.6, 2.0]
    load = np.array([3.0, -4.0, 5.0]) * mass
    center = [*home_position(mechanism), 0, 0, 0]
    motion = sinusoids(time, center, amplitude, frequency, phase, load)
    return replace(motion, moment=np.sin(np.outer(time, [3.0, 5.0, 7.0])) * load * size)


def thinned(mechanism, axial):
    """The same mechanism with links of another axial inertia."""
    legs = tuple(
        Leg(replace(leg.lower, axial=axial), replace(leg.upper, axial=axial), leg.length_limits)
        for leg in mechanism.legs
    )
    return replace(mechanism, legs=legs)


@pytest.fixture(scope="module")
def line(wu2012):
    """Two seconds of the paper's motion with the settings of the command: motion, run, progress."""
    motion, calls = bundled("line", wu2012), []
    found = load_entry("exudyn", FORWARD["exudyn"])(wu2012).driven(motion, calls.append)
    return motion, found, calls


def test_multipliers_are_the_forces(wu2012, line):
    motion, found, _ = line
    assert error(wu2012, motion, found) <= 1e-7


def test_bodies_follow_the_motion(line):
    motion, found, _ = line
    assert found.position_error.max() <= 1e-13
    assert found.orientation_error.max() <= 1e-12
    assert found.closure_error.max() <= 1e-13
    np.testing.assert_allclose(found.state.velocity, motion.velocity, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.state.angular_velocity, 0, rtol=0, atol=1e-9)


def test_reports_its_settings(line):
    motion, found, _ = line
    assert found.step == pytest.approx(2.5e-4, rel=1e-12)
    assert found.transient == pytest.approx(3e-3, rel=1e-12)
    assert found.error_estimate <= 1e-3
    assert np.array_equal(found.time, motion.time)
    assert "0.25 ms" in driven.Exudyn.settings


def test_reports_its_progress(line):
    motion, _, calls = line
    assert len(calls) > 20
    assert sorted(calls) == calls
    assert calls[-1] == len(motion)


def assert_second_order(mechanism, motion, steps):
    """Halving the step divides the error by four."""
    errors = []
    for step in steps:
        found = run(mechanism, motion, step=step)
        assert found.step == pytest.approx(step, rel=1e-9)
        errors.append(error(mechanism, motion, found))
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4, rtol=0.1)
    return errors


def test_line_converges_with_the_square_of_the_step(wu2012):
    assert_second_order(wu2012, bundled("line", wu2012, 201), [20e-3, 10e-3, 5e-3])


@pytest.mark.parametrize("name", ["tsai2000", "taghirad2013"])
def test_sinusoids_converge_with_the_square_of_the_step(name):
    mechanism = Mechanism.load(name)
    errors = assert_second_order(mechanism, short(mechanism), [4e-3, 2e-3, 1e-3])
    # From the coarsest step, what the default has to reach.
    assert errors[0] * (driven.STEP / 4e-3) ** 2 <= 1e-5


@pytest.mark.parametrize("seed", [0, 5])
def test_any_mechanism_will_do(seed):
    """Off-centre masses, full inertia, six different legs, tilted gravity, a moment, uneven samples."""
    mechanism = random_mechanism(seed)
    time = np.sort(np.random.default_rng(seed).uniform(2.0, 2.25, 60))
    motion = lively(mechanism, time)
    found = run(mechanism, motion)
    size = mechanism.characteristic_length
    assert error(mechanism, motion, found) <= 1e-5
    assert found.position_error.max() <= 1e-12 * size
    assert found.orientation_error.max() <= 1e-12
    assert found.closure_error.max() <= 1e-12 * size
    np.testing.assert_allclose(found.state.velocity, motion.velocity, rtol=0, atol=1e-5 * size)
    np.testing.assert_allclose(found.state.angular_velocity, motion.angular_velocity, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.state.rotation, motion.rotation, rtol=0, atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_forces_are_positive_when_the_legs_push(wu2012, sign):
    mechanism = replace(wu2012, gravity=sign * wu2012.gravity)
    place = np.tile(home_position(wu2012), (3, 1))
    motion = still(3, time=[0.0, 0.1, 0.2], position=place)
    found = run(mechanism, motion, step=1e-3)
    assert np.all(sign * found.forces > 0)
    np.testing.assert_allclose(found.forces, sixsps.inverse_dynamics(mechanism, motion), rtol=1e-7)


def test_forces_answer_the_wrench_at_once(wu2012):
    """Nothing of a load that changes in time depends on the step, as long as nothing moves."""
    time = np.linspace(0, 0.2, 101)
    load = 50 * np.sin(np.outer(time, [20.0, 30.0, 40.0]))
    place = np.tile(home_position(wu2012), (101, 1))
    motion = still(101, time=time, position=place, force=load, moment=load[:, ::-1] / 20)
    found = run(wu2012, motion, step=2e-3)
    reference = sixsps.inverse_dynamics(wu2012, motion)
    np.testing.assert_allclose(found.forces, reference, rtol=0, atol=1e-9 * np.abs(reference).max())


@pytest.mark.parametrize("uneven", [False, True])
def test_after_the_transient_nothing_is_left_of_the_start(wu2012, monkeypatch, uneven):
    """A run that starts with other accelerations is another one before, the same one afterwards."""
    time = np.linspace(0, 0.1, 101)
    time[1:-1] += uneven * 3e-4 * np.sin(1e3 * time[1:-1])
    motion = lively(wu2012, time)
    right = run(wu2012, motion, step=1e-3)
    exact = driven.platform_rates
    monkeypatch.setattr(driven, "platform_rates", lambda *given: (exact(*given)[0], np.ones((1, 7))))
    other = run(wu2012, motion, step=1e-3)
    change = np.abs(other.forces - right.forces).max(axis=1) / np.abs(right.forces).max()
    assert right.transient == pytest.approx(12e-3)
    assert change[1:4].max() > 1e-3
    assert change[time >= right.transient].max() <= 1e-7
    if not uneven:  # nothing is read between the steps
        assert change[time > 3.5e-3].max() <= 1e-8


def test_forces_follow_from_the_poses_alone(wu2012):
    """Where every step falls on a sample, rates and accelerations matter for the start only."""
    motion = lively(wu2012, np.linspace(0, 0.1, 101))
    wrong = {
        name: np.vstack([getattr(motion, name)[:1], np.ones((100, 3))])
        for name in ("velocity", "angular_velocity", "acceleration", "angular_acceleration")
    }
    right, other = (run(wu2012, given, step=1e-3) for given in (motion, replace(motion, **wrong)))
    np.testing.assert_allclose(other.forces, right.forces, rtol=0, atol=1e-9 * np.abs(right.forces).max())


@pytest.mark.parametrize("axial", [1e-4, 1e-14])
def test_idle_spins_change_no_force(wu2012, axial):
    motion = short(wu2012, 11)
    usual, other = (run(given, motion, step=1e-3).forces for given in (wu2012, thinned(wu2012, axial)))
    np.testing.assert_allclose(other, usual, rtol=0, atol=1e-8 * np.abs(usual).max())


def test_lengths_between_samples_keep_their_bound(wu2012):
    """dt^6 / 46080 times the sixth derivative, here by differences over 20 ms."""
    fine = np.linspace(0, 2, 2001)
    lengths = inverse_kinematics(wu2012, bundled("sinusoids", wu2012, 2001)).lengths
    sixth = np.abs(np.diff(lengths[::20], 6, axis=0)).max() / 0.02**6
    for samples in (41, 81):
        bound = (2 / (samples - 1)) ** 6 / 46080 * sixth
        coarse = bundled("sinusoids", wu2012, samples)
        missed = np.abs(driven.drive(wu2012, coarse, fine).lengths - lengths).max()
        assert 0.5 * bound <= missed <= 1.05 * bound


def test_a_coarsely_sampled_motion_is_enough(wu2012):
    motion = bundled("sinusoids", wu2012, 41)[:9]
    assert error(wu2012, motion, run(wu2012, motion)) <= 1e-6


def test_two_samples_are_enough_and_one_is_not(wu2012):
    motion = bundled("line", wu2012, 21)[:2]
    assert error(wu2012, motion, run(wu2012, motion)) <= 1e-6
    with pytest.raises(sixsps.EngineError, match="at least two samples, this motion has 1"):
        run(wu2012, at_rest([0.0, 0.1, 0.5]))


def test_the_estimate_of_the_error_is_one(wu2012):
    mechanism = random_mechanism(4)
    for given, factor in ((mechanism, 3), (wu2012, 20)):
        motion = lively(given, np.linspace(0, 0.2, 101))
        found = run(given, motion, step=2e-3)
        actual = error(given, motion, found) * np.abs(found.forces).max()
        assert actual <= found.error_estimate <= factor * actual


def test_a_motion_that_is_none_shows_in_the_estimate(wu2012, recorded):
    """Noisy poses do not have the smoothed derivatives that were estimated from them."""
    motion = fitted(recorded, wu2012)[:50]
    found = run(wu2012, motion, step=1e-3)
    assert found.error_estimate > 0.1 * np.abs(sixsps.inverse_dynamics(wu2012, motion)).max()


def through_a_singularity(mechanism):
    home = home_position(mechanism)
    return quintic(np.linspace(0, 1, 501), home, home, [0, 0, 2.0])


def assert_reached(motion, found, forces):
    """All samples before the end, and none after it; forces as they are where the run goes on."""
    kept = len(found.time)
    assert np.array_equal(found.time, motion.time[:kept])
    assert motion.time[kept - 1] < found.end
    assert motion.time[kept] > found.end - 2 * found.step
    assert len(found.state) == kept
    for name in ("forces", "position_error", "orientation_error", "closure_error"):
        assert len(getattr(found, name)) == kept
    off = np.abs(found.forces - forces[:kept]).max(axis=1)[found.time - motion.time[0] >= found.transient]
    assert off[:-10].max() <= 1e-4 * np.abs(forces[:kept]).max()


def test_a_solver_that_gives_up_keeps_what_it_has(wu2012, tmp_path, monkeypatch, capfd):
    """Quietly, though Exudyn's solvers print and write files unless they are told."""
    motion = replace(through_a_singularity(wu2012), time=np.linspace(3, 4, 501))
    signs = np.linalg.slogdet(inverse_kinematics(wu2012, motion).jacobian)[0]
    assert signs[0] != signs[-1]
    monkeypatch.chdir(tmp_path)
    calls = []
    found = driven.Exudyn(wu2012).driven(motion, calls.append, step=1e-3)
    assert found.stopped.startswith("the integrator gave up: Newton's method does not converge")
    assert 3.6 < found.end < 3.7
    assert_reached(motion, found, sixsps.inverse_dynamics(wu2012, motion))
    assert calls[-1] == len(found.time)
    assert run(wu2012, short(wu2012, 3)).stopped == ""
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


def test_a_run_stops_where_it_is_told_to(line, wu2012):
    motion, whole, _ = line
    start = motion.position[0]

    def trouble(state):
        return "far enough" if np.linalg.norm(state.position[0] - start) > 0.01 else ""

    found = run(wu2012, motion, trouble=trouble)
    assert found.stopped == "far enough"
    assert_reached(motion, found, whole.forces)
    far = np.linalg.norm(motion.position - start, axis=1) > 0.01
    assert len(found.time) == np.argmax(far)
    assert whole.stopped == ""
    assert whole.end == motion.time[-1]


def failing_after(monkeypatch, steps, message="no\nway"):
    right = driven.DrivenBodies._drive

    def drive(self, driving, k):
        if k > steps:
            raise ValueError(message)
        right(self, driving, k)

    monkeypatch.setattr(driven.DrivenBodies, "_drive", drive)


def test_an_error_on_the_way_keeps_what_came_before(wu2012, monkeypatch):
    motion = short(wu2012)
    forces = run(wu2012, motion).forces
    failing_after(monkeypatch, 1000)
    found = run(wu2012, motion)
    assert "exudyn fails on the motion: " in found.stopped
    assert "\n" not in found.stopped
    assert found.end == pytest.approx(1001 * found.step)
    assert_reached(motion, found, forces)


def test_a_run_shorter_than_the_transient_has_no_estimate(wu2012, monkeypatch):
    motion = lively(wu2012, np.linspace(0, 0.1, 101))
    failing_after(monkeypatch, 2)
    found = run(wu2012, motion, step=1e-3)
    assert len(found.time) == 3
    assert np.isnan(found.error_estimate)


@pytest.mark.parametrize("steps", [0, 10])
def test_a_run_that_does_not_get_to_the_second_sample_is_an_engine_error_of_one_line(
    wu2012, monkeypatch, steps
):
    failing_after(monkeypatch, steps)
    message = r"exudyn fails on the motion: .*no way.*, before the second sample$"
    with pytest.raises(sixsps.EngineError, match=message) as caught:
        run(wu2012, short(wu2012, 3))
    assert "\n" not in str(caught.value)


def test_a_user_may_interrupt(wu2012):
    def interrupt(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        driven.Exudyn(wu2012).driven(short(wu2012, 3), interrupt)


def test_names_its_version():
    assert driven.Exudyn.version().startswith("exudyn ")
