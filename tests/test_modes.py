"""Small vibrations and compliance, against derivations that share nothing with them but M."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism, scaled
from scipy.linalg import eigh, eigvals
from scipy.spatial.transform import Rotation

from sixsps import symbolic
from sixsps.bodies import Platform
from sixsps.dynamics import State, forward_dynamics
from sixsps.errors import InputError
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.modes import modes

NAMES = [*BUNDLED, *range(8)]


def drawn(name, turned=0.3):
    """A mechanism, a pose near home, unequal stiffnesses, force and moment."""
    mechanism = random_mechanism(name) if isinstance(name, int) else Mechanism.load(name)
    rng = np.random.default_rng(20 if isinstance(name, str) else name)
    size, weight = mechanism.characteristic_length, 10 * mechanism.platform.mass
    position = home_position(mechanism) + 0.1 * size * rng.standard_normal(3)
    rotation = Rotation.from_rotvec(turned * rng.standard_normal(3)).as_matrix()
    stiffness = 100 * weight / size * rng.uniform(0.5, 2, 6)
    force, moment = weight * rng.standard_normal(3), weight * size * rng.standard_normal(3)
    return mechanism, (position, rotation, stiffness), force, moment


def close(found, expected, tolerance, length):
    """Whether matrices by [displacement; rotation] agree, relative to the largest entry."""
    scale = np.repeat([1.0, 1 / length], 3)
    units = np.outer(scale, scale)
    largest = np.abs(units * expected).max()
    return np.abs(units * (found - expected)).max() <= tolerance * largest


def pose_slopes(mechanism, position, rotation, force, moment):
    """K_g as the exact derivative of what is missing at constant leg forces: J dF/d(pose)."""
    quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    still = at_rest(position, quaternion, force=force, moment=moment)
    by_pose = symbolic.evaluate(symbolic.force_derivatives(), mechanism, still)["by_pose"][0]
    return inverse_kinematics(mechanism, still).jacobian[0].T @ by_pose


@pytest.mark.parametrize("name", NAMES)
def test_geometric_stiffness_is_the_exact_derivative(name):
    mechanism, pose, force, moment = drawn(name)
    length = mechanism.characteristic_length
    exact = pose_slopes(mechanism, *pose[:2], force, np.zeros(3))
    found = modes(mechanism, *pose, force=force)
    assert close(exact, exact.T, 1e-11, length)
    assert close(found.geometric_stiffness, exact, 1e-11, length)
    twisted = pose_slopes(mechanism, *pose[:2], force, moment)
    found = modes(mechanism, *pose, force=force, moment=moment)
    assert close(found.geometric_stiffness, (twisted + twisted.T) / 2, 1e-11, length)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("loaded", [False, True])
def test_forward_dynamics_linearised_by_differences_has_the_same_modes(name, loaded):
    mechanism, (position, rotation, stiffness), force, moment = drawn(name)
    load = {"force": force, "moment": moment if loaded else np.zeros(3)}
    found = modes(mechanism, position, rotation, stiffness, **load)
    lengths = inverse_kinematics(mechanism, at_rest(position, quaternion(rotation))).lengths
    length = mechanism.characteristic_length

    def acceleration(step):
        turn = Rotation.from_rotvec(step[3:] / length).as_matrix() @ rotation
        state = State(*(np.atleast_2d(a) for a in (position + step[:3], quaternion(turn), *np.zeros((2, 3)))))
        there = inverse_kinematics(mechanism, at_rest(state.position[0], state.quaternion[0])).lengths
        forces = found.leg_forces - stiffness * (there - lengths)
        # A moment that keeps energy follows half of the turn.
        followed = load["moment"] + np.cross(step[3:] / length, load["moment"]) / 2
        result = forward_dynamics(mechanism, state, forces, force[None], followed[None])[0]
        return result * np.repeat([1, length], 3)

    size = 1e-5 * length
    assert np.abs(acceleration(np.zeros(6))).max() < 1e-8 * np.abs(stiffness).max()
    columns = [(acceleration(step) - acceleration(-step)) / (2 * size) for step in size * np.eye(6)]
    squares = np.sort(-eigvals(np.column_stack(columns)).real)
    expected = np.sign(found.frequencies) * (2 * np.pi * found.frequencies) ** 2
    np.testing.assert_allclose(squares, expected, atol=1e-7 * np.abs(expected).max())


def quaternion(rotation):
    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def test_heave_of_a_symmetric_hexapod_by_hand():
    mechanism = Mechanism.load("wu2012")
    home, k = home_position(mechanism), 3e5
    leg = home + mechanism.platform_anchors[0] - mechanism.base_anchors[0]
    l = np.linalg.norm(leg)  # noqa: E741
    up, across = (leg[2] / l) ** 2, 1 - (leg[2] / l) ** 2
    lower, upper = mechanism.legs[0].lower, mechanism.legs[0].upper
    moving = (
        upper.mass * (up + (1 - upper.com / l) ** 2 * across) + lower.mass * (lower.com / l) ** 2 * across
    )
    mass = mechanism.platform.mass + 6 * (moving + (lower.transverse + upper.transverse) * across / l**2)
    found = modes(mechanism, home, np.eye(3), k, preload=False)
    heave = np.abs(found.proportions - np.eye(6)[:, [2]]).max(axis=0).argmin()
    assert found.proportions[2, heave] == 1
    assert found.frequencies[heave] == pytest.approx(np.sqrt(6 * k * up / mass) / (2 * np.pi), rel=1e-12)
    assert found.compliance()[2, 2] == pytest.approx(1 / (6 * k * up), rel=1e-12)


def test_frequencies_grow_with_the_root_of_the_stiffness():
    mechanism, (position, rotation, k), force, _ = drawn(3)
    free = modes(mechanism, position, rotation, k, preload=False).frequencies
    np.testing.assert_allclose(
        modes(mechanism, position, rotation, 9 * k, preload=False).frequencies, 3 * free, rtol=1e-11
    )
    # A given preload matters less and less to stiffer actuators.
    stiff = [modes(mechanism, position, rotation, factor * k, force=force) for factor in (1e4, 1e6)]
    shifts = [
        np.abs(found.frequencies / (root * free) - 1).max()
        for found, root in zip(stiff, (1e2, 1e3), strict=True)
    ]
    assert shifts[1] == pytest.approx(shifts[0] / 100, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_modes_are_orthogonal_and_solve_the_equation(name):
    mechanism, pose, force, moment = drawn(name)
    found = modes(mechanism, *pose, force=force, moment=moment)
    shapes, squares = found.shapes, np.sign(found.frequencies) * (2 * np.pi * found.frequencies) ** 2
    np.testing.assert_allclose(shapes.T @ found.mass_matrix @ shapes, np.eye(6), atol=1e-11)
    stiffness = shapes.T @ found.stiffness_matrix @ shapes
    np.testing.assert_allclose(stiffness, np.diag(squares), atol=1e-11 * np.abs(squares).max())
    assert (np.diff(found.frequencies) >= 0).all()
    assert np.abs(found.proportions).max(axis=0) == pytest.approx(np.ones(6))


@pytest.mark.parametrize("name", NAMES)
class TestCompliance:
    def test_is_reciprocal(self, name):
        mechanism, pose, force, _ = drawn(name)
        found = modes(mechanism, *pose, force=force)
        point = 0.3 * mechanism.characteristic_length * np.array([1, -2, 0.5])
        r = found.rotation @ point
        # Loads at the point as wrenches about O1, and what they do there, by the law of levers.
        answers = []
        for load in np.eye(6):
            wrench = np.hstack([load[:3], load[3:] + np.cross(r, load[:3])])
            moved = np.linalg.solve(found.stiffness_matrix, wrench)
            answers.append(np.hstack([moved[:3] + np.cross(moved[3:], r), moved[3:]]))
        length = 1 / mechanism.characteristic_length
        assert close(np.column_stack(answers), np.array(answers), 1e-10, length)
        assert close(found.compliance(point), np.column_stack(answers), 1e-10, length)
        assert np.array_equal(found.compliance(point), found.compliance(point).T)

    def test_of_the_actuators_alone_is_that_of_their_lengths(self, name):
        mechanism, (position, rotation, k), *_ = drawn(name)
        found = modes(mechanism, position, rotation, k, preload=False)
        jacobian = inverse_kinematics(mechanism, at_rest(position, quaternion(rotation))).jacobian[0]
        inverse = np.linalg.inv(jacobian)
        expected = inverse @ np.diag(1 / k) @ inverse.T
        assert close(found.compliance(), expected, 1e-9, 1 / mechanism.characteristic_length)


def test_without_legs_the_platform_vibrates_alone():
    mechanism, (position, rotation, k), *_ = drawn(2)
    legs = [
        replace(leg, **{
            half: replace(link, mass=1e-12, transverse=1e-12, axial=1e-13)
            for half, link in (("lower", leg.lower), ("upper", leg.upper))
        })
        for leg in mechanism.legs
    ]  # fmt: skip
    bare = replace(mechanism, legs=tuple(legs), gravity=np.zeros(3))
    found = modes(bare, position, rotation, k)
    platform = mechanism.platform
    jacobian = inverse_kinematics(bare, at_rest(position, quaternion(rotation))).jacobian[0]
    # About the centre of mass, where a free body's mass matrix falls apart.
    shift = np.eye(6)
    r = rotation @ platform.com
    shift[:3, 3:] = [[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]]
    to_com = jacobian @ np.linalg.inv(shift)
    mass = np.zeros((6, 6))
    mass[:3, :3], mass[3:, 3:] = platform.mass * np.eye(3), rotation @ platform.inertia @ rotation.T
    squares = eigh(to_com.T @ np.diag(k) @ to_com, mass, eigvals_only=True)
    np.testing.assert_allclose(2 * np.pi * found.frequencies, np.sqrt(squares), rtol=1e-8)


def test_pushing_lowers_and_pulling_raises_the_frequencies():
    mechanism = Mechanism.load("wu2012")
    pose = (home_position(mechanism), np.eye(3), 1e6)
    pushed, free, pulled = (
        modes(mechanism, *pose, force=[0, 0, load]).frequencies for load in (-1e4, 0, 1e4)
    )
    assert (pushed < free).all()
    assert (free < pulled).all()
    assert modes(mechanism, *pose, force=[0, 0, -1e6]).frequencies[0] < 0


def test_nothing_depends_on_how_the_world_is_turned():
    mechanism, (position, rotation, k), force, moment = drawn(5)
    Q, far = Rotation.random(rng=7).as_matrix(), np.array([3.0, -2.0, 5.0])
    turned = replace(
        mechanism, base_anchors=mechanism.base_anchors @ Q.T + far, gravity=Q @ mechanism.gravity
    )
    here = modes(mechanism, position, rotation, k, force=force, moment=moment)
    there = modes(turned, Q @ position + far, Q @ rotation, k, force=Q @ force, moment=Q @ moment)
    np.testing.assert_allclose(there.frequencies, here.frequencies, rtol=1e-9)
    both = np.kron(np.eye(2), Q)
    expected = both @ here.compliance([0.1, 0.2, 0.3]) @ both.T
    assert close(there.compliance([0.1, 0.2, 0.3]), expected, 1e-9, 1 / mechanism.characteristic_length)


def test_units_of_length_and_mass_do_not_matter():
    mechanism, (position, rotation, k), *_ = drawn(6)
    here = modes(mechanism, position, rotation, k, preload=False)
    there = modes(scaled(mechanism, 1e3, 1e-3), 1e3 * position, rotation, 1e-3 * k, preload=False)
    np.testing.assert_allclose(there.frequencies, here.frequencies, rtol=1e-10)
    assert there.compliance()[0, 0] == pytest.approx(1e3 * here.compliance()[0, 0], rel=1e-9)


def test_the_point_where_the_frame_sits_does_not_matter():
    """O1 moved within the platform: the same body, so the same frequencies and compliance."""
    mechanism, (position, rotation, k), force, moment = drawn(1)
    moved = np.array([0.2, -0.1, 0.3]) * mechanism.characteristic_length
    platform = mechanism.platform
    other = replace(
        mechanism,
        platform_anchors=mechanism.platform_anchors - moved,
        platform=Platform(platform.mass, platform.com - moved, platform.inertia),
    )
    here = modes(mechanism, position, rotation, k, force=force, moment=moment)
    there = modes(other, position + rotation @ moved, rotation, k, force=force, moment=moment)
    np.testing.assert_allclose(there.frequencies, here.frequencies, rtol=1e-9)
    length = 1 / mechanism.characteristic_length
    assert close(there.compliance(-moved), here.compliance(), 1e-9, length)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"stiffness": 0.0}, r"stiffness: 0\.0; allowed: > 0 \[N/m\]"),
        ({"stiffness": [1e6] * 5 + [-1]}, r"stiffness: -1\.0; allowed: > 0"),
        ({"stiffness": [1e6] * 3}, r"stiffness: shape \(3,\); allowed: shape \(6\)"),
        ({"stiffness": "stiff"}, "stiffness: stiff; allowed: a number"),
        ({"position": [0.01, 0.02, 0.0]}, r"pose: cond\(J\) = .*; allowed: a pose that is not singular"),
        ({"position": [0, 0, np.nan]}, "position"),
        ({"rotation": 2 * np.eye(3)}, "rotation: .*; allowed: a rotation matrix"),
        ({"rotation": -np.eye(3)}, "allowed: a rotation matrix"),
        ({"force": [0, 0]}, "force: shape"),
        ({"moment": [0, 0, np.inf]}, "moment"),
    ],
)
def test_what_cannot_be_is_refused(changed, says):
    good = {"position": [0, 0.2, 0.45], "rotation": np.eye(3), "stiffness": 1e6}
    modes(Mechanism.load("wu2012"), **good)
    with pytest.raises(InputError, match=says):
        modes(Mechanism.load("wu2012"), **(good | changed))


class TestCommand:
    def run(self, *arguments, **options):
        command = [sys.executable, "-m", "compare", "modes", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, **options)

    def test_table_fits_a_terminal(self):
        done = self.run("wu2012", "--stiffness", "1e6")
        assert (done.returncode, done.stderr) == (0, "")
        lines = done.stdout.splitlines()
        assert max(map(len, lines)) <= 80
        assert lines[4].split() == ["mode", "Hz", "x", "y", "z", "rx", "ry", "rz"]
        mechanism = Mechanism.load("wu2012")
        expected = modes(mechanism, home_position(mechanism), np.eye(3), 1e6)
        shown = np.array([line.split() for line in lines[5:11]], dtype=float)
        np.testing.assert_allclose(shown[:, 1], expected.frequencies, rtol=1e-5)
        heave = np.array([line.split()[-4:-3] for line in lines[-6:]], dtype=float)
        np.testing.assert_allclose(heave[2], expected.compliance()[2, 2], rtol=1e-3)

    def test_json_holds_what_python_gives(self, tmp_path):
        arguments = ["--pose", "-0.02,0.01,0.6,0.1,-0.2,0.3", "--stiffness", "1e6,2e6,3e6,1e6,2e6,3e6"]
        arguments += [
            "--point",
            "0,0,0.1",
            "--force",
            "-80,0,10",
            "--json",
            "--output",
            tmp_path / "modes.json",
        ]
        done = self.run("wu2012", *arguments)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        content = json.loads((tmp_path / "modes.json").read_text())
        expected = modes(
            Mechanism.load("wu2012"),
            [-0.02, 0.01, 0.6],
            Rotation.from_euler("XYZ", [0.1, -0.2, 0.3]).as_matrix(),
            np.array([1, 2, 3, 1, 2, 3]) * 1e6,
            force=[-80, 0, 10],
        )
        assert content["frequencies_Hz"] == pytest.approx(expected.frequencies.tolist())
        assert content["pose"]["euler_rad"] == pytest.approx([0.1, -0.2, 0.3])
        np.testing.assert_allclose(content["compliance"]["matrix"], expected.compliance([0, 0, 0.1]))
        assert content["stable"] is True
        assert content["leg_forces_N"] == pytest.approx(expected.leg_forces.tolist())

    def test_preload_can_be_left_out_and_can_be_too_much(self):
        heavy = ["wu2012", "--stiffness", "1e4", "--force", "0,0,-1e5"]
        done = self.run(*heavy)
        assert done.returncode == 0
        assert "not stable" in done.stdout
        assert "compliance at" not in done.stdout
        done = self.run(*heavy, "--no-preload", "--json")
        content = json.loads(done.stdout)
        assert content["stable"] is True
        assert not np.any(content["geometric_stiffness"])

    @pytest.mark.parametrize(
        ("arguments", "says"),
        [
            ([], "Missing option '--stiffness'"),
            (["--stiffness", "-1"], "stiffness: -1.0; allowed: > 0 [N/m]"),
            (["--stiffness", "1,2"], "--stiffness: 1,2; allowed: 1 or 6 finite numbers"),
            (["--stiffness", "1e6", "--pose", "0,0,x,0,0,0"], "--pose: 0,0,x,0,0,0; allowed: 6 finite"),
            (["--stiffness", "1e6", "--pose", "0.01,0.02,0,0,0,0"], "pose: cond(J) ="),
            (["--stiffness", "1e6", "--point", "0,inf,0"], "--point: 0,inf,0; allowed: 3 finite numbers"),
            (["--stiffness", "1e6", "--output", "nowhere/modes.txt"], "nowhere/modes.txt: output"),
        ],
    )
    def test_bad_options_are_refused_in_one_line(self, arguments, says, tmp_path):
        done = self.run("wu2012", *arguments, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert len(done.stderr.splitlines()) == 1
        assert says in done.stderr
        assert list(tmp_path.iterdir()) == []
