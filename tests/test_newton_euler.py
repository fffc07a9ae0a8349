"""Newton-Euler: the forces in actuators and joints, against balances, Pinocchio and hand calculation."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from cases import BUNDLED, at_rest, random_mechanism, random_motion
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.bodies import Leg, Link
from sixsps.formulations.newton_euler import inverse_dynamics, joint_reactions
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.motion import Motion
from sixsps.trajectories import bundled, sinusoids

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Two evaluations of the same forces differ by this many cond(J) unit roundoffs at most; 8 was seen.
FACTOR = 20
G = 9.81


def assert_same(mechanism, motion, found, expected):
    """Equal to rounding, sample by sample, relative to the sample's largest leg force or reaction."""
    growth = inverse_kinematics(mechanism, motion).error_growth
    found, expected = found.reshape(len(motion), -1), expected.reshape(len(motion), -1)
    forces = inverse_dynamics(mechanism, motion)
    scale = np.abs(np.hstack([forces, expected])).max(axis=1)
    error = np.abs(found - expected).max(axis=1)
    assert np.all(error <= FACTOR * UNIT_ROUNDOFF * growth * scale)


@pytest.mark.parametrize("seed", range(50))
def test_agrees_with_kane_on_random_mechanisms(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed + 1000, tilt=1.0)
    expected = sixsps.inverse_dynamics(mechanism, motion, "kane")
    assert_same(mechanism, motion, inverse_dynamics(mechanism, motion), expected)


def test_is_a_formulation_by_name(mechanism):
    motion = bundled("circle", mechanism, 30)
    forces = sixsps.inverse_dynamics(mechanism, motion, "newton-euler")
    assert np.array_equal(forces, inverse_dynamics(mechanism, motion))
    assert np.array_equal(forces, joint_reactions(mechanism, motion).forces)


def wander(mechanism, seed):
    """Five instants 1 ms apart of a motion that is smooth, with a wrench that changes."""
    rng = np.random.default_rng(seed)
    size = 0.1 * mechanism.characteristic_length
    motion = sinusoids(
        0.3 + 1e-3 * np.arange(-2, 3),
        center=[*home_position(mechanism), *rng.uniform(-0.3, 0.3, 3)],
        amplitude=rng.uniform(0.5, 1, 6) * ([size] * 3 + [0.2] * 3),
        frequency=rng.uniform(0.3, 1, 6),
        phase=rng.uniform(0, 6, 6),
    )
    load = 10 * mechanism.platform.mass * rng.standard_normal((2, 5, 3))
    return replace(motion, force=load[0], moment=load[1] * mechanism.characteristic_length)


def rate(values):
    """Time derivative in the middle of five instants 1 ms apart."""
    return np.tensordot([1, -8, 0, 8, -1], values, axes=1) / 12e-3


def assert_close(found, expected, scale):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(scale).max())


@pytest.fixture(params=[*BUNDLED, *range(10)])
def moving(request):
    """Mechanism, five instants of a motion, the legs' kinematics, the reactions at the third instant."""
    name = request.param
    mechanism = random_mechanism(name) if isinstance(name, int) else sixsps.Mechanism.load(name)
    motion = wander(mechanism, 7)
    return mechanism, motion, inverse_kinematics(mechanism, motion), joint_reactions(mechanism, motion)


