"""Crossings of singular poses between samples, against the same path sampled finely."""

from dataclasses import replace

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism, random_motion, scaled
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singular_poses.crossings import singularity_crossings
from sixsps.singular_poses.nearest import singularity_distance
from sixsps.trajectories import bundled, quintic


def signs_along(mechanism, motion, k, fine):
    """Signs of det J on the path from sample k to the next, at tau in `fine`, by other means."""
    step = motion.time[k + 1] - motion.time[k]
    position = CubicHermiteSpline([0, step], motion.position[k : k + 2], motion.velocity[k : k + 2])
    first, last = (Rotation.from_quat(motion.quaternion[i], scalar_first=True) for i in (k, k + 1))
    turn = (last * first.inv()).as_rotvec()
    # The rate of the rotation vector at the end, by differences: d(exp(x))/dt = omega x.
    h, omega = 1e-6, motion.angular_velocity[k + 1]
    ahead, behind = (Rotation.from_rotvec(s * h * omega) * Rotation.from_rotvec(turn) for s in (1, -1))
    rate = (ahead.as_rotvec() - behind.as_rotvec()) / (2 * h)
    vector = CubicHermiteSpline([0, step], [np.zeros(3), turn], [motion.angular_velocity[k], rate])
    turns = Rotation.from_rotvec(vector(fine * step)) * first
    zero = np.zeros((len(fine), 3))
    there = Motion(
        time=np.arange(len(fine)),
        position=position(fine * step),
        quaternion=turns.as_quat(scalar_first=True),
        velocity=zero, angular_velocity=zero, acceleration=zero, angular_acceleration=zero,
    )  # fmt: skip
    return np.sign(np.linalg.det(inverse_kinematics(mechanism, there).jacobian))


def through(mechanism, samples, turn=3.0):
    """A turn about the vertical from home, through the singular pose that every hexapod has there."""
    home = home_position(mechanism)
    shift = 0.3 * mechanism.characteristic_length * np.array([0.5, 0, 1.0])
    return quintic(np.linspace(0, 1, samples), home, home + shift, [0.2, 0.1, turn])


@pytest.mark.parametrize("name", [*BUNDLED, *range(4)])
def test_every_change_of_sign_is_found(name):
    """Also several between two samples, which follow each other in unrelated states."""
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    motion = random_motion(mechanism, 5, samples=9, tilt=1.0)
    found = singularity_crossings(mechanism, motion)
    fine = np.linspace(0, 1, 4001)
    several = 0
    for k in range(len(motion) - 1):
        changes = np.flatnonzero(np.diff(signs_along(mechanism, motion, k, fine)))
        tau = (found.time[found.interval == k] - motion.time[k]) / (motion.time[k + 1] - motion.time[k])
        assert np.array_equal(np.floor(tau * 4000), changes)
        several += len(changes) > 1
    assert several
    assert (np.diff(found.time) > 0).all()


@pytest.mark.parametrize("name", [*BUNDLED, *range(4)])
def test_poses_found_are_singular_and_do_not_depend_on_the_sampling(name):
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    coarse, fine = (sixsps.singularity_crossings(mechanism, through(mechanism, n)) for n in (50, 2000))
    assert len(coarse.time) >= 1
    assert len(coarse.time) == len(fine.time)
    np.testing.assert_allclose(coarse.time, fine.time, atol=1e-5)
    poses = at_rest(fine.position[0], Rotation.from_matrix(fine.rotation[0]).as_quat(scalar_first=True))
    legs = inverse_kinematics(mechanism, poses)
    assert legs.condition[0] > 1e12
    assert not len(fine.undecided)


@pytest.mark.parametrize("name", BUNDLED)
@pytest.mark.parametrize("motion", ["line", "sinusoids", "quintic"])
def test_motions_that_meet_none_are_certain_to(name, motion):
    mechanism = Mechanism.load(name)
    for samples in (5, 300):
        found = singularity_crossings(mechanism, bundled(motion, mechanism, samples))
        assert not found
        assert len(found.undecided) == len(found.singular_samples) == len(found.time) == 0


