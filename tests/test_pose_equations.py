"""The kernels' equations: their derivatives, the bound on their curvature, and what Newton's steps do."""

import mpmath
import numpy as np
import pytest
from cases import random_mechanism, random_motion
from lengths import lengths_of
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sixsps.kernels import pose_equations
from sixsps.kernels.forward_kinematics import geometry_of
from sixsps.rotation import skew

SEEDS = range(6)


class Kernel:
    """The parts of the kernels, as Python sees them, at a pose of a mechanism in the kernels' own units."""

    def __init__(self, seed, distance=0.2):
        self.mechanism = random_mechanism(seed)
        _, self.anchors, frame = geometry_of(self.mechanism.base_anchors, self.mechanism.platform_anchors)
        self.weight, self.largest = frame[7:]
        motion = random_motion(self.mechanism, seed, samples=1)
        arms = motion.rotation[0] @ frame[3:6]
        place = (motion.position[0] - frame[:3] + arms) / frame[6]
        self.pose = np.concatenate([place, motion.quaternion[0]])
        self.rng = np.random.default_rng(seed)

    def legs(self, pose):
        legs = np.empty((6, 8))
        pose_equations.place.py_func(self.anchors, pose, legs)
        return legs

    def inverse(self, pose):
        inverse = np.empty((6, 6))
        assert pose_equations.invert.py_func(self.legs(pose), inverse, np.empty((6, 6)), np.empty(6, int))
        return inverse.T

    def halves(self, pose):
        return self.legs(pose)[:, 6] / 2

    def curvature(self, pose):
        legs, inverse = self.legs(pose), np.ascontiguousarray(self.inverse(pose).T)
        return pose_equations.curvature(legs, inverse, self.weight, np.empty((7, 16)))

    def step(self, norm):
        """A random step of a norm, most of them with one of its parts small."""
        along, about = self.rng.standard_normal((2, 3))
        shares = self.rng.permutation([1.0, 10 ** self.rng.uniform(-3, 0)])
        along *= norm * shares[0] / np.linalg.norm(along)
        about *= norm * shares[1] / np.linalg.norm(about) / self.weight
        return np.concatenate([along, about])

    def norm(self, step):
        return max(np.linalg.norm(step[:3]), self.weight * np.linalg.norm(step[3:]))

    def moved(self, pose, step):
        pose = pose.copy()
        pose_equations.move(pose, step)
        return pose

    def derivative(self, step):
        """Of half the squared lengths by the step from the first pose, by complex steps: to rounding."""
        rotation = Rotation.from_quat(self.pose[3:], scalar_first=True).as_matrix()
        columns = np.empty((6, 6))
        for k in range(6):
            off = step + 1e-30j * np.eye(6)[k]
            arms = self.anchors[:, 3:] @ rotation.T @ expm(skew(off[3:])).T
            legs = self.pose[:3] + off[:3] - self.anchors[:, :3] + arms
            columns[:, k] = np.sum(legs * legs, axis=1).imag / 2e-30
        return columns


@pytest.mark.parametrize("seed", SEEDS)
def test_lengths_and_inverse(seed):
    kernel = Kernel(seed)
    rotation = Rotation.from_quat(kernel.pose[3:], scalar_first=True).as_matrix()
    expected = lengths_of(_Frame(kernel.anchors), kernel.pose[:3], rotation)
    legs = kernel.legs(kernel.pose)
    assert (
        np.abs(np.sqrt(legs[:, 6]) - expected).max()
        <= 1e-15 * np.abs(kernel.anchors).max() + 4e-16 * expected.max()
    )
    derivative = kernel.derivative(np.zeros(6))
    rounding = 1e-15 * np.linalg.cond(derivative)
    assert np.abs(kernel.inverse(kernel.pose) @ derivative - np.eye(6)).max() <= 10 * rounding


class _Frame:
    def __init__(self, anchors):
        self.base_anchors, self.platform_anchors = anchors[:, :3], anchors[:, 3:]


