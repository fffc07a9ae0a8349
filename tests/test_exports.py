"""Every export, read by engines that did not write it: the kinematics and the masses are the mechanism's."""

import dataclasses
import xml.etree.ElementTree as ET
from functools import partial

import numpy as np
import pytest
from cases import random_mechanism, random_motion
from readers import DartReader, DrakeReader, MujocoReader, PinocchioReader, put

import sixsps
import urdf
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.legs import Legs
from urdf.export import export_mjcf, export_sdf, export_urdf
from urdf.layout import first_axes
from urdf.options import Loops

EPS = np.finfo(float).eps


def urdf_in_pinocchio(mechanism, folder):
    pytest.importorskip("pinocchio")
    return PinocchioReader.of_urdf(export_urdf(mechanism, folder)[0])


def mjcf_in_pinocchio(mechanism, folder):
    pytest.importorskip("pinocchio")
    return PinocchioReader.of_mjcf(export_mjcf(mechanism, folder)[0])


def mjcf_in_mujoco(mechanism, folder):
    pytest.importorskip("mujoco")
    return MujocoReader(export_mjcf(mechanism, folder)[0])


def urdf_in_dart(mechanism, folder):
    """DART is told to fix the base, and that a link without inertia has none: it would make that 1 kg."""
    dartpy = pytest.importorskip("dartpy")
    nothing = dartpy.dynamics.Inertia(1e-200, np.zeros(3), 1e-200 * np.eye(3))
    fixed = dartpy.utils.DartLoaderRootJointType.FIXED
    loader = dartpy.utils.DartLoader()
    loader.setOptions(dartpy.utils.DartLoaderOptions(None, fixed, nothing))
    skeleton = loader.parseSkeleton(f"file://{export_urdf(mechanism, folder)[0]}")
    names = [pair[1] for pair in urdf.closures.CLOSURES.closed_loop]
    anchors = [skeleton.getBodyNode(name).getParentJoint().getTransformFromParentBodyNode() for name in names]
    return DartReader(skeleton, [f"leg{i}_tip" for i in range(1, 7)], [a.translation() for a in anchors])


def sdf_in_dart(mechanism, folder, legs=Legs.sps):
    """DART keeps the first closure as a joint of its tree: the anchors of the others are the mechanism's."""
    dartpy = pytest.importorskip("dartpy")
    world = dartpy.utils.SdfParser.readWorld(f"file://{export_sdf(mechanism, folder, legs)[0]}")
    tips = [f"leg{i}_upper" for i in range(1, 7)]
    return DartReader(world.getSkeleton(0), tips, mechanism.platform_anchors)


