import dataclasses
import importlib
import math

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled
from urdf.layout import Layout

dartpy = pytest.importorskip("dartpy")
dart = importlib.import_module("compare.engines.dart")
Dart, DartUps = dart.Dart, dart.DartUps


@pytest.fixture(params=[Dart, DartUps])
def engine(request):
    return request.param


@pytest.fixture(params=["wu2012", 0, 1])
def any_mechanism(request):
    if isinstance(request.param, str):
        return sixsps.Mechanism.load(request.param)
    return random_mechanism(request.param)


def skeleton_of(engine, mechanism):
    return engine(mechanism)._tree.skeleton


def run(engine, mechanism, motion):
    return engine(mechanism).inverse_dynamics(motion, lambda done: None)


def with_axial(mechanism, factor):
    """The mechanism with all its axial inertias multiplied."""

    def heavier(link):
        return dataclasses.replace(link, axial=factor * link.axial)

    legs = [sixsps.Leg(heavier(leg.lower), heavier(leg.upper), leg.length_limits) for leg in mechanism.legs]
    return dataclasses.replace(mechanism, legs=tuple(legs))


def home_frames(mechanism):
    """(6, 3, 3) axes of the legs at home, in columns."""
    legs = Layout.of(mechanism).legs
    return Rotation.from_euler("ZY", [[leg.yaw, leg.pitch] for leg in legs]).as_matrix()


def test_dart_reads_masses_and_inertias_exactly(engine, any_mechanism):
    skeleton = skeleton_of(engine, any_mechanism)
    platform = any_mechanism.platform
    expected = {"platform": (platform.mass, platform.com, platform.inertia)}
    for i, leg in enumerate(any_mechanism.legs, start=1):
        for name, link, sense in (("lower", leg.lower, 1), ("upper", leg.upper, -1)):
            inertia = np.diag([link.transverse, link.transverse, link.axial])
            expected[f"leg{i}_{name}"] = link.mass, [0, 0, sense * link.com], inertia
    for name, (mass, com, inertia) in expected.items():
        body = skeleton.getBodyNode(name)
        assert body.getMass() == mass
        assert np.array_equal(body.getLocalCOM(), com)
        assert np.array_equal(body.getInertia().getMoment(), inertia)
    others = {body.getName(): body for body in skeleton.getBodyNodes()}
    assert all(other.getMass() < 1e-100 for name, other in others.items() if name not in expected)
    assert np.array_equal(skeleton.getGravity(), any_mechanism.gravity)


def test_dart_reads_very_small_inertias(engine, wu2012):
    skeleton = skeleton_of(engine, with_axial(wu2012, 1e-12))
    assert skeleton.getBodyNode("leg1_upper").getInertia().getMoment()[2, 2] == 1e-12 * 2.16e-5


def test_nothing_but_the_mechanism_is_in_the_skeleton(engine, wu2012):
    skeleton = skeleton_of(engine, wu2012)
    assert skeleton.getNumDofs() == (30 if engine is Dart else 24)
    for dof in map(skeleton.getDof, range(skeleton.getNumDofs())):
        assert dof.getDampingCoefficient() == dof.getSpringStiffness() == dof.getCoulombFriction() == 0
    assert skeleton.getRootJoint().getType() == "WeldJoint"
    assert all(body.getGravityMode() for body in skeleton.getBodyNodes())


def test_dart_loads_without_a_word(engine, any_mechanism, capfd):
    engine(any_mechanism)
    assert capfd.readouterr() == ("", "")


def test_links_without_inertia_would_weigh_a_kilogram(wu2012):
    """Why the default of DART's loader is replaced."""
    loader = dartpy.utils.DartLoader()
    skeleton = loader.parseSkeletonString(dart.render_urdf(wu2012), dartpy.common.Uri())
    assert skeleton.getBodyNode("leg1_tip").getMass() == 1
    assert skeleton.getRootJoint().getType() == "FreeJoint"


def test_free_joint_takes_world_rates(wu2012):
    """What `Dart` gives as rates of the platform are those of its origin, and classical."""
    skeleton = skeleton_of(Dart, wu2012)
    values = np.random.default_rng(0).standard_normal((3, 6))
    joint, body = skeleton.getJoint("platform_joint"), skeleton.getBodyNode("platform")
    setters = joint.setPositions, joint.setVelocities, joint.setAccelerations
    for put, value in zip(setters, values, strict=True):
        put(value)
    omega, v, epsilon, a = values[1:].reshape(4, 3)
    arm = Rotation.from_rotvec(values[0, :3]).apply([0.1, 0.2, 0.3])
    expected = a + np.cross(epsilon, arm) + np.cross(omega, np.cross(omega, arm))
    np.testing.assert_allclose(body.getLinearVelocity(), v, rtol=1e-14)
    np.testing.assert_allclose(body.getLinearAcceleration([0.1, 0.2, 0.3]), expected, rtol=1e-13)


def turned(angle, samples=5):
    """Random states of a random mechanism, the platform turned by `angle` about any axis."""
    mechanism = random_mechanism(5)
    motion = random_motion(mechanism, 5, samples)
    axes = np.random.default_rng(5).standard_normal((samples, 3))
    vectors = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    given = {name: getattr(motion, name) for name in motion.__dataclass_fields__}
    quaternion = Rotation.from_rotvec(vectors).as_quat(scalar_first=True)
    return mechanism, sixsps.Motion(**given | {"quaternion": quaternion})