@pytest.mark.parametrize("seed", SEEDS)
def test_curvature_is_never_larger_than_its_bound(seed):
    """Brute force: the inverse times differences of the Jacobian, over distances, all over the ball."""
    kernel = Kernel(seed)
    bound, _ = kernel.curvature(kernel.pose)
    inverse = kernel.inverse(kernel.pose)
    radius = 2 * pose_equations.REACH / bound
    worst = 0.0
    for _ in range(60):
        one = kernel.step(radius * kernel.rng.uniform(0, 1))
        other = kernel.step(radius * kernel.rng.uniform(0, 1)) if kernel.rng.uniform() < 0.5 else one * 0.99
        change = inverse @ (kernel.derivative(one) - kernel.derivative(other))
        for _ in range(20):
            direction = kernel.step(1.0)
            worst = max(worst, kernel.norm(change @ direction) / kernel.norm(one - other))
    assert worst <= bound
    assert worst >= bound / 100  # and it is of some use


@pytest.mark.parametrize("seed", SEEDS)
def test_distance_is_no_less_than_that_of_the_step(seed):
    kernel = Kernel(seed)
    for size in (1e-8, 1e-3, 0.5, 2.0):
        step = kernel.step(size)
        step[3:] *= min(1, np.pi / np.linalg.norm(step[3:]))
        other = kernel.moved(kernel.pose, step)
        other[3:] *= kernel.rng.choice([-1, 1])
        distance = pose_equations.distance(kernel.pose, other, kernel.weight)
        assert kernel.norm(step) * (1 - 1e-6) - 1e-15 <= distance <= 1.2 * kernel.norm(step)


@pytest.mark.parametrize("seed", SEEDS)
def test_steps_move_a_pose_by_exponentials(seed):
    kernel = Kernel(seed)
    before = Rotation.from_quat(kernel.pose[3:], scalar_first=True)
    for size in (1e-9, 1e-5, 1e-2, 3.0):
        step = kernel.step(size)
        found = kernel.moved(kernel.pose, step)
        expected = Rotation.from_rotvec(step[3:]) * before
        turn = Rotation.from_quat(found[3:], scalar_first=True)
        assert (turn * expected.inv()).magnitude() <= 1e-15 * 4
        np.testing.assert_allclose(
            found[:3], kernel.pose[:3] + step[:3], rtol=0, atol=1e-15 * np.abs(found).max()
        )


def newton(kernel, wanted, pose, steps):
    """Errors in units of the first, Jacobian anew at each step."""
    errors = []
    for _ in range(steps):
        errors.append(pose_equations.distance(pose, kernel.pose, kernel.weight))
        right = np.empty(6)
        pose_equations.residuals(kernel.legs(pose), wanted, right)
        step = np.empty(6)
        inverse = np.ascontiguousarray(kernel.inverse(pose).T)
        pose_equations.newton_step(inverse, right, kernel.weight, step)
        pose = kernel.moved(pose, step)
    return errors


@pytest.mark.parametrize("seed", SEEDS)
def test_newton_converges_quadratically(seed):
    """Each error is at most K / 2 times the square of the one before; in the end that leaves rounding."""
    kernel = Kernel(seed)
    bound, spread = kernel.curvature(kernel.pose)
    wanted = np.sqrt(2 * kernel.halves(kernel.pose))
    # From the solution the bound holds at half a radius with half the reach: 1 / (1 - 0.45).
    errors = newton(kernel, wanted, kernel.moved(kernel.pose, kernel.step(pose_equations.REACH / bound)), 7)
    floor = spread * pose_equations.rounding(kernel.largest, kernel.pose)
    used = [k for k in range(6) if errors[k] > 100 * floor]
    assert len(used) >= 3
    for k in used:
        # 1.3: `distance` is up to an eighth too long.
        assert errors[k + 1] <= 1.3 * bound * errors[k] ** 2 / 2 / (1 - pose_equations.REACH) + floor
    assert errors[-1] <= floor


