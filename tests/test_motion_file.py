"""Motion files: columns to motion and back bit for bit, derivatives given or estimated."""

import math

import numpy as np
import pytest
from cases import DERIVATIVES, FIELDS, still
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from texts import (
    ACCELERATIONS,
    AWKWARD,
    FORMATS,
    TWIST,
    loaded_or_refused,
    motion_refusal,
    numbered,
    put,
    row,
    table,
)

from sixsps.motion import Motion

QUATERNION = ("qw", "qx", "qy", "qz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


def poses(n=40, **columns):
    return table(n, **dict.fromkeys((*TWIST, *ACCELERATIONS)) | columns)


def bits(motion):
    return [np.ascontiguousarray(getattr(motion, name), dtype="<f8").tobytes() for name in FIELDS]


# Beyond 1e50 the squares and products of a mechanism's numbers are no floats any more.
NUMBER = st.floats(min_value=-1e50, max_value=1e50)
TIMES = st.lists(NUMBER, min_size=2, max_size=5, unique=True)


@st.composite
def motions(draw):
    time = sorted(draw(TIMES))
    n = len(time)
    rows = st.lists(st.tuples(NUMBER, NUMBER, NUMBER), min_size=n, max_size=n)
    turns = draw(st.lists(st.integers(0, 2**32 - 1), min_size=n, max_size=n))
    quaternion = np.array([Rotation.random(rng=turn).as_quat(scalar_first=True) for turn in turns])
    off = np.array(draw(st.lists(st.floats(-9e-4, 9e-4), min_size=n, max_size=n)))
    vectors = {name: draw(rows) for name in FIELDS if name not in ("time", "quaternion")}
    return Motion(time=time, quaternion=quaternion * (1 + off[:, None]), **vectors)


@pytest.mark.parametrize("form", FORMATS)
@settings(max_examples=60)
@given(drawn=motions())
@example(drawn=still(position=AWKWARD, velocity=-AWKWARD, force=AWKWARD[::-1]))
def test_saving_and_loading_gives_the_same_motion_bit_for_bit(tmp_path_factory, form, drawn):
    path = tmp_path_factory.getbasetemp() / f"again.{form}"
    drawn.save(path)
    again = Motion.load(path)
    assert bits(again) == bits(drawn)
    assert again.sha256 == drawn.sha256
    assert dict(again.estimated) == {}


@given(st.lists(NUMBER, min_size=2, max_size=20))
@example(AWKWARD.ravel().tolist())
def test_a_float_written_by_python_is_read_as_that_float(tmp_path_factory, values):
    n = len(values)
    loaded = Motion.load(put(tmp_path_factory.getbasetemp(), table(n, x=values)))
    assert loaded.position[:, 0].tobytes() == np.array(values).tobytes()


@pytest.mark.parametrize("form", FORMATS)
def test_columns_may_stand_in_any_order(tmp_path, form):
    rng = np.random.default_rng(0)
    columns = {name: rng.standard_normal(5) for name in ("x", "y", "z", *TWIST, *ACCELERATIONS, *WRENCH)}
    columns |= {"t": np.arange(5.0)}
    quaternion = Rotation.random(5, rng=rng).as_quat(scalar_first=True)
    columns |= dict(zip(QUATERNION, quaternion.T, strict=True))
    names = list(columns)
    for order in (names, names[::-1], sorted(names), list(rng.permutation(names))):
        loaded = Motion.load(put(tmp_path, {str(name): columns[name] for name in order}, form))
        assert_array_equal(loaded.time, columns["t"])
        assert_array_equal(loaded.position, np.column_stack([columns[name] for name in ("x", "y", "z")]))
        assert_array_equal(loaded.quaternion, quaternion)
        for parts, group in (
            (("velocity", "angular_velocity"), TWIST),
            (("acceleration", "angular_acceleration"), ACCELERATIONS),
            (("force", "moment"), WRENCH),
        ):
            both = np.hstack([getattr(loaded, part) for part in parts])
            assert_array_equal(both, np.column_stack([columns[name] for name in group]))


@pytest.mark.parametrize("form", FORMATS)
def test_euler_angles_turn_about_x_then_the_new_y_then_the_new_z(tmp_path, form):
    angles = np.random.default_rng(1).uniform(-4, 4, (50, 3))
    angles[:3] = [[0, math.pi / 2, 0], [0.3, -math.pi / 2, 0.2], [math.pi, 0, -math.pi]]
    names = ("alpha", "beta", "gamma")
    loaded = Motion.load(put(tmp_path, table(50, **dict(zip(names, angles.T, strict=True))), form))
    alpha, beta, gamma = (Rotation.from_euler("xyz"[i], angles[:, [i]]) for i in range(3))
    assert_allclose(loaded.rotation, (alpha * beta * gamma).as_matrix(), rtol=0, atol=1e-14)
    # and so that no change of scipy's convention goes unseen
    a, b, c = angles[7]
    assert loaded.rotation[7][0] == pytest.approx(
        [math.cos(b) * math.cos(c), -math.cos(b) * math.sin(c), math.sin(b)], abs=1e-14
    )
    assert loaded.rotation[7][1, 2] == pytest.approx(-math.sin(a) * math.cos(b), abs=1e-14)


def test_orientation_absent_is_identity_and_wrench_absent_is_zero(tmp_path):
    loaded = Motion.load(put(tmp_path, table(3)))
    assert_array_equal(loaded.quaternion, [[1, 0, 0, 0]] * 3)
    assert_array_equal(loaded.rotation, [np.eye(3)] * 3)
    assert_array_equal(loaded.force, np.zeros((3, 3)))
    assert_array_equal(loaded.moment, np.zeros((3, 3)))
    assert loaded.name == "path"


@pytest.mark.parametrize("norm", [1 - 9.9e-4, 1 - 1e-9, 1 + 9.9e-4])
def test_a_quaternion_slightly_off_unit_length_is_stored_as_given(tmp_path, norm):
    quaternion = norm * Rotation.random(4, rng=2).as_quat(scalar_first=True)
    columns = table(4, **dict(zip(QUATERNION, quaternion.T, strict=True)))
    loaded = Motion.load(put(tmp_path, columns))
    assert loaded.quaternion.tobytes() == np.ascontiguousarray(quaternion).tobytes()
    assert_allclose(loaded.rotation @ loaded.rotation.transpose(0, 2, 1), [np.eye(3)] * 4, atol=1e-14)
    assert_allclose(loaded.rotation, Rotation.random(4, rng=2).as_matrix(), atol=1e-14)


@pytest.mark.parametrize("norm", [0.0, 1 - 1.01e-3, 1 + 1.01e-3, -2.0, 1e30])
@pytest.mark.parametrize("derivatives", [table, poses])
def test_a_quaternion_off_unit_length_is_refused_with_its_row(tmp_path, norm, derivatives):
    w = np.ones(8)
    w[5] = norm
    columns = derivatives(8, **dict(zip(QUATERNION, [w, 0 * w, 0 * w, 0 * w], strict=True)))
    message = motion_refusal(put(tmp_path, columns))
    assert message.startswith("quaternion, row 6 (line 7): length ")
    assert message.endswith("; allowed: length 1 within 0.001")


def test_a_quaternion_too_large_to_square_is_refused_without_a_warning(tmp_path):
    columns = table(3, qw=[1, 1e200, 1], qx=np.zeros(3), qy=np.zeros(3), qz=np.zeros(3))
    assert ", row 2 (line 3): " in motion_refusal(put(tmp_path, columns))


@pytest.mark.parametrize("form", FORMATS)
def test_given_derivatives_are_used_as_they_are_however_wrong(tmp_path, form):
    rng = np.random.default_rng(3)
    given_values = {name: rng.standard_normal(30) for name in (*TWIST, *ACCELERATIONS)}
    loaded = Motion.load(put(tmp_path, table(30, **given_values), form))
    twist = np.hstack([loaded.velocity, loaded.angular_velocity])
    accelerations = np.hstack([loaded.acceleration, loaded.angular_acceleration])
    assert_array_equal(twist, np.column_stack([given_values[name] for name in TWIST]))
    assert_array_equal(accelerations, np.column_stack([given_values[name] for name in ACCELERATIONS]))
    assert dict(loaded.estimated) == {}


@pytest.mark.parametrize(
    ("given_group", "fields"),
    [(TWIST, ("velocity", "angular_velocity")), (ACCELERATIONS, ("acceleration", "angular_acceleration"))],
)
def test_only_the_derivatives_that_are_missing_are_estimated_and_said_to_be(tmp_path, given_group, fields):
    values = np.random.default_rng(4).standard_normal((40, 6))
    columns = poses(40, **dict(zip(given_group, values.T, strict=True)))
    loaded = Motion.load(put(tmp_path, columns))
    assert_array_equal(np.hstack([getattr(loaded, name) for name in fields]), values)
    assert set(loaded.estimated) == set(DERIVATIVES) - set(fields)
    assert all(how.strip() for how in loaded.estimated.values())


@pytest.mark.parametrize("form", FORMATS)
def test_missing_derivatives_are_estimated_from_the_poses(tmp_path, form):
    t = np.linspace(0, 2, 401)
    angle = 0.4 * np.sin(3 * t)
    half = [np.cos(angle / 2), 0 * t, 0 * t, np.sin(angle / 2)]
    columns = poses(401, t=t, x=np.sin(2 * t), z=t**2, **dict(zip(QUATERNION, half, strict=True)))
    loaded = Motion.load(put(tmp_path, columns, form))
    assert set(loaded.estimated) == set(DERIVATIVES)
    zero = 0 * t
    for name, expected in (
        ("velocity", [2 * np.cos(2 * t), zero, 2 * t]),
        ("acceleration", [-4 * np.sin(2 * t), zero, zero + 2]),
        ("angular_velocity", [zero, zero, 1.2 * np.cos(3 * t)]),
        ("angular_acceleration", [zero, zero, -3.6 * np.sin(3 * t)]),
    ):
        assert_allclose(getattr(loaded, name)[20:-20], np.column_stack(expected)[20:-20], atol=1e-3)


def test_estimated_derivatives_are_given_once_they_are_saved(tmp_path):
    first = Motion.load(put(tmp_path, poses()))
    first.save(tmp_path / "full.csv")
    again = Motion.load(tmp_path / "full.csv")
    assert bits(again) == bits(first)
    assert set(first.estimated) == set(DERIVATIVES)
    assert dict(again.estimated) == {}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("last", [0.2, 0.1, -5.0])
@pytest.mark.parametrize("derivatives", [table, poses])
def test_times_that_do_not_increase_are_refused_with_their_row(tmp_path, form, last, derivatives):
    t = np.array([0, 0.1, 0.2, last, 0.4, 0.5, 0.6, 0.7])
    message = numbered(motion_refusal(put(tmp_path, derivatives(8, t=t), form)), form)
    assert message == f"t, {row(4, form)}: {last} after 0.2; allowed: times that strictly increase [s]"


BAD_COLUMNS = {
    "without t": ({"t": None}, ["column t", "missing", "seconds"]),
    "without x, y, z": ({"x": None, "y": None, "z": None}, ["x, y, z", "missing", "metres"]),
    "without z": ({"z": None}, ["z missing", "x, y, z"]),
    "without wy": ({"wy": None}, ["wy missing", "vx, vy, vz, wx, wy, wz"]),
    "ax only": (dict.fromkeys(ACCELERATIONS[1:]), ["ay, az, ex, ey, ez missing"]),
    "fz only": ({"fz": np.ones(8)}, ["fx, fy, mx, my, mz missing"]),
    "no qz": ({"qw": np.ones(8), "qx": np.zeros(8), "qy": np.zeros(8)}, ["qz missing"]),
    "alpha only": ({"alpha": np.zeros(8)}, ["beta, gamma missing"]),
    "two orientations": (
        {name: np.full(8, name == "qw", dtype=float) for name in (*QUATERNION, "alpha", "beta", "gamma")},
        ["quaternion and Euler angles", "only one"],
    ),
    "unknown": ({"pressure": np.zeros(8)}, ["column: pressure", "t, x, y, z, qw"]),
    "capital": ({"X": np.zeros(8)}, ["column: X", "t, x, y, z, qw"]),
    "without a name": ({"": np.zeros(8)}, ["column: without a name"]),
}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("changes", "says"), BAD_COLUMNS.values(), ids=BAD_COLUMNS)
def test_columns_that_make_no_motion_are_refused(tmp_path, form, changes, says):
    message = motion_refusal(put(tmp_path, table(8, **changes), form))
    for words in says:
        assert words in message


