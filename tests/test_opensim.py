"""OpenSim: what the contract of all engines does not ask.

Everything that imports it runs in a process of its own. OpenSim and CasADi each bring a library
libcasadi.so.3.7, of different content; once one is loaded, the other package does not import.
"""

import dataclasses
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from multiprocessing import get_context

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from scipy.spatial.transform import Rotation

import sixsps
from compare.tolerances import TOLERANCES, UNIT_ROUNDOFF
from sixsps.bodies import Leg, Link, Platform
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="package opensim is not installed")

AXES = [*np.eye(3), *-np.eye(3)]


@pytest.fixture(scope="module")
def apart():
    """Calls a function of this module in another process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield lambda function, *arguments: pool.submit(function, *arguments).result()


def compute(mechanism, motion):
    from compare.engines.opensim import Opensim

    return Opensim(mechanism).inverse_dynamics(motion, lambda done: None)


def bodies(mechanism):
    """What the model holds: gravity, and of every body by name mass, com and inertia about it."""
    from compare.engines.opensim import Opensim

    model = Opensim(mechanism).model
    found = {}
    for k in range(model.getBodySet().getSize()):
        body = model.getBodySet().get(k)
        inertia = body.getInertia()
        entries = [*numbers(inertia.getMoments()), *numbers(inertia.getProducts())]
        found[body.getName()] = [body.getMass(), *numbers(body.getMassCenter()), *entries]
    return numbers(model.getGravity()), found


def numbers(vector):
    return [vector.get(i) for i in range(3)]


def assert_within_rounding(apart, mechanism, motion):
    reference = sixsps.inverse_dynamics(mechanism, motion)
    forces = apart(compute, mechanism, motion).forces
    condition = inverse_kinematics(mechanism, motion).condition
    error = np.abs(forces - reference).max(axis=1) / np.abs(reference).max(axis=1)
    assert np.all(error <= TOLERANCES["opensim"].rounding_factor * condition * UNIT_ROUNDOFF)


def turned(motion, rotation):
    """The same motion in other orientations."""
    quaternion = rotation.as_quat(scalar_first=True)
    return dataclasses.replace(motion, quaternion=np.broadcast_to(quaternion, (len(motion), 4)))


@pytest.mark.parametrize("seed", range(10))
def test_closures_are_at_rounding(apart, seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    result = apart(compute, mechanism, motion)
    size = np.abs(mechanism.base_anchors).max() + np.abs(motion.position).max()
    assert result.closure_error.max() <= 1e-15 * size
    assert result.closure_residual.max() <= 1e-14 * np.abs(result.forces).max() * max(1, size)


def test_closures_do_not_hide_a_loop_that_is_open(apart):
    """The check has to see the model's bodies, not the numbers that it was given."""
    mechanism = random_mechanism(1)
    gap = apart(gap_of_a_leg_too_long, mechanism, random_motion(mechanism, 1)[:1], 1e-3)
    assert gap == pytest.approx(1e-3, rel=1e-9)


def gap_of_a_leg_too_long(mechanism, motion, excess):
    from compare.engines import opensim

    q, _ = opensim._positions(mechanism, motion)
    q[0, 9] += excess
    return opensim._Tree(mechanism).place(q[0])[1]


def test_masses_and_gravity_are_those_given(apart):
    mechanism = random_mechanism(2)
    gravity, found = apart(bodies, mechanism)
    # Simbody keeps it as direction times size.
    np.testing.assert_allclose(gravity, mechanism.gravity, rtol=4 * UNIT_ROUNDOFF)
    platform, inertia = mechanism.platform, mechanism.platform.inertia
    upper = np.triu_indices(3, 1)
    expected = {"platform": [platform.mass, *platform.com, *np.diag(inertia), *inertia[upper]]}
    for i, leg in enumerate(mechanism.legs, start=1):
        for half, link, sense in (("lower", leg.lower, 1), ("upper", leg.upper, -1)):
            moments = [link.axial, link.transverse, link.transverse, 0, 0, 0]
            expected[f"leg{i}_{half}"] = [link.mass, sense * link.com, 0, 0, *moments]
    assert found == expected


