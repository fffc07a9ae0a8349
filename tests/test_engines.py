"""One contract for every engine of the registry."""

import dataclasses
import os

import numpy as np
import pytest
from cases import random_mechanism, random_motion

import sixsps
from compare import registry
from compare.tolerances import AGREEMENT, TOLERANCES, UNIT_ROUNDOFF
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled, fitted

# Set where every engine is installed, so that a missing one is a failure and not a skip.
ALL_REQUIRED = "SIXSPS_REQUIRE_ENGINES"


@pytest.fixture(params=registry.ENGINES)
def engine(request):
    """Class of each engine; a skip with its reason where it is not installed."""
    try:
        return request.param, registry.load(request.param)
    except sixsps.EngineUnavailable as error:
        if os.environ.get(ALL_REQUIRED):
            raise
        pytest.skip(str(error))


def forces_of(engine, mechanism, motion):
    return engine(mechanism).inverse_dynamics(motion, lambda done: None)


@pytest.mark.parametrize("name", ["line", "sinusoids", "recorded"])
def test_agrees_with_kane_on_bundled_mechanisms(engine, mechanism, name, request):
    name_of_engine, make = engine
    if name == "recorded":
        motion = fitted(request.getfixturevalue("recorded"), mechanism)[::4]
    else:
        motion = bundled(name, mechanism, 200)
    reference = sixsps.inverse_dynamics(mechanism, motion)
    result = forces_of(make, mechanism, motion)
    assert result.forces.shape == (len(motion), 6)
    error = np.abs(result.forces - reference).max() / np.abs(reference).max()
    condition = inverse_kinematics(mechanism, motion).condition.max()
    assert error <= TOLERANCES[name_of_engine].rounding_factor * condition * UNIT_ROUNDOFF
    assert error <= AGREEMENT


def test_stays_within_rounding_on_200_random_mechanisms(engine):
    name, make = engine
    for seed in range(200):
        mechanism = random_mechanism(seed)
        motion = random_motion(mechanism, seed)
        assert_within_rounding(name, make, mechanism, motion)


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8])
def test_stays_within_rounding_near_a_singularity(engine, distance, wu2012):
    """The hexapod is folded flat but for `distance`; errors may grow as cond(J), and no more."""
    name, make = engine
    motion = bundled("sinusoids", wu2012, 7)
    position = np.array(motion.position)
    position[:, 2] = distance
    still = np.tile([1.0, 0, 0, 0], (7, 1))
    flat = sixsps.Motion(
        time=motion.time,
        position=position,
        quaternion=still,
        velocity=motion.velocity,
        angular_velocity=motion.angular_velocity,
        acceleration=motion.acceleration,
        angular_acceleration=motion.angular_acceleration,
        force=motion.force,
    )
    assert inverse_kinematics(wu2012, flat).condition.min() > 0.1 / distance
    assert_within_rounding(name, make, wu2012, flat)


def assert_within_rounding(name, make, mechanism, motion):
    reference = sixsps.inverse_dynamics(mechanism, motion)
    forces = forces_of(make, mechanism, motion).forces
    condition = inverse_kinematics(mechanism, motion).condition
    bound = TOLERANCES[name].rounding_factor * condition * UNIT_ROUNDOFF
    error = np.abs(forces - reference).max(axis=1) / np.abs(reference).max(axis=1)
    assert np.all(error <= bound), (mechanism.name, (error / condition / UNIT_ROUNDOFF).max())


def test_closure_checks_are_at_rounding(engine, mechanism):
    _, make = engine
    motion = bundled("sinusoids", mechanism, 20)
    result = forces_of(make, mechanism, motion)
    if result.closure_residual is None:  # opens no loop
        assert result.closure_error is None
        return
    assert result.closure_residual.max() <= 1e-13 * np.abs(result.forces).max()
    size = np.abs(mechanism.base_anchors).max()
    assert result.closure_error.max() <= 1e-14 * size


def test_takes_gravity_from_the_mechanism(engine):
    """Tilted gravity of another planet: no engine may use a default of its own."""
    name, make = engine
    mechanism = dataclasses.replace(random_mechanism(0), gravity=[1.2, -0.4, 3.7])
    motion = random_motion(mechanism, 0)
    assert_within_rounding(name, make, mechanism, motion)


def test_single_sample_equals_the_same_sample_among_others(engine):
    name, make = engine
    mechanism = random_mechanism(7)
    motion = random_motion(mechanism, 7)
    whole = forces_of(make, mechanism, motion).forces
    single = forces_of(make, mechanism, motion[2:3]).forces
    condition = inverse_kinematics(mechanism, motion).condition[2]
    bound = TOLERANCES[name].rounding_factor * condition * UNIT_ROUNDOFF
    assert np.abs(single[0] - whole[2]).max() <= bound * np.abs(whole[2]).max()


def test_reports_progress_up_to_the_last_block(engine, wu2012):
    _, make = engine
    seen = []
    make(wu2012).inverse_dynamics(bundled("line", wu2012, 200), seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 200


def test_says_what_it_is(engine):
    _, make = engine
    for text in (make.formulation, make.loops, make.shares, make.version()):
        assert isinstance(text, str)
        assert text.strip()


def test_every_engine_has_a_tolerance_with_a_reason():
    assert set(TOLERANCES) == set(registry.ENGINES)
    assert all(tolerance.reason for tolerance in TOLERANCES.values())


def test_unknown_engine_lists_those_that_exist():
    with pytest.raises(sixsps.UnknownNameError, match="kane, casadi, pinocchio"):
        registry.load("pinochio")


def test_missing_library_is_unavailable_with_its_package(monkeypatch):
    entry = registry.Entry("compare.engines.kane", "Kane", "no_such_library", "no-such", "fancy")
    monkeypatch.setitem(registry.ENGINES, "fancy", entry)
    with pytest.raises(sixsps.EngineUnavailable, match=r"no-such is not installed.*sixsps\[fancy\]"):
        registry.load("fancy")


def test_broken_library_is_unavailable_with_its_own_error(monkeypatch, tmp_path):
    (tmp_path / "half_installed.py").write_text("raise RuntimeError('libfoo.so.3 not found')\n")
    monkeypatch.syspath_prepend(tmp_path)
    entry = registry.Entry("compare.engines.kane", "Kane", "half_installed", "half-installed")
    monkeypatch.setitem(registry.ENGINES, "half", entry)
    with pytest.raises(sixsps.EngineUnavailable, match=r"libfoo\.so\.3 not found"):
        registry.load("half")
