"""One contract for every engine of the registry."""

import dataclasses
import os

import apart
import numpy as np
import pytest
from cases import random_mechanism, random_motion, scaled

import sixsps
from compare import registry, tolerances
from compare.tolerances import TOLERANCES, UNIT_ROUNDOFF
from sixsps.kinematics import inverse_kinematics
from sixsps.legs import Legs
from sixsps.trajectories import bundled, fitted
from sixsps.universal_joints import spin_forces
from urdf.layout import first_axes

# Rounding errors of an engine in units of cond(J) times unit roundoff, five times less than what is allowed
# to an engine at work: these mechanisms are the ones that it was measured on.
FACTOR = 20
# Set where every engine is installed, so that a missing one is a failure and not a skip.
ALL_REQUIRED = "SIXSPS_REQUIRE_ENGINES"


@pytest.fixture(params=registry.ENGINES)
def engine(request):
    """Class of each engine; a skip with its reason where it is not installed."""
    try:
        return request.param, apart.load(request.param)
    except sixsps.EngineUnavailable as error:
        if os.environ.get(ALL_REQUIRED):
            raise
        pytest.skip(str(error))


def forces_of(engine, mechanism, motion):
    return engine(mechanism).inverse_dynamics(motion, lambda done: None)


@pytest.mark.parametrize("name", ["line", "sinusoids", "recorded"])
def test_agrees_with_kane_on_bundled_mechanisms(engine, mechanism, name, request):
    _, make = engine
    if name == "recorded":
        motion = fitted(request.getfixturevalue("recorded"), mechanism)[::4]
    else:
        motion = bundled(name, mechanism, 200)
    reference = sixsps.inverse_dynamics(mechanism, motion)
    result = forces_of(make, mechanism, motion)
    assert result.forces.shape == (len(motion), 6)
    error = np.abs(result.forces - reference).max() / np.abs(reference).max()
    condition = inverse_kinematics(mechanism, motion).condition.max()
    assert error <= FACTOR * condition * UNIT_ROUNDOFF


def test_stays_within_rounding_on_200_random_mechanisms(engine):
    name, make = engine
    for seed in range(200):
        mechanism = random_mechanism(seed)
        motion = random_motion(mechanism, seed)
        assert_within_rounding(name, make, mechanism, motion)


def test_stays_within_rounding_far_from_the_origin(engine, wu2012):
    """The world frame kilometres away: what rounding of the coordinates allows, and no more."""
    _, make = engine
    shift = np.array([3e3, -1e4, 2e3])
    motion = bundled("sinusoids", wu2012, 20)
    far = dataclasses.replace(wu2012, base_anchors=wu2012.base_anchors + shift)
    moved = dataclasses.replace(motion, position=motion.position + shift)
    reference = sixsps.inverse_dynamics(wu2012, motion)
    error = np.abs(forces_of(make, far, moved).forces - reference).max() / np.abs(reference).max()
    growth = inverse_kinematics(far, moved).error_growth.max()
    assert error <= FACTOR * growth * UNIT_ROUNDOFF


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


@pytest.mark.parametrize("length", [1e-3, 1e3])
def test_unit_of_length_costs_no_digits(engine, length, wu2012):
    """Forces mixed with moments in one solve would let the unit decide what rounding does."""
    name, make = engine
    mechanism = scaled(wu2012, length, 1.0)
    assert_within_rounding(name, make, mechanism, random_motion(mechanism, 5, samples=20))


def assert_within_rounding(name, make, mechanism, motion):
    reference = sixsps.inverse_dynamics(mechanism, motion)
    forces = forces_of(make, mechanism, motion).forces
    condition = inverse_kinematics(mechanism, motion).condition
    bound = FACTOR * condition * UNIT_ROUNDOFF
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
    _, make = engine
    mechanism = random_mechanism(7)
    motion = random_motion(mechanism, 7)
    whole = forces_of(make, mechanism, motion).forces
    single = forces_of(make, mechanism, motion[2:3]).forces
    condition = inverse_kinematics(mechanism, motion).condition[2]
    bound = FACTOR * condition * UNIT_ROUNDOFF
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
    assert set(TOLERANCES) == {*registry.ENGINES, *registry.PAYLOAD_ENGINES}
    assert all(tolerance.reason for tolerance in TOLERANCES.values())


def test_unknown_engine_lists_those_that_exist():
    with pytest.raises(sixsps.UnknownNameError, match="kane, casadi, fast, lagrange"):
        registry.load("pinochio")


UPS = [name for name, entry in registry.ENGINES.items() if entry.ups]


@pytest.fixture(params=UPS)
def ups(request):
    """Class of each engine with legs on universal joints; a skip where it is not installed."""
    try:
        return request.param, registry.load(request.param, Legs.ups)
    except sixsps.EngineUnavailable as error:
        if os.environ.get(ALL_REQUIRED):
            raise
        pytest.skip(str(error))


@pytest.mark.parametrize("name", ["line", "sinusoids"])
def test_universal_joints_cost_what_the_spin_of_the_legs_costs(ups, mechanism, name):
    _, make = ups
    motion = bundled(name, mechanism, 100)
    without = sixsps.inverse_dynamics(mechanism, motion)
    spin = spin_forces(mechanism, motion, first_axes(mechanism))
    forces = forces_of(make, mechanism, motion).forces
    largest = np.abs(without).max()
    growth = inverse_kinematics(mechanism, motion).error_growth.max()
    assert np.abs(forces - spin - without).max() <= FACTOR * growth * UNIT_ROUNDOFF * largest
    assert 1e-10 * largest < np.abs(forces - without).max() <= tolerances.UPS * largest


def test_universal_joints_on_random_mechanisms(ups):
    """Fast turning and stout legs, where the spin costs up to a thousandth of the forces."""
    _, make = ups
    costs = []
    for seed in range(60):
        mechanism = random_mechanism(seed)
        motion = random_motion(mechanism, seed)
        without = sixsps.inverse_dynamics(mechanism, motion)
        spin = spin_forces(mechanism, motion, first_axes(mechanism))
        forces = forces_of(make, mechanism, motion).forces
        growth = inverse_kinematics(mechanism, motion).error_growth
        largest = np.abs(without).max(axis=1)
        error = np.abs(forces - spin - without).max(axis=1) / largest
        assert np.all(error <= FACTOR * growth * UNIT_ROUNDOFF), seed
        costs.append((np.abs(spin).max(axis=1) / largest).max())
    assert max(costs) > 1e-4


def test_an_engine_without_universal_joints_says_so():
    with pytest.raises(sixsps.EngineUnavailable, match="ball joints only"):
        registry.load("kane", Legs.ups)


def test_wrong_version_is_unavailable_with_both_versions(monkeypatch):
    monkeypatch.setattr(registry, "version", lambda package: "0.3.1")
    with pytest.raises(
        sixsps.EngineUnavailable, match=r"package casadi 0\.3\.1 is installed, >=3\.7 is needed"
    ):
        registry.load("casadi")


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
