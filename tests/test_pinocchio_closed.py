"""Motions that open the loops are refused: v and a by hand, and what Pinocchio's own maps say of them."""

import numpy as np
import pytest
from cases import random_mechanism, random_motion

pin = pytest.importorskip("pinocchio")

import urdf  # noqa: E402
from sixsps.errors import MotionError  # noqa: E402
from urdf.closure_rates import GAP, Ends  # noqa: E402

EPS = np.finfo(float).eps
ACCELERATION = np.array([1.0, 0.5, -2.0, 1.5, -1.0, 2.0])
TWIST = np.array([0.1, -0.2, 0.3, 0.5, 0.4, -0.6])


@pytest.fixture
def hexapod(wu2012):
    return urdf.load_pinocchio(wu2012)


@pytest.fixture
def moving(hexapod):
    q = hexapod.configuration([0.02, -0.03, 0.66], [0.98, 0.10, -0.05, 0.15])
    v = hexapod.velocity(q, TWIST)
    return q, v, hexapod.acceleration(q, v, ACCELERATION)


def ends(hexapod, q):
    rotation, legs, axes = hexapod._closed(q)
    return Ends(rotation, legs.arms, axes, legs.lengths), axes


def test_a_twist_in_world_axes_is_no_v(hexapod, moving):
    q, v, a = moving
    wrong = v.copy()
    wrong[:6] = TWIST
    for call in (
        lambda: hexapod.actuator_forces(q, wrong, a),
        lambda: hexapod.check_closed(q, wrong, a),
        lambda: hexapod.acceleration(q, wrong, ACCELERATION),
    ):
        with pytest.raises(
            MotionError, match=r"^v: tears the loop of leg \d at 0\.0\d+ m/s; allowed: at most"
        ):
            call()


def test_a_classical_acceleration_is_no_a(hexapod, moving):
    q, v, a = moving
    rotation = hexapod.platform_state(q).rotation
    wrong = a.copy()
    wrong[:3] = ACCELERATION[:3] @ rotation
    with pytest.raises(MotionError, match=r"^a: tears the loop of leg \d at 0\.\d+ m/s\^2; allowed: at most"):
        hexapod.actuator_forces(q, v, wrong)
    gap = hexapod.closure_jacobian(q) @ (wrong - a)
    found = ends(hexapod, q)[0].accelerations(v, wrong).gaps
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.linalg.norm(gap.reshape(6, 3), axis=1))


def test_no_acceleration_at_a_velocity_is_no_motion(hexapod, moving):
    q, v, _ = moving
    with pytest.raises(MotionError, match=r"^a: tears"):
        hexapod.actuator_forces(q, v, np.zeros(30))
    with pytest.raises(MotionError, match=r"^v: tears"):
        hexapod.actuator_forces(q, np.ones(30), np.zeros(30))
    assert np.isfinite(hexapod.actuator_forces(q, np.zeros(30), np.zeros(30)).forces).all()


@pytest.mark.parametrize("seed", range(4))
def test_gaps_are_those_of_pinocchio(seed):
    """Any v and a, closed or not: Jc v, and accelerations of frames, which know nothing of these formulas."""
    mechanism = random_mechanism(seed)
    hexapod, motion = urdf.load_pinocchio(mechanism), random_motion(mechanism, seed, samples=1)
    q = hexapod.configuration(motion.position[0], motion.quaternion[0])
    generator = np.random.default_rng(seed)
    v, a = generator.normal(size=(2, 30))
    model, data = hexapod.model, hexapod.data
    closing, axes = ends(hexapod, q)
    velocities, accelerations = closing.velocities(v), closing.accelerations(v, a)
    expected = np.einsum("kij,kj->ki", axes, (hexapod.closure_jacobian(q) @ v).reshape(6, 3))
    assert np.abs(velocities.gaps - expected).max() <= 64 * EPS * velocities.sizes.max()
    pin.forwardKinematics(model, data, q, v, a)
    for i in range(6):
        tip, anchor = (
            pin.getFrameClassicalAcceleration(
                model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED
            ).linear
            for name in (f"leg{i + 1}_tip", f"platform_anchor{i + 1}")
        )
        error = np.abs(accelerations.gaps[i] - (tip - anchor)).max()
        # Terms in the base's axes about the world's origin may be larger than those of the tip.
        assert error <= 256 * EPS * accelerations.sizes.max() * (1 + np.abs(mechanism.base_anchors).max())


@pytest.mark.parametrize("factor", [1e-100, 1e-9, 1.0, 1e9])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_closed_passes_at_any_speed(factor, seed):
    """Rounding stays six orders below what is allowed; time runs faster by `factor`."""
    mechanism = random_mechanism(seed)
    hexapod, motion = urdf.load_pinocchio(mechanism), random_motion(mechanism, seed, samples=2)
    for k in range(len(motion)):
        q = hexapod.configuration(motion.position[k], motion.quaternion[k])
        twist = np.concatenate([motion.velocity[k], motion.angular_velocity[k]])
        v = hexapod.velocity(q, factor * twist)
        v[8::4] += factor  # legs that spin besides
        acceleration = np.concatenate([motion.acceleration[k], motion.angular_acceleration[k]])
        a = hexapod.acceleration(q, v, factor**2 * acceleration)
        closing = ends(hexapod, q)[0]
        for found in (closing.velocities(v), closing.accelerations(v, a)):
            gaps = np.linalg.norm(found.gaps, axis=1)
            assert (gaps <= 1e-6 * GAP * found.sizes).all()
        hexapod.check_closed(q, v, a)


def test_a_little_is_forgiven_and_costs_as_little(hexapod, moving):
    """An estimate at a tenth of the bound: forces that differ by no more than the condition makes of it."""
    q, v, a = moving
    exact = hexapod.actuator_forces(q, v, a).forces
    generator = np.random.default_rng(1)
    direction = generator.normal(size=(2, 30))
    near = 0.1 * GAP * direction / np.linalg.norm(direction, axis=1)[:, None]
    found = hexapod.actuator_forces(q, v + near[0] * np.abs(v).max(), a + near[1] * np.abs(a).max()).forces
    condition = hexapod._condition(hexapod.legs(q))
    assert 0 < np.abs(found - exact).max() <= GAP * condition * np.abs(exact).max()


def test_what_constraint_dynamics_gives_passes(hexapod, moving):
    """Pinocchio's own acceleration of the closed chain, with a usual choice of mu."""
    q, v, _ = moving
    tau = np.zeros(30)
    tau[hexapod.actuator_v] = [50, -20, 30, 10, -40, 25]
    closures = hexapod.constraint_models, hexapod.constraint_datas
    settings = pin.ProximalSettings(0.0, 1e-10, 4)
    a = np.array(pin.constraintDynamics(hexapod.model, hexapod.data, q, v, tau, *closures, settings))
    found = hexapod.actuator_forces(q, v, a)
    np.testing.assert_allclose(found.forces, tau[hexapod.actuator_v], rtol=1e-9)
