"""Derivatives of the compiled forces against certified and Kane's differences, to rounding times cond(J)."""

import dataclasses

import numpy as np
import pytest
from cases import FIELDS, random_mechanism
from certified_slopes import coarse, coarse_motion, slopes, translation_slopes
from differences import slope
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Largest error of a column, relative to its largest entry, in unit roundoffs times `error_growth`: 27 was
# seen, in columns that are small beside those that rounding comes from.
FACTOR = 100


def assert_columns(found, expected, growth):
    """Each column of (6, m) derivatives to what rounding of coordinates and cond(J) allow."""
    errors = np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)
    assert np.all(errors <= FACTOR * UNIT_ROUNDOFF * growth), errors / UNIT_ROUNDOFF / growth


@pytest.mark.parametrize("seed", range(6))
def test_derivatives_are_the_certified_ones(seed):
    mechanism = random_mechanism(seed)
    motion = coarse_motion(mechanism, seed)
    found = sixsps.compile(mechanism).inverse_dynamics_derivatives(motion)
    growth = inverse_kinematics(mechanism, motion).error_growth[0]
    for block, expected in slopes(mechanism, motion).items():
        assert_columns(getattr(found, block)[0], expected, growth)


def near_singular(seed, condition):
    """A coarse sample that has been moved along a line to where it has about this condition number."""
    mechanism = random_mechanism(seed)
    motion, grid = coarse_motion(mechanism, seed), np.linspace(-3, 3, 121)
    rng = np.random.default_rng(seed)
    while True:
        direction = mechanism.characteristic_length * rng.standard_normal(3)
        signs = np.sign(determinants(mechanism, motion, direction, grid))
        changes = np.flatnonzero(signs[1:] != signs[:-1])
        if len(changes):
            break
    low, high = grid[changes[0]], grid[changes[0] + 1]
    while low < (middle := (low + high) / 2) < high:
        same = determinants(mechanism, motion, direction, [middle])[0] * signs[changes[0]] > 0
        low, high = (middle, high) if same else (low, middle)
    # Close by, the condition number is in inverse proportion to the distance.
    known = 1e-4
    close = inverse_kinematics(mechanism, moved(motion, direction, [low - known]))
    place = moved(motion, direction, [low - known * close.condition[0] / condition])
    return mechanism, dataclasses.replace(motion, position=coarse(place.position, 44))


def moved(motion, direction, distances):
    """One sample, moved along a line to each of these distances."""
    count = len(distances)
    arrays = {name: np.repeat(getattr(motion, name), count, axis=0) for name in FIELDS}
    arrays |= {"time": np.arange(count), "position": motion.position + np.outer(distances, direction)}
    return dataclasses.replace(motion, **arrays)


def determinants(mechanism, motion, direction, distances):
    return np.linalg.det(inverse_kinematics(mechanism, moved(motion, direction, distances)).jacobian)


@pytest.mark.parametrize("condition", [1e5, 1e7, 1e9, 1e11])
@pytest.mark.parametrize("seed", [0, 1, 3])
def test_derivatives_keep_their_digits_near_singularities(seed, condition):
    """No more is lost than cond(J) unit roundoffs, though the forces that they hold have lost as much."""
    mechanism, motion = near_singular(seed, condition)
    legs = inverse_kinematics(mechanism, motion)
    assert legs.condition[0] == pytest.approx(condition, rel=0.2)
    found = sixsps.compile(mechanism).inverse_dynamics_derivatives(motion)
    # Steps short beside the distance to the singularity, and none that would not be exact.
    exponent = max(int(np.log2(mechanism.characteristic_length / condition / 32)), -49)
    expected = translation_slopes(mechanism, motion, exponent)
    assert_columns(found.by_pose[0][:, :3], expected, legs.error_growth[0])
    for block, columns in slopes(mechanism, motion, -3, poses=False).items():
        assert_columns(getattr(found, block)[0], columns, legs.error_growth[0])


def changed(motion, name, change):
    return dataclasses.replace(motion, **{name: getattr(motion, name) + change})


def turned(motion, vector):
    rotation = Rotation.from_rotvec(vector) * Rotation.from_matrix(motion.rotation)
    return dataclasses.replace(motion, quaternion=rotation.as_quat(scalar_first=True))


@pytest.mark.parametrize("trajectory", ["sinusoids", "spiral"])
def test_derivatives_along_a_motion_are_differences_of_kane(mechanism, trajectory):
    """Eighth-order differences: of step^8 and unit roundoff over the step, both below 1e-9 of the forces."""
    motion = bundled(trajectory, mechanism, 9)
    found = sixsps.compile(mechanism).inverse_dynamics_derivatives(motion)
    size = mechanism.characteristic_length
    pairs = {
        "by_twist": ("velocity", "angular_velocity"),
        "by_acceleration": ("acceleration", "angular_acceleration"),
        "by_wrench": ("force", "moment"),
    }
    load = 10 * mechanism.platform.mass
    units = {"by_twist": (1, 1 / size), "by_acceleration": (10, 10 / size), "by_wrench": (load, load * size)}
    for axis in range(3):
        along = np.eye(3)[axis]

        def kane(change, axis=axis, along=along):
            return slope(lambda h: sixsps.inverse_dynamics(mechanism, change(h * along)))

        numeric = kane(lambda step: changed(motion, "position", 0.1 * size * step))
        assert_close(0.1 * size * found.by_pose[..., axis], numeric)
        numeric = kane(lambda step: turned(motion, 0.1 * step))
        assert_close(0.1 * found.by_pose[..., 3 + axis], numeric)
        for block, names in pairs.items():
            for half, (name, unit) in enumerate(zip(names, units[block], strict=True)):
                numeric = kane(lambda step, name=name, unit=unit: changed(motion, name, unit * step))
                assert_close(unit * getattr(found, block)[..., 3 * half + axis], numeric)


def assert_close(exact, numeric):
    assert np.abs(exact - numeric).max() <= 1e-9 * np.abs(numeric).max()
