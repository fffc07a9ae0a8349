"""A rigid payload: as part of the platform, and against what it exerts on one that is without it."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from cases import random_mechanism, random_motion
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from texts import BENCH

import sixsps
from compare.metrics import loads, scales
from sixsps.errors import MechanismError, MotionError
from sixsps.formulations import FORMULATIONS
from sixsps.payload import Payload, attached, shifted_wrench

# Everything here is a short sum of products; the forces come out of a solve that amplifies by error_growth.
ROUNDING = 100 * np.finfo(float).eps


def random_payload(mechanism, seed):
    """Turned, off-centre, as heavy as the platform give or take a factor of ten."""
    other = random_mechanism(seed + 1000).platform
    factor = mechanism.platform.mass / other.mass * 10 ** np.random.default_rng(seed).uniform(-1, 1)
    size = mechanism.characteristic_length / random_mechanism(seed + 1000).characteristic_length
    return Payload(factor * other.mass, size * other.com, factor * size**2 * other.inertia)


def particles(mass, com, inertia):
    """Six particles that have this mass, centre of mass and inertia, as points (6, 3) and masses (6,)."""
    moments, axes = np.linalg.eigh(inertia)
    second = np.maximum(moments.sum() / 2 - moments, 0)  # of mass along each principal axis
    arms = axes * np.sqrt(3 * second / mass)
    return com + np.hstack([arms, -arms]).T, np.full(6, mass / 6)


def moments_of(points, masses):
    com = masses @ points / masses.sum()
    arms = points - com
    inertia = sum(m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(masses, arms, strict=True))
    return masses.sum(), com, inertia


def carried_outside(mechanism, payload, motion):
    """The motion with what the payload exerts on a platform that is without it: d'Alembert, world axes."""
    R, omega, epsilon = motion.rotation, motion.angular_velocity, motion.angular_acceleration
    arm = R @ payload.com
    acceleration = motion.acceleration + np.cross(epsilon, arm) + np.cross(omega, np.cross(omega, arm))
    inertia = R @ payload.inertia @ R.swapaxes(1, 2)
    spin = np.einsum("nij,nj->ni", inertia, omega)
    force = payload.mass * (mechanism.gravity - acceleration)
    moment = -np.einsum("nij,nj->ni", inertia, epsilon) - np.cross(omega, spin)
    moment += np.cross(arm - R @ mechanism.platform.com, force)
    return replace(motion, force=motion.force + force, moment=motion.moment + moment)


def whole(mechanism, payload, motion):
    carrying = attached(mechanism, payload)
    return carrying, shifted_wrench(motion, mechanism.platform.com, carrying.platform.com)


@given(seed=st.integers(0, 10**6))
def test_platform_and_payload_are_the_particles_of_both(seed):
    mechanism = random_mechanism(seed % 1000)
    platform, payload = mechanism.platform, random_payload(mechanism, seed % 997)
    ours = attached(mechanism, payload).platform
    pairs = [particles(body.mass, body.com, body.inertia) for body in (platform, payload)]
    mass, com, inertia = moments_of(*(np.concatenate(part) for part in zip(*pairs, strict=True)))
    reach = max(np.linalg.norm(platform.com), np.linalg.norm(payload.com))
    assert_allclose(ours.mass, mass, rtol=ROUNDING)
    assert_allclose(ours.com, com, rtol=0, atol=ROUNDING * reach)
    size = np.abs(inertia).max() + mass * reach**2  # com comes out of a difference
    assert_allclose(ours.inertia, inertia, rtol=0, atol=ROUNDING * size)


@pytest.mark.parametrize("formulation", [name for name in FORMULATIONS if name != "wu2012-printed"])
@pytest.mark.parametrize("seed", range(4))
def test_attached_payload_is_the_wrench_that_it_exerts(formulation, seed):
    mechanism = random_mechanism(seed)
    payload, motion = random_payload(mechanism, seed), random_motion(mechanism, seed)
    outside = carried_outside(mechanism, payload, motion)
    inside = sixsps.inverse_dynamics(*whole(mechanism, payload, motion), formulation=formulation)
    wanted = sixsps.inverse_dynamics(mechanism, outside, formulation=formulation)
    growth = sixsps.inverse_kinematics(mechanism, motion).error_growth
    allowed = 100 * growth * np.finfo(float).eps * scales(wanted, loads(mechanism, outside))
    assert (np.abs(inside - wanted) <= allowed[:, None]).all()


