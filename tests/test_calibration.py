"""Derivatives of leg lengths by anchors and pose, and what a calibration finds with them."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.calibration import length_derivatives
from sixsps.mechanism import Mechanism

EPS = np.finfo(float).eps


def length(A, b, position, R):
    vector = [position[i] + mpmath.fdot(R[i], b) - A[i] for i in range(3)]
    return mpmath.sqrt(mpmath.fdot(vector, vector))


@pytest.mark.parametrize("seed", range(4))
def test_derivatives_by_anchors_are_those_of_60_digits(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed, 3)
    found = length_derivatives(mechanism, motion)
    with mpmath.workdps(60):
        step = mpmath.mpf(10) ** -25
        for sample in range(3):
            position, R = motion.position[sample].tolist(), motion.rotation[sample].tolist()
            for leg in range(6):
                anchors = [mechanism.base_anchors[leg].tolist(), mechanism.platform_anchors[leg].tolist()]
                for which, slopes in enumerate((found.by_base_anchors, found.by_platform_anchors)):
                    for axis in range(3):
                        moved = [[mpmath.mpf(x) for x in anchor] for anchor in anchors]
                        moved[which][axis] += step
                        up = length(*moved, position, R)
                        moved[which][axis] -= 2 * step
                        slope = (up - length(*moved, position, R)) / (2 * step)
                        # a unit vector out of coordinates some times as long as the leg
                        size = abs(motion.position[sample]).max() + abs(mechanism.base_anchors).max()
                        bound = 8 * EPS * (1 + size / found.lengths[sample, leg])
                        assert abs(slopes[sample, leg, axis] - slope) < bound


def test_derivatives_by_anchors_agree_with_the_pose():
    """To move all base anchors is to move the platform the other way."""
    mechanism = random_mechanism(7)
    motion = random_motion(mechanism, 7, 50)
    found = length_derivatives(mechanism, motion)
    assert_allclose(found.by_base_anchors, -found.by_pose[..., :3], rtol=0, atol=4 * EPS)
    in_world = np.einsum("nij,nkj->nki", motion.rotation, found.by_platform_anchors)
    assert_allclose(in_world, found.by_pose[..., :3], rtol=0, atol=8 * EPS)
    arms = np.einsum("nij,kj->nki", motion.rotation, mechanism.platform_anchors)
    moments = np.cross(arms, in_world)
    assert_allclose(moments, found.by_pose[..., 3:], rtol=0, atol=8 * EPS * abs(arms).max())


def test_errors_of_anchors_take_the_platform_where_forward_kinematics_finds_it():
    mechanism = Mechanism.load("wu2012")
    motion = at_rest([0.02, 0.1, 0.5], quaternion=[0.97, 0.1, -0.15, 0.1631])
    found = length_derivatives(mechanism, motion)
    rng = np.random.default_rng(5)
    for size in (1e-4, 1e-5):
        base, platform = size * rng.standard_normal((2, 6, 3))
        other = replace(
            mechanism,
            base_anchors=mechanism.base_anchors + base,
            platform_anchors=mechanism.platform_anchors + platform,
        )
        there = sixsps.forward_kinematics(other, found.lengths[0], motion)
        turned = Rotation.from_matrix(there.rotation @ motion.rotation[0].T).as_rotvec()
        moved = np.concatenate([there.position - motion.position[0], turned])
        expected = found.pose_by_anchors[0] @ np.concatenate([base.ravel(), platform.ravel()])
        # What is left is of second order: the square of the errors over lengths of 0.1 m, times cond(J).
        assert abs(moved - expected).max() < 50 * size**2 / 0.1 * np.linalg.cond(found.by_pose[0])
        assert abs(expected).max() > size


def test_a_calibration_finds_anchors_and_offsets():
    """Poses are measured, lengths have offsets and noise: Gauss-Newton finds what was wrong."""
    nominal = Mechanism.load("wu2012")
    rng = np.random.default_rng(11)
    truth = rng.normal(0, 5e-4, (6, 7))
    machine = replace(
        nominal,
        base_anchors=nominal.base_anchors + truth[:, :3],
        platform_anchors=nominal.platform_anchors + truth[:, 3:6],
    )
    poses = random_motion(nominal, 2, 60, tilt=0.3)
    noise = 1e-6
    measured = sixsps.inverse_kinematics(machine, poses).lengths + truth[:, 6]
    measured = measured + rng.normal(0, noise, measured.shape)

    def at(errors):
        errors = errors.reshape(6, 7)
        return replace(
            nominal,
            base_anchors=nominal.base_anchors + errors[:, :3],
            platform_anchors=nominal.platform_anchors + errors[:, 3:6],
        )

    def residuals(errors):
        lengths = sixsps.inverse_kinematics(at(errors), poses).lengths
        return (lengths + errors.reshape(6, 7)[:, 6] - measured).ravel()

    def slopes(errors):
        found = length_derivatives(at(errors), poses)
        blocks = np.zeros((len(poses), 6, 6, 7))
        legs = np.arange(6)
        blocks[:, legs, legs, :3] = found.by_base_anchors
        blocks[:, legs, legs, 3:6] = found.by_platform_anchors
        blocks[:, legs, legs, 6] = 1
        return blocks.reshape(-1, 42)

    done = least_squares(residuals, np.zeros(42), slopes, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    covariance = noise**2 * np.linalg.inv(done.jac.T @ done.jac)
    deviations = abs(done.x - truth.ravel()) / np.sqrt(np.diag(covariance))
    assert deviations.max() < 4.5  # of 42 normal variables; beyond with a probability of 3e-4
    assert np.sqrt(np.mean(done.fun**2)) == pytest.approx(noise * np.sqrt(1 - 42 / 360), rel=0.15)