class TestBalances:
    """Momenta of positions and velocities, differentiated in time, against the forces found."""

    def test_each_leg(self, moving):
        mechanism, _, legs, found = moving
        m_d, m_u = mechanism.lower.mass[:, None], mechanism.upper.mass[:, None]
        r_d = mechanism.lower.com[:, None] * legs.directions
        r_u = legs.leg_vectors - mechanism.upper.com[:, None] * legs.directions
        momentum = m_d * legs.lower_velocity + m_u * legs.upper_velocity
        a, b = found.base[2], found.platform[2]
        weights = m_d * mechanism.gravity, m_u * mechanism.gravity
        assert_close(a + b + sum(weights), rate(momentum), a)
        transverse = (mechanism.lower.transverse + mechanism.upper.transverse)[:, None]
        about_base_joint = (
            np.cross(r_d, m_d * legs.lower_velocity)
            + np.cross(r_u, m_u * legs.upper_velocity)
            + transverse * legs.leg_angular_velocity
        )
        moment = (
            np.cross(legs.leg_vectors[2], b) + np.cross(r_d[2], weights[0]) + np.cross(r_u[2], weights[1])
        )
        assert_close(moment, rate(about_base_joint), a * legs.lengths.max())

    def test_each_link_along_its_leg(self, moving):
        """The actuator pushes the upper link out and the lower link back."""
        mechanism, _, legs, found = moving
        s = legs.directions[2]
        for reaction, link, velocity, sign in (
            (found.base, mechanism.lower, legs.lower_velocity, -1),
            (found.platform, mechanism.upper, legs.upper_velocity, 1),
        ):
            mass = link.mass[:, None]
            force = reaction[2] + mass * mechanism.gravity + sign * found.forces[2][:, None] * s
            along = np.sum((force - rate(mass * velocity)) * s, axis=-1)
            assert_close(along, 0, found.forces[2])

    def test_platform(self, moving):
        mechanism, motion, legs, found = moving
        momentum, about_origin, arm = platform_momenta(mechanism, motion)
        on_platform = -found.platform[2]
        load = mechanism.platform.mass * mechanism.gravity + motion.force[2]
        assert_close(on_platform.sum(axis=0) + load, rate(momentum), on_platform)
        anchors = motion.position[2] + legs.arms[2]
        moment = np.cross(anchors, on_platform).sum(axis=0) + np.cross(arm[2], load) + motion.moment[2]
        assert_close(moment, rate(about_origin), on_platform * np.abs(anchors).max())

    def test_whole_mechanism_stands_on_its_base(self, moving):
        mechanism, motion, legs, found = moving
        momentum, _, _ = platform_momenta(mechanism, motion)
        momentum = momentum + np.einsum("k,nki->ni", mechanism.lower.mass, legs.lower_velocity)
        momentum = momentum + np.einsum("k,nki->ni", mechanism.upper.mass, legs.upper_velocity)
        mass = mechanism.platform.mass + mechanism.lower.mass.sum() + mechanism.upper.mass.sum()
        base = found.base[2].sum(axis=0)
        assert_close(base + mass * mechanism.gravity + motion.force[2], rate(momentum), found.base[2])


def platform_momenta(mechanism, motion):
    """Momentum, moment of momentum about the world's origin, and the centre of mass."""
    platform, R, omega = mechanism.platform, motion.rotation, motion.angular_velocity
    arm = R @ platform.com
    momentum = platform.mass * (motion.velocity + np.cross(omega, arm))
    spin = np.einsum("nij,jk,nlk,nl->ni", R, platform.inertia, R, omega)
    return momentum, spin + np.cross(motion.position + arm, momentum), motion.position + arm