def test_newton_doubles_its_digits():
    """The same in 200 digits, where there is room to see it: exponents double at every step."""
    kernel = Kernel(3)
    with mpmath.workdps(200):
        anchors = mpmath.matrix(kernel.anchors.tolist())
        exact = mpmath.matrix(kernel.pose.tolist())
        wanted = _halves(anchors, exact)
        pose = mpmath.matrix(kernel.moved(kernel.pose, kernel.step(1e-2)).tolist())
        sizes = [_newton_step(anchors, wanted, pose) for _ in range(7)]
        digits = [float(-mpmath.log10(size)) for size in sizes]
    orders = np.diff(np.log2(digits[1:]))
    assert digits[-1] > 100
    assert np.abs(orders[1:] - 1).max() < 0.15


def _turned(pose):
    w, x, y, z = pose[3:]
    n = w * w + x * x + y * y + z * z
    return (
        mpmath.matrix(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )
        / n
    )


def _legs(anchors, pose):
    rotation = _turned(pose)
    for i in range(6):
        arm = rotation * anchors[i, 3:6].T
        yield mpmath.matrix([pose[k] - anchors[i, k] + arm[k] for k in range(3)]), arm


def _halves(anchors, pose):
    return [(leg.T * leg)[0] / 2 for leg, _ in _legs(anchors, pose)]


def _newton_step(anchors, wanted, pose):
    """Moves a pose by Newton's step; returns the largest part of it."""
    rows = mpmath.matrix(6, 6)
    for i, (leg, arm) in enumerate(_legs(anchors, pose)):
        for k in range(3):
            rows[i, k] = leg[k]
            rows[i, 3 + k] = arm[(k + 1) % 3] * leg[(k + 2) % 3] - arm[(k + 2) % 3] * leg[(k + 1) % 3]
    right = mpmath.matrix([w - h for w, h in zip(wanted, _halves(anchors, pose), strict=True)])
    step = mpmath.lu_solve(rows, right)
    for k in range(3):
        pose[k] += step[k]
    half = mpmath.sqrt(sum(step[3 + k] ** 2 for k in range(3))) / 2
    scale = mpmath.sin(half) / half / 2
    a, b, c, d = *(scale * step[3 + k] for k in range(3)), mpmath.cos(half)
    w, x, y, z = pose[3:]
    turned = (
        d * w - a * x - b * y - c * z,
        d * x + a * w + b * z - c * y,
        d * y + b * w + c * x - a * z,
        d * z + c * w + a * y - b * x,
    )
    for k in range(4):
        pose[3 + k] = turned[k]
    return max(abs(part) for part in step)


@pytest.mark.parametrize("seed", SEEDS)
def test_units_of_the_kernels(seed):
    mechanism = random_mechanism(seed)
    given, anchors, frame = geometry_of(mechanism.base_anchors, mechanism.platform_anchors)
    np.testing.assert_array_equal(given, np.hstack([mechanism.base_anchors, mechanism.platform_anchors]))
    assert np.abs(anchors.mean(axis=0)).max() < 1e-15 * np.abs(anchors).max() * 6
    assert np.log2(frame[6]) == round(np.log2(frame[6]))
    spread = np.sqrt(np.mean(np.sum(anchors[:, 3:] ** 2, axis=1)))
    assert 2**-0.5 <= spread <= 2**0.5
    assert frame[7] == pytest.approx(2.5 * spread)
    base, platform = np.linalg.norm(anchors[:, :3], axis=1), np.linalg.norm(anchors[:, 3:], axis=1)
    assert frame[8] == pytest.approx((base + platform).max())
    kernel = Kernel(seed)
    motion = random_motion(mechanism, seed, samples=1)
    lengths = lengths_of(mechanism, motion.position[0], motion.rotation[0])
    assert np.abs(np.sqrt(2 * kernel.halves(kernel.pose)) * frame[6] - lengths).max() <= 1e-14 * lengths.max()