def test_inertia_is_kept_at_the_limit_of_what_a_body_can_have(apart):
    """Nor is it replaced when it misses the triangle inequality by a rounding, as a turned plate may."""
    mechanism = random_mechanism(3)
    plate = dataclasses.replace(mechanism.platform, inertia=np.diag([1.0, 2.0, 3 * (1 + 1e-10)]))
    mechanism = dataclasses.replace(mechanism, platform=plate)
    assert apart(bodies, mechanism)[1]["platform"][4:] == [1.0, 2.0, 3 * (1 + 1e-10), 0, 0, 0]
    assert_within_rounding(apart, mechanism, random_motion(mechanism, 3))


@pytest.mark.parametrize("pitch", [np.pi / 2, np.pi / 2 - 1e-9, np.pi / 2 + 1e-5, -np.pi / 2])
@pytest.mark.parametrize("about_x", [0.0, 0.7])
def test_gimbal_lock_of_the_platforms_angles_costs_no_digits(apart, pitch, about_x):
    mechanism = random_mechanism(4)
    rotation = Rotation.from_euler("XYZ", [about_x, pitch, -0.4])
    assert_within_rounding(apart, mechanism, turned(random_motion(mechanism, 4), rotation))


@pytest.mark.parametrize("axis", AXES)
def test_a_leg_may_point_along_any_axis(apart, axis):
    mechanism = random_mechanism(5)
    offset = mechanism.base_anchors[0] - mechanism.platform_anchors[0]
    distance = 2 * mechanism.characteristic_length
    motion = at_rest(
        offset + distance * axis,
        velocity=[0.3, -0.2, 0.4],
        angular_velocity=[0.5, 0.1, -0.7],
        acceleration=[1.0, 2.0, -0.5],
        angular_acceleration=[-0.6, 0.9, 0.2],
        force=[80.0, -50.0, -100.0],
    )
    assert_within_rounding(apart, mechanism, motion)


@pytest.mark.parametrize("length", [1e-9, 1e-3, 1e3, 1e9])
def test_unit_of_length_does_not_matter(apart, length):
    mechanism = in_unit(random_mechanism(6), length)
    assert_within_rounding(apart, mechanism, random_motion(mechanism, 6))


def in_unit(mechanism, length):
    """The mechanism `length` times as large."""

    def link(given):
        moments = given.transverse * length**2, given.axial * length**2
        return Link(given.mass, given.length * length, given.com * length, *moments)

    platform = mechanism.platform
    return Mechanism(
        name=mechanism.name,
        gravity=mechanism.gravity * length,
        base_anchors=mechanism.base_anchors * length,
        platform_anchors=mechanism.platform_anchors * length,
        platform=Platform(platform.mass, platform.com * length, platform.inertia * length**2),
        legs=tuple(Leg(link(leg.lower), link(leg.upper)) for leg in mechanism.legs),
    )


def test_leaves_nothing_in_the_working_directory_and_prints_nothing(tmp_path):
    """Not even where OpenSim has something to say, as of a model that it has read."""
    script = """
import sys, opensim, sixsps
from compare.engines.opensim import Opensim
from sixsps.trajectories import bundled
mechanism = sixsps.Mechanism.load("wu2012")
Opensim(mechanism).inverse_dynamics(bundled("line", mechanism, 3), lambda done: None)
opensim.Model().printToXML(sys.argv[1])
opensim.Model(sys.argv[1])
"""
    here = tmp_path / "here"
    here.mkdir()
    command = [sys.executable, "-W", "error", "-c", script, str(tmp_path / "model.osim")]
    run = subprocess.run(command, cwd=here, capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
    assert list(here.iterdir()) == []
