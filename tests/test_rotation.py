"""Rotation helpers against scipy's rotations, their differences in time, and numpy's cross product."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from sixsps.rotation import (
    cross,
    euler_motion,
    euler_rate_matrix,
    euler_rate_matrix_dot,
    quaternion_rates,
    skew,
)

EPS = np.finfo(float).eps
STEP = 0.02
# Eighth-order central differences: first and second derivative, and the factor of h^8 f^(9), h^8 f^(10)
# in their truncation error.
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
FIRST_TRUNCATION, SECOND_TRUNCATION = 1 / 630, 1 / 3150
STENCIL = STEP * np.arange(-4, 5)

vectors = arrays(float, 3, elements=st.floats(-2, 2))
# Half of the draws lie at gimbal lock or within 1e-3 of it.
tilts = st.floats(-np.pi, np.pi) | st.builds(
    lambda side, off: side * np.pi / 2 + off, st.sampled_from([-1, 1]), st.floats(-1e-3, 1e-3)
)
angle_triples = st.builds(
    lambda a, b, c: np.array([a, b, c]), st.floats(-np.pi, np.pi), tilts, st.floats(-np.pi, np.pi)
)


def rotations(angles):
    return Rotation.from_euler("XYZ", angles).as_matrix()


def from_skew(matrix):
    """The vector of the skew-symmetric part."""
    return np.array(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    ) / 2  # fmt: skip


def along(angles, rates, accelerations):
    """Angles at the nine points of the stencil, on a path of constant acceleration."""
    t = STENCIL[:, None]
    return angles + rates * t + accelerations * t**2 / 2


def difference_bounds(rates, accelerations):
    """Largest error of first and second differences of R along that path.

    The entries of R are sums of products of sines of the three angles, so their k-th derivative is of the
    order of (sum of rates)^k on a straight path. A curved path |q'' t| adds to the rates inside the stencil
    and brings derivatives of its own, covered by the root of the acceleration. An angle of up to 4 rad is
    itself rounded to 4 EPS, and with it the entries of R; the weights sum to at most 4 and 7.
    """
    speed = np.abs(rates).sum() + 4 * STEP * np.abs(accelerations).sum()
    speed += np.sqrt(np.abs(accelerations).sum()) * 3
    rounding = 20 * EPS
    first = FIRST_TRUNCATION * STEP**8 * speed**9 + 4 * rounding / STEP
    second = SECOND_TRUNCATION * STEP**8 * speed**10 + 7 * rounding / STEP**2
    return first, second


@given(a=vectors, b=vectors)
def test_skew_is_the_cross_product(a, b):
    matrix = skew(a)
    np.testing.assert_allclose(matrix @ b, np.cross(a, b), rtol=0, atol=4 * EPS * 4)
    np.testing.assert_array_equal(matrix, -matrix.T)


@pytest.mark.parametrize("shape", [(3,), (1, 3), (5, 3), (5, 6, 3), (0, 3)])
def test_skew_works_on_any_leading_shape(shape):
    rng = np.random.default_rng(7)
    a, b = rng.standard_normal(shape), rng.standard_normal(shape)
    assert skew(a).shape == (*shape, 3)
    np.testing.assert_allclose(np.einsum("...ij,...j->...i", skew(a), b), np.cross(a, b), rtol=0, atol=1e-14)


@given(angles=angle_triples, rates=vectors)
def test_euler_rates_turn_about_the_axes_they_name(angles, rates):
    # alpha turns about the world's X, beta about the Y that alpha has turned, gamma about the Z of both.
    after_alpha = Rotation.from_euler("X", angles[0])
    after_beta = after_alpha * Rotation.from_euler("Y", angles[1])
    expected = (
        rates[0] * np.array([1.0, 0.0, 0.0])
        + rates[1] * after_alpha.apply([0.0, 1.0, 0.0])
        + rates[2] * after_beta.apply([0.0, 0.0, 1.0])
    )
    # A few roundings of numbers up to the sum of the rates, 6.
    np.testing.assert_allclose(euler_rate_matrix(angles) @ rates, expected, rtol=0, atol=6 * 5 * EPS)


@given(angles=angle_triples)
def test_euler_rate_matrix_loses_an_axis_exactly_at_gimbal_lock(angles):
    assert np.linalg.det(euler_rate_matrix(angles)) == pytest.approx(np.cos(angles[1]), abs=10 * EPS)


@given(angles=angle_triples, rates=vectors)
def test_euler_rate_matrix_gives_the_derivative_of_the_rotation(angles, rates):
    matrices = rotations(along(angles, rates, np.zeros(3)))
    derivative = np.tensordot(FIRST, matrices, axes=1) / STEP
    omega = euler_rate_matrix(angles) @ rates
    bound, _ = difference_bounds(rates, np.zeros(3))
    np.testing.assert_allclose(skew(omega) @ matrices[4], derivative, rtol=0, atol=3 * bound)


@given(angles=angle_triples, rates=vectors)
def test_euler_rate_matrix_dot_is_the_derivative_of_the_matrix(angles, rates):
    path = along(angles, rates, np.zeros(3))
    derivative = np.tensordot(FIRST, euler_rate_matrix(path), axes=1) / STEP
    bound, _ = difference_bounds(rates, np.zeros(3))
    np.testing.assert_allclose(euler_rate_matrix_dot(angles, rates), derivative, rtol=0, atol=bound)


@given(angles=angle_triples, rates=vectors, accelerations=vectors)
def test_euler_motion_gives_first_and_second_derivative_of_the_rotation(angles, rates, accelerations):
    matrices = rotations(along(angles, rates, accelerations))
    R = matrices[4]
    first = np.tensordot(FIRST, matrices, axes=1) / STEP
    second = np.tensordot(SECOND, matrices, axes=1) / STEP**2
    omega, epsilon = (row[0] for row in euler_motion(angles[None], rates[None], accelerations[None]))
    bound, bound2 = difference_bounds(rates, accelerations)
    # R' = [omega]x R, and R'' R^T = [epsilon]x + [omega]x^2, whose second part is symmetric.
    np.testing.assert_allclose(omega, from_skew(first @ R.T), rtol=0, atol=3 * bound)
    np.testing.assert_allclose(epsilon, from_skew(second @ R.T), rtol=0, atol=3 * bound2)


def test_euler_motion_treats_samples_one_by_one():
    rng = np.random.default_rng(3)
    angles, rates, accelerations = rng.standard_normal((3, 20, 3))
    omega, epsilon = euler_motion(angles, rates, accelerations)
    assert omega.shape == epsilon.shape == (20, 3)
    for i in range(20):
        one = euler_motion(angles[i : i + 1], rates[i : i + 1], accelerations[i : i + 1])
        np.testing.assert_allclose(one[0][0], omega[i], rtol=0, atol=100 * EPS)
        np.testing.assert_allclose(one[1][0], epsilon[i], rtol=0, atol=100 * EPS)


def test_a_turn_about_one_axis_has_the_euler_rates_themselves():
    # Only there does the paper's q' = [v, omega] hold.
    for axis in range(3):
        angles, rates, accelerations = np.zeros((3, 1, 3))
        angles[0, axis], rates[0, axis], accelerations[0, axis] = 0.7, 1.3, -2.1
        omega, epsilon = euler_motion(angles, rates, accelerations)
        np.testing.assert_allclose(omega, rates, rtol=0, atol=4 * EPS)
        np.testing.assert_allclose(epsilon, accelerations, rtol=0, atol=8 * EPS)


def test_euler_rates_are_not_the_angular_velocity_in_general():
    angles, rates, zero = np.array([[0.3, 0.4, 0.5]]), np.array([[1.0, 1.0, 1.0]]), np.zeros((1, 3))
    omega, _ = euler_motion(angles, rates, zero)
    assert np.abs(omega - rates).max() > 0.1


def test_cross_is_numpy_cross_to_the_last_bit():
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((2, 50, 6, 3))
    assert np.array_equal(cross(a, b), np.cross(a, b))
    assert np.array_equal(cross(a[:, :1], b), np.cross(a[:, :1], b))


def test_quaternion_rates_turn_as_the_angular_velocity_says():
    rng = np.random.default_rng(3)
    start, omega = rotation_of(rng.standard_normal(4)), rng.standard_normal(3)
    step = 1e-6
    turned = Rotation.from_rotvec(step * omega) * start
    before, after = (each.as_quat(scalar_first=True) for each in (start, turned))
    after *= np.sign(after @ before)
    assert np.allclose((after - before) / step, quaternion_rates(before, omega), atol=1e-5)


def rotation_of(quaternion):
    return Rotation.from_quat(quaternion, scalar_first=True)
