"""Motion made in Python, from all its columns or from poses alone: what it keeps, estimates and refuses."""

import dataclasses
import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from cases import DERIVATIVES, FIELDS, still, times, wobble

from sixsps.differentiation import differentiate
from sixsps.errors import MotionError
from sixsps.motion import Motion

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
CONSTRUCTORS = {
    "time shape": ({"time": np.zeros((4, 1))}, "time: shape (4, 1); allowed: shape (n)"),
    "time repeats": ({"time": [0, 1, 1, 2]}, "t, index 2: 1.0 after 1.0; allowed: times that strictly"),
    "time NaN": ({"time": [0, 1, math.nan, 2]}, "time[2]: nan; allowed: finite numbers"),
    "position shape": ({"position": np.zeros((3, 3))}, "position: shape (3, 3); allowed: shape ("),
    "position transposed": ({"position": np.zeros((3, 4))}, "position: shape (3, 4)"),
    "position flat": ({"position": np.zeros(3)}, "position: shape (3,)"),
    "position text": ({"position": "home"}, "position: home; allowed: numbers"),
    "velocity shape": ({"velocity": np.zeros((4, 6))}, "velocity: shape (4, 6)"),
    "acceleration infinite": ({"acceleration": np.full((4, 3), math.inf)}, "acceleration[0, 0]: inf"),
    "angular NaN": (
        {"angular_velocity": [[0, 0, 0]] * 3 + [[0, math.nan, 0]]},
        "angular_velocity[3, 1]: nan",
    ),
    "force for one sample": ({"force": np.zeros((1, 3))}, "force: shape (1, 3)"),
    "moment ragged": ({"moment": [[0, 0, 0]] * 3 + [[0]]}, "moment"),
    "quaternion shape": ({"quaternion": np.zeros((4, 3))}, "quaternion: shape (4, 3)"),
    "quaternion zero": ({"quaternion": [[1, 0, 0, 0]] * 3 + [[0] * 4]}, "quaternion, index 3: length 0"),
    "quaternion doubled": ({"quaternion": [[2, 0, 0, 0]] * 4}, "length 2; allowed: length 1 within 0.001"),
    "quaternion huge": ({"quaternion": [[1e200, 0, 0, 0]] * 4}, "quaternion"),
}


@pytest.mark.parametrize(("fields", "says"), CONSTRUCTORS.values(), ids=CONSTRUCTORS)
def test_a_motion_that_cannot_be_is_refused_by_the_constructor(fields, says):
    with pytest.raises(MotionError) as caught:
        still(**fields)
    assert says in str(caught.value)


def test_a_motion_is_frozen_and_copies_what_it_is_given():
    position = np.zeros((4, 3))
    moving = still(position=position)
    position[0, 0] = 7
    assert moving.position[0, 0] == 0
    for array in (*(getattr(moving, name) for name in FIELDS), moving.rotation, moving[1:].velocity):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(FrozenInstanceError):
        moving.name = "other"


def test_from_poses_estimates_what_is_missing_and_keeps_what_is_given():
    time = times(200)
    exact = wobble(time)
    rng = np.random.default_rng(7)
    force, moment = rng.standard_normal((2, 200, 3))
    motion = Motion.from_poses(
        time, exact.position, exact.quaternion, force=force, moment=moment, cutoff=9.0, name="wobble"
    )
    found = differentiate(time, exact.position, exact.quaternion, 9.0)
    assert motion.name == "wobble"
    assert set(motion.estimated) == set(DERIVATIVES)
    for name, expected in (("position", exact.position), ("quaternion", exact.quaternion)):
        np.testing.assert_array_equal(getattr(motion, name), expected)
    for name, expected in (("force", force), ("moment", moment)):
        np.testing.assert_array_equal(getattr(motion, name), expected)
    for field in DERIVATIVES:
        np.testing.assert_array_equal(getattr(motion, field), getattr(found, field))