class OpenTree:
    """The tree cut at the platform joints, built in Pinocchio joint by joint; world at the base."""

    def __init__(self, pin, mechanism):
        self.pin, self.model = pin, pin.Model()
        model, here = self.model, pin.SE3.Identity()
        model.gravity.linear = np.array(mechanism.gravity)
        self.balls, self.rods = [], []
        for leg, anchor in zip(mechanism.legs, mechanism.base_anchors, strict=True):
            place = pin.SE3(np.eye(3), np.array(anchor))
            self.balls.append(model.addJoint(0, pin.JointModelSpherical(), place, "ball"))
            self.rods.append(model.addJoint(self.balls[-1], pin.JointModelPZ(), here, "rod"))
            for joint, link, com in (
                (self.balls[-1], leg.lower, leg.lower.com),
                (self.rods[-1], leg.upper, -leg.upper.com),
            ):
                inertia = np.diag([link.transverse, link.transverse, link.axial])
                body = pin.Inertia(link.mass, np.array([0, 0, com]), inertia)
                model.appendBodyToJoint(joint, body, here)
        self.platform = model.addJoint(0, pin.JointModelFreeFlyer(), here, "platform")
        self.com = np.array(mechanism.platform.com)
        body = pin.Inertia(mechanism.platform.mass, self.com, np.array(mechanism.platform.inertia))
        model.appendBodyToJoint(self.platform, body, here)
        frames = [(rod, np.zeros(3)) for rod in self.rods]
        frames += [(self.platform, np.array(anchor)) for anchor in mechanism.platform_anchors]
        for number, (joint, place) in enumerate(frames):
            frame = pin.Frame(f"end {number}", joint, pin.SE3(np.eye(3), place), pin.FrameType.OP_FRAME)
            model.addFrame(frame)
        self.ends = [model.getFrameId(f"end {number}") for number in range(12)]
        self.data = model.createData()

    def state(self, motion, legs, k):
        """q, v and a of sample k, and what turns world axes into those of each leg."""
        q, v, a, turns = [], [], [], []
        for leg in range(6):
            turn = Rotation.align_vectors([legs.directions[k, leg]], [[0, 0, 1]])[0]
            turns.append(turn.as_matrix().T)
            q += [*turn.as_quat(), legs.lengths[k, leg]]
            v += [*turns[-1] @ legs.leg_angular_velocity[k, leg], legs.length_rates[k, leg]]
            a += [*turns[-1] @ legs.leg_angular_acceleration[k, leg], legs.length_accelerations[k, leg]]
        to_body = motion.rotation[k].T
        velocity, omega = to_body @ motion.velocity[k], to_body @ motion.angular_velocity[k]
        q += [*motion.position[k], *np.roll(motion.quaternion[k], -1)]
        v += [*velocity, *omega]
        # A free-flyer's acceleration is spatial: the classical one less omega x v.
        a += [*to_body @ motion.acceleration[k] - np.cross(omega, velocity)]
        a += [*to_body @ motion.angular_acceleration[k]]
        return np.array(q), np.array(v), np.array(a), turns

    def closed(self, motion, legs, k):
        """Leg forces, and forces on the legs at base and platform joints, of sample k."""
        pin, model, data = self.pin, self.model, self.data
        q, v, a, turns = self.state(motion, legs, k)
        load, moment = motion.rotation[k].T @ motion.force[k], motion.rotation[k].T @ motion.moment[k]
        external = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
        external[self.platform] = pin.Force(load, moment + np.cross(self.com, load))
        tau = pin.rnea(model, data, q, v, a, external)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobians = [pin.getFrameJacobian(model, data, end, world)[:3] for end in self.ends]
        matrix = np.zeros((model.nv, 24))
        matrix[[model.joints[rod].idx_v for rod in self.rods], range(6)] = 1
        for leg in range(6):
            matrix[:, 6 + 3 * leg : 9 + 3 * leg] = (jacobians[leg] - jacobians[6 + leg]).T
        solution, *_ = np.linalg.lstsq(matrix, tau)
        multipliers = solution[6:].reshape(6, 3)
        for rod, turn, force in zip(self.rods, turns, multipliers, strict=True):
            external[rod] = pin.Force(turn @ force, np.zeros(3))
        pin.rnea(model, data, q, v, a, external)
        base = [turn.T @ data.f[ball].linear for ball, turn in zip(self.balls, turns, strict=True)]
        return solution[:6], np.array(base), multipliers


@pytest.mark.parametrize("name", [*BUNDLED, *range(20)])
def test_equals_the_closure_forces_of_a_tree_in_pinocchio(name):
    pin = pytest.importorskip("pinocchio")
    random = isinstance(name, int)
    mechanism = random_mechanism(name) if random else sixsps.Mechanism.load(name)
    motion = random_motion(mechanism, name) if random else bundled("spiral", mechanism, 5)
    tree, legs = OpenTree(pin, mechanism), inverse_kinematics(mechanism, motion)
    samples = [tree.closed(motion, legs, k) for k in range(len(motion))]
    forces, base, platform = (np.array(values) for values in zip(*samples, strict=True))
    found = joint_reactions(mechanism, motion)
    assert_same(mechanism, motion, found.forces, forces)
    assert_same(mechanism, motion, found.base, base)
    assert_same(mechanism, motion, found.platform, platform)


