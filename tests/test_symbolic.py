"""The CasADi model against the closed form, and its derivatives against differences of Kane's."""

import dataclasses

import numpy as np
import pytest
from cases import random_mechanism, random_motion
from differences import FIRST
from scipy.spatial.transform import Rotation

import sixsps
from sixsps import symbolic
from sixsps.bodies import Leg, Link, Platform
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism

EPS = np.finfo(float).eps
# Of eighth-order central differences: error of order step^8, rounding of order EPS / step.
STEP = 2e-3


def slope(function):
    """Derivative at 0 of a function of one number."""
    terms = (w * (function(k * STEP) - function(-k * STEP)) for k, w in FIRST.items())
    return sum(terms) / STEP


@pytest.fixture(params=range(4))
def state(request):
    mechanism = random_mechanism(request.param)
    return mechanism, random_motion(mechanism, request.param, samples=2)


def kane(mechanism, motion):
    return sixsps.inverse_dynamics(mechanism, motion, formulation="kane")


def assert_derivative(exact, numeric, scale):
    assert np.abs(exact - numeric).max() <= 1e-9 * scale


@pytest.mark.parametrize("seed", range(20))
def test_differentiated_jacobian_equals_the_closed_form(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    exact = symbolic.evaluate(symbolic.jacobian(), mechanism, motion)["jacobian"]
    legs = inverse_kinematics(mechanism, motion)
    # Arms and directions come from subtracting coordinates: their rounding, over the leg length.
    coordinates = np.abs(mechanism.base_anchors).max() + np.abs(motion.position).max()
    rounding = 8 * EPS * (1 + coordinates / legs.lengths.min())
    assert np.abs(exact - legs.jacobian).max() <= rounding * np.abs(legs.jacobian).max()


def test_lengths_equal_the_closed_form(state):
    mechanism, motion = state
    lengths = symbolic.evaluate(symbolic.lengths(), mechanism, motion)["lengths"]
    np.testing.assert_allclose(lengths, inverse_kinematics(mechanism, motion).lengths, rtol=1e-13)


def test_forces_solve_the_equations(state):
    mechanism, motion = state
    equations = symbolic.evaluate(symbolic.equations(), mechanism, motion)
    forces = symbolic.evaluate(symbolic.forces(), mechanism, motion)["F"]
    left = np.einsum("nij,nj->ni", equations["J"], forces)
    assert np.abs(left - equations["C"]).max() <= 1e-13 * np.abs(equations["C"]).max()


def left_perturbed(motion, axis, size):
    """The pose moved by `size` along, or turned about, a world axis; all else keeps its components."""
    position, rotation = np.array(motion.position), Rotation.from_matrix(motion.rotation)
    if axis < 3:
        position[:, axis] += size
    else:
        vector = np.zeros(3)
        vector[axis - 3] = size
        rotation = Rotation.from_rotvec(vector) * rotation
    return dataclasses.replace(motion, position=position, quaternion=rotation.as_quat(scalar_first=True))


def test_derivative_with_respect_to_the_pose_is_taken_on_the_rotation_group(state):
    mechanism, motion = state
    exact = symbolic.evaluate(symbolic.force_derivatives(), mechanism, motion)["by_pose"]
    size = mechanism.characteristic_length
    for axis in range(6):
        unit = size if axis < 3 else 1.0
        numeric = slope(lambda h, a=axis, u=unit: kane(mechanism, left_perturbed(motion, a, 0.1 * h * u)))
        assert_derivative(0.1 * unit * exact[..., axis], numeric, np.abs(numeric).max() + 1)


@pytest.mark.parametrize(
    ("output", "linear", "angular"),
    [
        ("by_twist", "velocity", "angular_velocity"),
        ("by_acceleration", "acceleration", "angular_acceleration"),
        ("by_wrench", "force", "moment"),
    ],
)
def test_derivatives_with_respect_to_twist_acceleration_and_wrench(state, output, linear, angular):
    mechanism, motion = state
    exact = symbolic.evaluate(symbolic.force_derivatives(), mechanism, motion)[output]
    for axis in range(6):
        name = linear if axis < 3 else angular
        unit = np.abs(getattr(motion, name)).max()

        def moved(h, name=name, axis=axis, unit=unit):
            values = np.array(getattr(motion, name))
            values[:, axis % 3] += h * unit
            return kane(mechanism, dataclasses.replace(motion, **{name: values}))

        scale = np.abs(kane(mechanism, motion)).max()
        assert_derivative(unit * exact[..., axis], slope(moved), scale)


def mechanism_of(parameters):
    """The mechanism with these parameters, read by name and not by position."""
    value = dict(zip(symbolic.PARAMETERS, parameters, strict=True))

    def vector(place):
        return np.array([value[f"{place}.{axis}"] for axis in "xyz"])

    def link(place):
        names = ("mass", "com", "transverse", "axial")
        mass, com, transverse, axial = (value[f"{place}.{name}"] for name in names)
        return Link(mass, 1.0, com, transverse, axial)

    xx, yy, zz, xy, xz, yz = (value[f"platform.inertia.{k}"] for k in ("xx", "yy", "zz", "xy", "xz", "yz"))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    legs = range(6)
    return Mechanism(
        name="perturbed",
        gravity=vector("gravity"),
        base_anchors=np.array([vector(f"base.anchors.{leg}") for leg in legs]),
        platform_anchors=np.array([vector(f"platform.anchors.{leg}") for leg in legs]),
        platform=Platform(value["platform.mass"], vector("platform.com"), inertia),
        legs=tuple(Leg(link(f"legs.{leg}.lower"), link(f"legs.{leg}.upper")) for leg in legs),
    )


def test_derivatives_with_respect_to_every_parameter():
    mechanism = random_mechanism(2)
    motion = random_motion(mechanism, 2, samples=1)
    parameters = symbolic.parameter_vector(mechanism)
    exact = symbolic.evaluate(symbolic.parameter_derivatives(), mechanism, motion)["by_parameters"][0]
    assert exact.shape == (6, len(symbolic.PARAMETERS))
    scale = np.abs(kane(mechanism, motion)).max()
    size = mechanism.characteristic_length
    for index, name in enumerate(symbolic.PARAMETERS):
        length_like = "anchors" in name or name.endswith((".com", ".com.x", ".com.y", ".com.z"))
        unit = 0.1 * size if length_like else np.abs(parameters[index]) or 1.0

        def moved(h, index=index, unit=unit):
            changed = parameters.copy()
            changed[index] += h * unit
            return kane(mechanism_of(changed), motion)[0]

        assert_derivative(unit * exact[:, index], slope(moved), scale)


def test_axial_inertia_has_no_influence():
    mechanism = random_mechanism(6)
    motion = random_motion(mechanism, 6, samples=1)
    exact = symbolic.evaluate(symbolic.parameter_derivatives(), mechanism, motion)["by_parameters"][0]
    axial = [index for index, name in enumerate(symbolic.PARAMETERS) if name.endswith("axial")]
    assert len(axial) == 12
    other = [index for index, name in enumerate(symbolic.PARAMETERS) if name.endswith("transverse")]
    assert np.abs(exact[:, axial]).max() <= 1e-12 * np.abs(exact[:, other]).max()


def test_energy_rate_is_the_derivative_of_energy():
    """Along x(t) with constant acceleration and turning about a fixed axis, by differences in time."""
    mechanism = random_mechanism(9)
    start = random_motion(mechanism, 9, samples=1)
    spin = 0.4 * start.angular_velocity / np.linalg.norm(start.angular_velocity)
    rotation = Rotation.from_matrix(start.rotation)

    def at(t):
        return dataclasses.replace(
            start,
            position=start.position + start.velocity * t + start.acceleration * t**2 / 2,
            quaternion=(Rotation.from_rotvec(spin * t) * rotation).as_quat(scalar_first=True),
            velocity=start.velocity + start.acceleration * t,
            angular_velocity=spin,
            angular_acceleration=np.zeros((1, 3)),
        )

    def energy(t):
        parts = symbolic.evaluate(symbolic.energy(), mechanism, at(t))
        return (parts["kinetic"] + parts["potential"])[0, 0]

    time_scale = 0.1 / np.abs(start.velocity).max() * mechanism.characteristic_length
    numeric = slope(lambda h: energy(h * time_scale)) / time_scale
    exact = symbolic.evaluate(symbolic.energy_rate(), mechanism, at(0.0))["rate"][0, 0]
    assert exact == pytest.approx(numeric, rel=1e-9)


def test_kinetic_energy_is_half_momentum_times_velocity_for_the_platform_alone():
    mechanism = random_mechanism(1)
    light = Link(1e-12, 1.0, 0.5, 1e-12, 1e-13)
    mechanism = dataclasses.replace(mechanism, legs=(Leg(light, light),) * 6)
    motion = random_motion(mechanism, 1)
    platform, R = mechanism.platform, motion.rotation
    v = motion.velocity + np.cross(motion.angular_velocity, R @ platform.com)
    omega = np.einsum("nji,nj->ni", R, motion.angular_velocity)
    expected = (
        platform.mass * np.sum(v * v, axis=1) + np.einsum("ni,ij,nj->n", omega, platform.inertia, omega)
    ) / 2
    kinetic = symbolic.evaluate(symbolic.energy(), mechanism, motion)["kinetic"][:, 0]
    np.testing.assert_allclose(kinetic, expected, rtol=1e-10)


def test_quaternion_sign_and_length_do_not_matter():
    mechanism = random_mechanism(1)
    motion = random_motion(mechanism, 1)
    stretched = dataclasses.replace(motion, quaternion=-1.0005 * motion.quaternion)
    one = symbolic.evaluate(symbolic.forces(), mechanism, motion)["F"]
    other = symbolic.evaluate(symbolic.forces(), mechanism, stretched)["F"]
    condition = inverse_kinematics(mechanism, motion).condition.max()
    assert np.abs(one - other).max() <= 20 * EPS * condition * np.abs(one).max()