def test_wrench_left_where_it_was_is_wrong():
    """So that the tests above see a shift that is forgotten or goes the other way."""
    mechanism = random_mechanism(2)
    payload, motion = random_payload(mechanism, 2), random_motion(mechanism, 2)
    carrying, shifted = whole(mechanism, payload, motion)
    right = sixsps.inverse_dynamics(carrying, shifted)
    backwards = shifted_wrench(motion, carrying.platform.com, mechanism.platform.com)
    for wrong in (motion, backwards):
        assert np.abs(sixsps.inverse_dynamics(carrying, wrong) - right).max() > 1e-3 * np.abs(right).max()


@pytest.mark.parametrize("seed", range(5))
def test_shifted_wrench_has_the_same_power_on_any_twist(seed):
    mechanism = random_mechanism(seed)
    motion, rng = random_motion(mechanism, seed), np.random.default_rng(seed)
    before, after = rng.standard_normal((2, 3))
    shifted = shifted_wrench(motion, before, after)

    def power(moving, point):
        velocity = moving.velocity + np.cross(moving.angular_velocity, moving.rotation @ point)
        return np.sum(moving.force * velocity + moving.moment * moving.angular_velocity, axis=1)

    speed = np.abs(motion.velocity).max() + np.abs(motion.angular_velocity).max()
    terms = np.abs(motion.force).max() * speed
    assert_allclose(power(shifted, after), power(motion, before), rtol=0, atol=ROUNDING * 10 * terms)
    back = shifted_wrench(shifted, after, before)
    assert_allclose(back.moment, motion.moment, rtol=0, atol=ROUNDING * np.abs(shifted.moment).max())


def test_order_of_two_payloads_does_not_matter():
    first, second = random_payload(BENCH, 1), random_payload(BENCH, 2)
    one = attached(attached(BENCH, first), second).platform
    other = attached(attached(BENCH, second), first).platform
    assert_allclose(one.mass, other.mass, rtol=ROUNDING)
    assert_allclose(one.com, other.com, rtol=0, atol=ROUNDING)
    assert_allclose(one.inertia, other.inertia, rtol=0, atol=ROUNDING * np.abs(one.inertia).max())


def test_a_rider_of_next_to_nothing_changes_next_to_nothing():
    carrying = attached(BENCH, Payload(1e-40, np.ones(3), np.zeros((3, 3))))
    assert_allclose(carrying.platform.inertia, BENCH.platform.inertia, rtol=0, atol=1e-39)
    assert_allclose(carrying.platform.com, BENCH.platform.com, rtol=0, atol=1e-39)


def test_only_the_platform_is_another():
    carrying = attached(BENCH, random_payload(BENCH, 3))
    assert replace(carrying, platform=BENCH.platform) == BENCH
    assert carrying.sha256 != BENCH.sha256


def test_geometry_alone_carries_nothing():
    with pytest.raises(MechanismError, match=r"platform\.mass: missing"):
        attached(sixsps.Mechanism.load("dietmaier1998"), random_payload(BENCH, 1))


def test_payload_of_a_compiled_mechanism():
    payload, motion = random_payload(BENCH, 5), random_motion(BENCH, 5)
    carrying, shifted = whole(BENCH, payload, motion)
    forces = sixsps.inverse_dynamics(carrying, shifted)
    compiled = sixsps.compile(carrying).inverse_dynamics(shifted)
    growth = sixsps.inverse_kinematics(BENCH, motion).error_growth.max()
    assert_allclose(compiled, forces, rtol=0, atol=ROUNDING * growth * np.abs(forces).max())


def test_equal_payloads_are_equal_and_stay_frozen_in_a_pickle():
    payload = random_payload(BENCH, 6)
    again = pickle.loads(pickle.dumps(payload))
    assert again == payload
    assert hash(again) == hash(payload)
    for array in (again.com, again.inertia):
        assert not array.flags.writeable
    for change in ({"mass": 2 * payload.mass}, {"com": payload.com + 1}, {"name": "other"}):
        assert replace(payload, **change) != payload
    assert payload != 3.0


@pytest.mark.parametrize("point", [[1, 2], 1.0, np.zeros((4, 3)), [np.nan] * 3, None], ids=str)
def test_points_that_are_none(point):
    motion = random_motion(BENCH, 1)
    with pytest.raises(MotionError, match=r"^before"):
        shifted_wrench(motion, point, np.zeros(3))
    with pytest.raises(MotionError, match=r"^after"):
        shifted_wrench(motion, np.zeros(3), point)


@pytest.mark.parametrize("payload", [None, 3.0, BENCH], ids=["nothing", "number", "mechanism"])
def test_only_payloads_are_attached(payload):
    with pytest.raises(MechanismError, match=r"^payload: .*; allowed: a sixsps\.Payload"):
        attached(BENCH, payload)