def test_massless_legs_carry_no_force_across():
    light = Link(1e-14, 1.0, 0.5, 1e-14, 1e-15)
    mechanism = replace(random_mechanism(3), legs=(Leg(light, light),) * 6)
    motion = random_motion(mechanism, 3)
    found = joint_reactions(mechanism, motion)
    push = found.forces[..., None] * inverse_kinematics(mechanism, motion).directions
    scale = np.abs(push).max()
    np.testing.assert_allclose(found.base, push, atol=1e-12 * scale)
    np.testing.assert_allclose(found.platform, -push, atol=1e-12 * scale)


LOWER, UPPER = Link(3.0, 1.0, 0.4, 0.3, 0.01), Link(2.0, 1.0, 0.5, 0.2, 0.01)
LENGTH = 1.6
# A beam on two supports: moments about A of 3 kg at 0.4 m and 2 kg at 1.1 m.
AT_TIP = (3.0 * 0.4 + 2.0 * 1.1) * G / LENGTH


@pytest.mark.parametrize(
    ("direction", "base", "platform"),
    [
        ([1, 0, 0], lambda F: [F, 0, 5 * G - AT_TIP], lambda F: [-F, 0, AT_TIP]),
        ([0, 0, 1], lambda F: [0, 0, 3 * G + F], lambda F: [0, 0, 2 * G - F]),
        ([0, 0, -1], lambda F: [0, 0, 3 * G - F], lambda F: [0, 0, 2 * G + F]),
    ],
    ids=["lies", "stands", "hangs"],
)
def test_heavy_leg_at_rest_by_hand(direction, base, platform):
    other = random_mechanism(5)
    position = home_position(other)
    anchors = np.array(other.base_anchors)
    anchors[0] = position + other.platform_anchors[0] - LENGTH * np.array(direction)
    legs = (Leg(LOWER, UPPER), *other.legs[1:])
    mechanism = replace(other, gravity=[0, 0, -G], base_anchors=anchors, legs=legs)
    found = joint_reactions(mechanism, at_rest(position, force=[3.0, 4.0, 5.0]))
    F = found.forces[0, 0]
    scale = np.abs(found.base).max()
    np.testing.assert_allclose(found.base[0, 0], base(F), atol=1e-13 * scale)
    np.testing.assert_allclose(found.platform[0, 0], platform(F), atol=1e-13 * scale)