class TestComingClose:
    """A motion that comes up to the set of singular poses and goes back, between two samples."""

    def approach(self, beyond):
        """Straight towards the nearest singular pose and back; turns `beyond` of the way to it."""
        mechanism = random_mechanism(3)
        start = random_motion(mechanism, 3, samples=1, tilt=0.2)
        nearest = singularity_distance(mechanism, start)
        way = nearest.position[0] - start.position[0]
        turn = Rotation.from_matrix(nearest.rotation[0] @ start.rotation[0].T).as_rotvec()
        # With these rates at both ends the cubic is 4 tau (1 - tau) times `beyond`.
        rates = np.array([1.0, -1.0])[:, None] * 4 * beyond
        zero = np.zeros((2, 3))
        motion = Motion(
            time=[0.0, 1.0],
            position=np.repeat(start.position, 2, axis=0),
            quaternion=np.repeat(start.quaternion, 2, axis=0),
            velocity=rates * way, angular_velocity=rates * turn, acceleration=zero, angular_acceleration=zero,
        )  # fmt: skip
        return mechanism, motion

    def test_through_it_is_two_crossings(self):
        mechanism, motion = self.approach(1.02)
        found = singularity_crossings(mechanism, motion)
        tau = (1 - np.sqrt(1 - 1 / 1.02)) / 2
        np.testing.assert_allclose(found.time, [tau, 1 - tau], rtol=1e-6)
        assert found.interval.tolist() == [0, 0]
        assert not len(found.undecided)

    def test_short_of_it_is_none(self):
        found = singularity_crossings(*self.approach(0.98))
        assert not found

    def test_touching_is_not_ruled_out(self):
        mechanism, motion = self.approach(1.0)
        found = singularity_crossings(mechanism, motion)
        assert found
        assert len(found.undecided) + len(found.time) > 0


class TestSingularSamples:
    def test_are_told_apart_from_crossings(self):
        mechanism = Mechanism.load("wu2012")
        heights = np.array([0.4, 0.2, 0.0, -0.2, -0.4])
        zero = np.zeros((5, 3))
        motion = Motion(
            time=np.arange(5.0),
            position=np.column_stack([zero[:, :2] + 0.01, heights]),
            velocity=np.tile([0, 0, -0.2], (5, 1)),
            angular_velocity=zero, acceleration=zero, angular_acceleration=zero,
        )  # fmt: skip
        found = singularity_crossings(mechanism, motion)
        assert found.singular_samples.tolist() == [2]
        assert len(found.time) == len(found.undecided) == 0
        assert found
        others = singularity_crossings(mechanism, motion[np.array([0, 1, 3, 4])])
        assert others.time == pytest.approx([2.0])
        assert others.interval.tolist() == [1]

    def test_all_along_come_to_an_end(self):
        """Halving all of such a path twenty times would take hours."""
        mechanism = Mechanism.load("wu2012")
        n = 100
        time, zero = np.linspace(0, 1, n), np.zeros((n, 3))
        position = np.column_stack([0.1 * time, 0.1 * time**2, np.zeros(n)])
        motion = Motion(
            time=time, position=position, velocity=np.gradient(position, time, axis=0),
            angular_velocity=zero, acceleration=zero, angular_acceleration=zero,
        )  # fmt: skip
        found = singularity_crossings(mechanism, motion)
        assert len(found.singular_samples) == n
        assert len(found.time) == 0
        lifted = replace(motion, position=position + [0, 0, 1e-9])
        above = singularity_crossings(mechanism, lifted)
        assert len(above.time) == 0


def test_units_do_not_matter():
    mechanism = random_mechanism(1)
    motion = through(mechanism, 30)
    found = singularity_crossings(mechanism, motion)
    other = replace(motion, position=39.37 * motion.position, velocity=39.37 * motion.velocity)
    inches = singularity_crossings(scaled(mechanism, 39.37, 1.0), other)
    np.testing.assert_allclose(inches.time, found.time, rtol=1e-9)
    np.testing.assert_allclose(inches.position, 39.37 * found.position, rtol=1e-9)


@pytest.mark.parametrize("samples", [0, 1])
def test_there_is_nothing_between_fewer_than_two_samples(samples):
    mechanism = Mechanism.load("wu2012")
    motion = bundled("line", mechanism, 5)[:samples]
    assert not singularity_crossings(mechanism, motion)