def test_two_rows_are_enough_with_derivatives_and_six_without(tmp_path):
    assert len(Motion.load(put(tmp_path, table(2)))) == 2
    assert len(Motion.load(put(tmp_path, poses(6)))) == 6
    message = motion_refusal(put(tmp_path, poses(5)))
    assert "5 samples" in message
    assert "at least 6" in message


@pytest.mark.parametrize("cutoff", [0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("derivatives", [table, poses])
def test_a_cutoff_that_is_no_frequency_is_refused(tmp_path, cutoff, derivatives):
    message = motion_refusal(put(tmp_path, derivatives(20)), cutoff=cutoff)
    assert message.startswith("cutoff: ")


@pytest.mark.parametrize("cutoff", [5e-324, 1e-300, 1e-20, 1e-5, 1e5, 1e20, 1e300])
def test_an_extreme_cutoff_is_obeyed_or_refused(tmp_path, cutoff):
    path = put(tmp_path, poses(20, x=np.sin(np.arange(20.0))))
    loaded, refused = loaded_or_refused(path, cutoff=cutoff)
    if refused:
        assert "cutoff" in refused
    else:
        assert np.isfinite(loaded.acceleration).all()


RECORDINGS = {
    "steps of 1e-300 s": np.arange(20) * 1e-300,
    "steps below the smallest normal number": np.arange(20) * 1e-320,
    "steps of 1e300 s": np.arange(20) * 1e300,
    "a pause of a year": np.r_[np.arange(10.0), 3e7 + np.arange(10)],
    "a pause of a million years": np.r_[np.arange(10.0), 3e13 + np.arange(10)],
    "a burst": np.r_[np.arange(10) * 1e-12, np.arange(1, 11)],
    "epoch times": 1.7e9 + np.arange(20) / 100,
}


@pytest.mark.parametrize("t", RECORDINGS.values(), ids=RECORDINGS)
def test_any_increasing_times_give_finite_derivatives_or_a_refusal(tmp_path, t):
    path = put(tmp_path, poses(20, t=t, x=np.sin(np.arange(20.0))))
    loaded, refused = loaded_or_refused(path)
    if refused:
        assert refused.startswith(f"{path}: ")
    else:
        assert len(loaded.estimated) == 4


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e40, 1e160, 1e308])
def test_any_finite_positions_give_finite_derivatives_or_a_refusal(tmp_path, size):
    path = put(tmp_path, poses(20, x=size * np.sin(np.arange(20.0))))
    loaded, refused = loaded_or_refused(path)
    if refused:
        assert refused.startswith(f"{path}: ")
    else:
        assert len(loaded.estimated) == 4


def test_the_hash_is_of_the_numbers_whatever_the_file(tmp_path):
    moving = still(position=AWKWARD)
    for form in FORMATS:
        moving.save(tmp_path / f"path.{form}")
        assert Motion.load(tmp_path / f"path.{form}").sha256 == moving.sha256
    assert still().sha256 != moving.sha256