@pytest.mark.parametrize("seed", range(10))
def test_reactions_turn_with_a_world_frame_that_is_turned_and_far_away(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    rotation = Rotation.random(rng=np.random.default_rng(seed))

    def turned(vectors):
        return vectors @ rotation.as_matrix().T

    shift = 1e4 * mechanism.characteristic_length * np.array([1.0, -2.0, 0.5])
    moved = replace(
        mechanism,
        gravity=turned(mechanism.gravity),
        base_anchors=turned(mechanism.base_anchors) + shift,
    )
    vectors = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
    moved_motion = Motion(
        time=motion.time,
        position=turned(motion.position) + shift,
        quaternion=(rotation * Rotation.from_matrix(motion.rotation)).as_quat(scalar_first=True),
        **{name: turned(getattr(motion, name)) for name in vectors},
    )
    here, there = joint_reactions(mechanism, motion), joint_reactions(moved, moved_motion)
    assert_same(moved, moved_motion, there.forces, here.forces)
    for joint in ("base", "platform"):
        expected = turned(getattr(here, joint))
        assert_same(moved, moved_motion, getattr(there, joint), expected)


def test_long_motions_are_done_in_blocks(wu2012):
    motion = bundled("sinusoids", wu2012, 2500)
    seen = []
    found = joint_reactions(wu2012, motion, seen.append)
    assert seen == [1024, 2048, 2500]
    tail = joint_reactions(wu2012, motion[2000:])
    assert_same(wu2012, motion[2000:], found.forces[2000:], tail.forces)
    assert_same(wu2012, motion[2000:], found.base[2000:], tail.base)
    assert_same(wu2012, motion[2000:], found.platform[2000:], tail.platform)


def with_flat_sample(motion, sample):
    position = np.array(motion.position)
    position[sample] = [0.01, 0.02, 0.0]
    return replace(motion, position=position)


def test_singular_samples_are_nan_and_the_others_are_not(wu2012):
    found = joint_reactions(wu2012, with_flat_sample(bundled("line", wu2012, 5), 2))
    for values in (found.forces, found.base, found.platform):
        assert np.isnan(values[2]).all()
        assert np.isfinite(np.delete(values, 2, axis=0)).all()


def test_leg_of_no_length_is_nan(wu2012):
    found = joint_reactions(wu2012, at_rest(wu2012.base_anchors[0] - wu2012.platform_anchors[0]))
    for values in (found.forces, found.base, found.platform):
        assert np.isnan(values).all()


COLUMNS = ["t", *(f"f{leg}" for leg in range(1, 7))]
COLUMNS += [f"{joint}{leg}{axis}" for joint in "ab" for leg in range(1, 7) for axis in "xyz"]


def write_forces(*arguments):
    command = [sys.executable, "-m", "compare", "forces", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


class TestCommand:
    @pytest.mark.parametrize("engine", [[], ["--engine", "newton-euler"]])
    def test_reactions_read_back_exactly(self, engine, tmp_path):
        mechanism = sixsps.Mechanism.load("tsai2000")
        motion = bundled("sinusoids", mechanism, 40)
        found = joint_reactions(mechanism, motion)
        expected = np.hstack(
            [motion.time[:, None], found.forces, found.base.reshape(40, 18), found.platform.reshape(40, 18)]
        )
        path = tmp_path / "forces.csv"
        arguments = ["tsai2000", "sinusoids", "--samples", 40, "--reactions", *engine, "--output", path]
        done = write_forces(*arguments)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        assert path.read_text().splitlines()[0].split(",") == COLUMNS
        assert np.array_equal(np.genfromtxt(path, delimiter=",", skip_header=1), expected)

    def test_forces_are_those_of_the_engine(self, tmp_path):
        paths = tmp_path / "with.parquet", tmp_path / "without.parquet"
        motion = ["wu2012", "circle", "--samples", 30]
        assert write_forces(*motion, "--reactions", "--output", paths[0]).returncode == 0
        assert write_forces(*motion, "--engine", "newton-euler", "--output", paths[1]).returncode == 0
        tables = [pq.read_table(path) for path in paths]
        assert tables[0].column_names == COLUMNS
        assert tables[0].select(COLUMNS[:7]).equals(tables[1])

    def test_singular_sample_is_nan_with_status_1(self, tmp_path, wu2012):
        with_flat_sample(bundled("line", wu2012, 3), 1).save(tmp_path / "flat.csv")
        path = tmp_path / "forces.csv"
        done = write_forces("wu2012", tmp_path / "flat.csv", "--reactions", "--output", path)
        assert done.returncode == 1
        assert "sample 2 at t = 1 s is singular: cond(J) is" in done.stderr
        table = np.genfromtxt(path, delimiter=",", skip_header=1)
        assert table.shape == (3, 43)
        assert np.isnan(table[1, 1:]).all()
        assert np.isfinite(table[[0, 2]]).all()

    def test_nothing_but_singular_samples(self, tmp_path, wu2012):
        with_flat_sample(bundled("line", wu2012, 2), slice(None)).save(tmp_path / "flat.csv")
        path = tmp_path / "forces.csv"
        done = write_forces("wu2012", tmp_path / "flat.csv", "--reactions", "--output", path)
        assert done.returncode == 1
        assert len(done.stderr.splitlines()) == 2
        assert np.isnan(np.genfromtxt(path, delimiter=",", skip_header=1)[:, 1:]).all()

    @pytest.mark.parametrize("engine", ["kane", "pinocchio", "nonsense"])
    def test_other_engines_are_bad_input(self, engine, tmp_path):
        path = tmp_path / "forces.csv"
        done = write_forces("wu2012", "line", "--engine", engine, "--reactions", "--output", path)
        assert done.returncode == 2
        assert done.stderr == (
            f"sixsps: --engine: {engine}; allowed: newton-euler with --reactions, no other gives them\n"
        )
        assert not path.exists()