@pytest.mark.parametrize("angle", [0, 1e-8, 1e-5, 3e-4, 9.9e-4, 1.1e-3, 0.1, 1, 3, math.pi - 1e-9, math.pi])
def test_orientation_reaches_dart_to_rounding(angle):
    mechanism, motion = turned(angle)
    tree = Dart(mechanism)._tree
    for q, rotation in zip(tree.positions(motion), motion.rotation, strict=True):
        tree.skeleton.setPositions(q)
        assert np.abs(tree.platform.getWorldTransform().rotation() - rotation).max() < 2e-15
    error = np.abs(run(Dart, mechanism, motion).forces - sixsps.inverse_dynamics(mechanism, motion))
    condition = inverse_kinematics(mechanism, motion).condition.max()
    assert error.max() < 1e-15 * condition * np.abs(sixsps.inverse_dynamics(mechanism, motion)).max()


def test_dart_cuts_its_exponential_map_short_at_small_angles(monkeypatch):
    """Why a full turn is added; when this fails, it no longer has to be."""
    mechanism, motion = turned(9.9e-4)
    exact = run(Dart, mechanism, motion).closure_error.max()
    monkeypatch.setattr(dart, "_COARSE_ANGLES", (0, 0))
    assert run(Dart, mechanism, motion).closure_error.max() > 1e3 * exact


@pytest.mark.parametrize("seed", range(10))
def test_loops_close_at_rounding(engine, seed):
    mechanism = random_mechanism(seed)
    result = run(engine, mechanism, random_motion(mechanism, seed))
    assert result.closure_error.max() <= 1e-14 * np.abs(mechanism.base_anchors).max()
    assert result.closure_residual.max() <= 1e-14 * np.abs(result.forces).max()


def across_home(mechanism, cosine):
    """A pose at rest in which leg 1 stands along the x axis of its home frame but for `cosine`."""
    leg = Layout.of(mechanism).legs[0]
    direction = home_frames(mechanism)[0] @ [math.sqrt(1 - cosine**2), 0, cosine]
    joint = mechanism.base_anchors[0] + leg.length * direction
    return at_rest(joint - mechanism.platform_anchors[0])


def test_gimbal_lock_is_refused(engine):
    mechanism = random_mechanism(0)
    assert run(engine, mechanism, across_home(mechanism, 0.06)).closure_error.max() < 1e-13
    reason = "use pinocchio-ball" if engine is Dart else "stands along its first axis"
    with pytest.raises(sixsps.EngineError, match=f"gimbal lock of a .* at given sample 1: .*{reason}"):
        run(engine, mechanism, across_home(mechanism, 0.04))


def test_a_model_that_dart_cannot_read_is_an_error(monkeypatch, wu2012):
    monkeypatch.setattr(dart, "render_urdf", lambda *given: "<robot>")
    with pytest.raises(sixsps.EngineError, match="DART loaded has no skeleton"):
        Dart(wu2012)


def test_universal_joints_change_forces_in_proportion_to_axial_inertia(wu2012):
    motion = bundled("sinusoids", wu2012, 50)
    spherical = run(Dart, wu2012, motion).forces
    once, tenfold = (
        run(DartUps, with_axial(wu2012, factor), motion).forces - spherical for factor in (1, 10)
    )
    assert 1e-6 < np.abs(once).max() < 1e-3
    np.testing.assert_allclose(tenfold, 10 * once, atol=1e-6 * np.abs(tenfold).max())
    heavy = run(Dart, with_axial(wu2012, 10), motion).forces
    assert np.abs(heavy - spherical).max() < 1e-13 * np.abs(spherical).max()


def test_what_universal_joints_add_is_the_power_of_spinning_the_legs(wu2012):
    """Power of the additional forces against the rate of spin energy, from the joints' geometry."""
    mechanism = with_axial(wu2012, 50)
    motion = bundled("sinusoids", mechanism, 1000)
    legs = inverse_kinematics(mechanism, motion)
    added = run(DartUps, mechanism, motion).forces - run(Dart, mechanism, motion).forces
    power = np.sum(added * legs.length_rates, axis=1)

    turn = np.swapaxes(home_frames(mechanism), 1, 2)
    x, y, z = np.moveaxis(np.einsum("kij,nkj->nki", turn, legs.directions), -1, 0)
    rates = np.cross(legs.leg_angular_velocity, legs.directions)
    _, dy, dz = np.moveaxis(np.einsum("kij,nkj->nki", turn, rates), -1, 0)
    spin = x * (y * dz - z * dy) / (y**2 + z**2)  # of the first axis alone: the second is across the leg
    energy = np.sum((mechanism.lower.axial + mechanism.upper.axial) * spin**2, axis=1) / 2
    expected = CubicSpline(motion.time, energy).derivative()(motion.time)
    inner = slice(20, -20)  # a spline's ends are less exact
    assert np.abs(power).max() > 1e-6
    assert np.abs(power - expected)[inner].max() < 1e-6 * np.abs(power).max()


def test_home_pose_at_rest_carries_the_weight(engine, wu2012):
    forces = run(engine, wu2012, at_rest(home_position(wu2012))).forces[0]
    reference = sixsps.inverse_dynamics(wu2012, at_rest(home_position(wu2012)))[0]
    np.testing.assert_allclose(forces, reference, rtol=1e-13)