def test_from_poses_without_orientation_does_not_turn():
    time = times(50)
    motion = Motion.from_poses(time.tolist(), wobble(time).position.tolist())
    np.testing.assert_array_equal(motion.quaternion, np.tile(IDENTITY, (50, 1)))
    np.testing.assert_allclose(motion.angular_velocity, 0, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(motion.force, np.zeros((50, 3)))


def test_six_samples_are_enough_and_five_are_not():
    time = np.arange(6.0)
    position = np.outer(time**2, [1.0, -2.0, 0.5])
    motion = Motion.from_poses(time, position)
    # A parabola passes any smoothing.
    np.testing.assert_allclose(motion.acceleration, np.tile([2.0, -4.0, 1.0], (6, 1)), rtol=0, atol=1e-8)
    with pytest.raises(MotionError, match="5 samples without derivatives; allowed: at least 6 samples"):
        Motion.from_poses(time[:5], position[:5])
    with pytest.raises(MotionError, match="1 samples without derivatives"):
        Motion.from_poses(time[:1], position[:1])


@pytest.mark.parametrize("cutoff", [0.0, -1.0, np.nan, np.inf, -np.inf])
def test_impossible_cutoffs_are_refused(cutoff):
    time = times(50)
    with pytest.raises(MotionError, match=r"cutoff: .*allowed: a finite frequency > 0"):
        Motion.from_poses(time, wobble(time).position, cutoff=cutoff)


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"time": [0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0]}, "t, index 3"),
        ({"time": [0.0, 1.0, 2.0, np.nan, 3.0, 4.0, 5.0]}, "time"),
        ({"position": np.zeros((7, 2))}, "position"),
        ({"position": np.zeros((6, 3))}, "position"),
        ({"position": np.full((7, 3), np.inf)}, "position"),
        ({"quaternion": np.zeros((7, 4))}, "quaternion"),
        ({"quaternion": np.ones((7, 3)) / np.sqrt(3)}, "quaternion"),
        ({"quaternion": np.tile(1.002 * IDENTITY, (7, 1))}, "quaternion, index 0"),
        ({"force": np.zeros((6, 3))}, "force"),
        ({"time": 1.0}, "time"),
        ({"time": ["a"] * 7}, "time"),
        ({"position": [["a", "b", "c"]] * 7}, "position"),
    ],
)
def test_unusable_poses_are_refused(changed, place):
    poses = {"time": np.arange(7.0), "position": np.zeros((7, 3)), "quaternion": np.tile(IDENTITY, (7, 1))}
    with pytest.raises(MotionError) as caught:
        Motion.from_poses(**(poses | changed))
    assert place in caught.value.place


def test_no_samples_at_all_give_empty_arrays():
    import sixsps
    from sixsps import symbolic

    mechanism = sixsps.Mechanism.load("wu2012")
    nothing = still()[:0]
    assert sixsps.inverse_kinematics(mechanism, nothing).lengths.shape == (0, 6)
    assert sixsps.inverse_dynamics(mechanism, nothing).shape == (0, 6)
    assert sixsps.inverse_dynamics(mechanism, nothing, formulation="casadi").shape == (0, 6)
    assert symbolic.evaluate(symbolic.equations(), mechanism, nothing)["J"].shape == (0, 6, 6)


@pytest.mark.parametrize("name", ["position", "velocity", "acceleration", "angular_velocity"])
def test_what_has_no_default_is_not_taken_as_zero(name):
    with pytest.raises(MotionError, match=name):
        dataclasses.replace(still(), **{name: None})


def test_comes_back_from_a_pickle_frozen_and_with_its_matrices():
    import pickle

    motion = still()
    assert motion.rotation.shape == (len(motion), 3, 3)
    again = pickle.loads(pickle.dumps(motion))
    assert again.sha256 == motion.sha256
    assert np.array_equal(again.__dict__["rotation"], motion.rotation)
    for array in (again.position, again.rotation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