def sdf_in_drake(mechanism, folder, legs=Legs.sps):
    """With the loops in Drake's own words; where anchors stand it says for the joints of the plain SDF."""
    pytest.importorskip("pydrake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    graph, plant = MultibodyPlant(0.0), MultibodyPlant(0.0)
    Parser(graph).AddModels(str(export_sdf(mechanism, folder / "joints", legs)[0]))
    closures = [graph.GetJointByName(f"leg{i}_closure") for i in range(1, 7)]
    anchors = [closure.frame_on_child().GetFixedPoseInBodyFrame().translation() for closure in closures]
    Parser(plant).AddModels(str(export_sdf(mechanism, folder / "drake", legs, Loops.drake)[0]))
    plant.Finalize()
    assert plant.num_constraints() == 6
    return DrakeReader(plant, anchors)


READERS = {
    "urdf in pinocchio": urdf_in_pinocchio,
    "urdf in dart": urdf_in_dart,
    "mjcf in pinocchio": mjcf_in_pinocchio,
    "mjcf in mujoco": mjcf_in_mujoco,
    "sdf in drake": sdf_in_drake,
    "sdf in dart": sdf_in_dart,
    "sdf in drake, ups": partial(sdf_in_drake, legs=Legs.ups),
    "sdf in dart, ups": partial(sdf_in_dart, legs=Legs.ups),
}


@pytest.fixture(params=READERS)
def kind(request):
    return request.param


@pytest.fixture(params=["wu2012", 3])
def case(request, kind, tmp_path):
    if isinstance(request.param, str):
        mechanism = sixsps.Mechanism.load(request.param)
    else:
        mechanism = dataclasses.replace(random_mechanism(request.param), name="<b>\"'& Δ")
    return mechanism, READERS[kind](mechanism, tmp_path)


def test_kinematics_in_random_poses(case):
    mechanism, reader = case
    motion = random_motion(mechanism, 7, samples=4, tilt=0.3)
    legs = inverse_kinematics(mechanism, motion)
    home = np.linalg.norm(
        home_position(mechanism) + mechanism.platform_anchors - mechanism.base_anchors, axis=1
    )
    size = np.abs(mechanism.base_anchors).max() + np.abs(motion.position).max()
    for k in range(len(motion)):
        at = put(reader, motion.position[k], motion.rotation[k])
        growth = 100 * EPS * legs.condition[k]
        expected = motion.position[k] + legs.arms[k]
        np.testing.assert_allclose(at.position, motion.position[k], atol=100 * EPS * size)
        np.testing.assert_allclose(at.tips, expected, atol=100 * EPS * size)
        np.testing.assert_allclose(at.anchors, expected, atol=100 * EPS * size)
        np.testing.assert_allclose(at.strokes + home, legs.lengths[k], atol=100 * EPS * size)
        twist = np.concatenate([motion.velocity[k], motion.angular_velocity[k], np.zeros(18)])
        rates = np.linalg.lstsq(at.system(), twist, rcond=1e-10)[0]
        scale = np.abs(legs.length_rates[k]).max()
        np.testing.assert_allclose(rates[reader.actuated], legs.length_rates[k], atol=growth * scale)


def test_masses(case):
    """All in all, and where their centre is as the platform moves."""
    mechanism, reader = case
    masses = np.concatenate([[mechanism.platform.mass], mechanism.lower.mass, mechanism.upper.mass])
    # MJCF and SDF give the base a millionth of the platform's mass, at the middle of its anchors.
    base = reader.mass - masses.sum()
    assert min(abs(base), abs(base - 1e-6 * mechanism.platform.mass)) <= 1e-14 * masses.sum()
    motion = random_motion(mechanism, 8, samples=2, tilt=0.3)
    legs = inverse_kinematics(mechanism, motion)
    for k in range(len(motion)):
        at = put(reader, motion.position[k], motion.rotation[k])
        e_d, e_u = mechanism.lower.com[:, None], mechanism.upper.com[:, None]
        tips, s = motion.position[k] + legs.arms[k], legs.directions[k]
        places = np.vstack(
            [
                motion.position[k] + motion.rotation[k] @ mechanism.platform.com,
                mechanism.base_anchors + e_d * s,
                tips - e_u * s,
            ]
        )
        moment = masses @ places
        with_base = (moment + base * mechanism.base_anchors.mean(axis=0)) / reader.mass
        size = np.abs(places).max()
        error = [np.abs(at.com - com).max() for com in (moment / masses.sum(), with_base)]
        assert min(error) <= 100 * EPS * size


def spin_inertia(mechanism, arms, directions, lengths):
    """(6, 6) what the spins that universal joints force on the legs add to the platform's mass matrix.

    A leg turns by rates about e1, fixed in the base, and e2 across the leg: its angular velocity w has no
    part along e3 = e1 x e2, which fixes the spin that goes with s x (v + omega x c) / l.
    """
    e1 = first_axes(mechanism)
    e2 = np.cross(directions, e1)
    e3 = np.cross(e1, e2)
    across = np.cross(e3, directions) / lengths[:, None]
    spins = -np.hstack([across, np.cross(arms, across)]) / (directions * e3).sum(axis=1)[:, None]
    return spins.T @ np.diag(mechanism.lower.axial + mechanism.upper.axial) @ spins


def test_mass_matrix(case, kind):
    """The energy of a twist with the legs' idle spins left free, which is least where they do not spin.

    Two inversions, of the tree's mass matrix and of what the 24 equations make of its inverse. Each
    multiplies what a handful of roundings leave by its condition number, taken with ones on the diagonal:
    units make no rounding.
    """
    mechanism, reader = case
    motion = random_motion(mechanism, 9, samples=2, tilt=0.3)
    legs = inverse_kinematics(mechanism, motion)
    expected = sixsps.mass_matrix(mechanism, motion.position, motion.rotation)
    scale = np.repeat([1.0, mechanism.characteristic_length], 3)
    # In DART's SDF the first closure is a joint of the tree, and no equation.
    equations = np.delete(np.arange(24), range(6, 9) if "sdf in dart" in kind else [])
    for k in range(len(motion)):
        at = put(reader, motion.position[k], motion.rotation[k])
        system = at.system()[equations]
        first, tree = equilibrated(at.mass_matrix)
        second, mobility = equilibrated(system / first @ np.linalg.solve(tree, (system / first).T))
        found = (np.linalg.inv(mobility) / second / second[:, None])[:6, :6]
        wanted = expected[k]
        if "ups" in kind:
            wanted = wanted + spin_inertia(mechanism, legs.arms[k], legs.directions[k], legs.lengths[k])
        error = np.abs((found - wanted) / scale / scale[:, None]).max()
        size = np.abs(wanted / scale / scale[:, None]).max()
        assert error <= 10 * EPS * np.linalg.cond(tree) * np.linalg.cond(mobility) * size


def equilibrated(matrix):
    """Square roots of the diagonal, and the matrix divided by them."""
    roots = np.sqrt(np.diag(matrix))
    return roots, matrix / roots / roots[:, None]


def test_gravity_is_read_by_mujoco_alone(case, kind):
    """A URDF has none; Pinocchio leaves that of MJCF aside, Drake and DART that of SDF: it has to be set."""
    mechanism, reader = case
    expected = mechanism.gravity if kind == "mjcf in mujoco" else [0, 0, -9.81]
    assert np.array_equal(reader.gravity, expected)


def test_no_name_leaves_its_place(kind, tmp_path, wu2012):
    hostile = dataclasses.replace(wu2012, name="--><script>alert('\"')</script>&amp; ]]> 六足")
    READERS[kind](hostile, tmp_path)
    for path in tmp_path.rglob("*"):
        if path.is_file() and path.suffix != ".yaml":
            assert ET.parse(path).getroot().find(".//script") is None
