"""Limits of the actuators in the exports: there for readers, and without a say in any number."""

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from cases import random_motion

import sixsps
import urdf
from compare import registry
from sixsps.legs import Legs
from sixsps.limits import Limits

LEGS = range(1, 7)
FORCE = [[-200, 150], [-1, 300], [10, 20], [-30, -7], [-0.5, 0], [-100, 100]]
RATE = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


@pytest.fixture
def weak(wu2012):
    return dataclasses.replace(wu2012, limits=Limits(force=FORCE, rate=RATE))


def actuator_limits(text):
    joints = {joint.get("name"): joint for joint in ET.fromstring(text).findall("joint")}
    return [joints[f"leg{i}_actuator"].find("limit") for i in LEGS], joints


@pytest.mark.parametrize("legs", Legs)
def test_urdf_takes_the_larger_magnitude_and_the_rate(weak, legs):
    limits, joints = actuator_limits(urdf.render_urdf(weak, legs))
    assert [float(limit.get("effort")) for limit in limits] == [200, 300, 20, 30, 0.5, 100]
    assert [float(limit.get("velocity")) for limit in limits] == RATE
    for name, joint in joints.items():
        if joint.get("type") == "revolute":
            assert (joint.find("limit").get("effort"), joint.find("limit").get("velocity")) == (
                "1e9",
                "1e9",
            ), name


@pytest.mark.parametrize("known", ["force", "rate"])
def test_what_is_not_limited_stays_so(wu2012, known):
    one = dataclasses.replace(wu2012, limits=Limits(**{known: 7.0 if known == "rate" else [-7, 7]}))
    limits, _ = actuator_limits(urdf.render_urdf(one))
    found = [(float(limit.get("effort")), float(limit.get("velocity"))) for limit in limits]
    assert found == [(7, 1e9) if known == "force" else (1e9, 7)] * 6
    assert ("actuatorfrcrange" in urdf.render_mjcf(one)) == (known == "force")


def test_pinocchio_reads_them(weak, tmp_path):
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(urdf.render_urdf(weak))
    columns = [model.joints[model.getJointId(f"leg{i}_actuator")].idx_v for i in LEGS]
    assert np.array_equal(model.upperEffortLimit[columns], np.abs(FORCE).max(axis=1))
    assert np.array_equal(model.upperVelocityLimit[columns], RATE)
    path = tmp_path / "weak.xml"
    path.write_text(urdf.render_mjcf(weak))
    model = pin.buildModelAndConstraintsFromMJCF(str(path))[0]
    columns = [model.joints[model.getJointId(f"leg{i}_actuator")].idx_v for i in LEGS]
    assert np.array_equal(np.transpose([model.lowerEffortLimit, model.upperEffortLimit])[columns], FORCE)


def test_mujoco_reads_them_and_clamps_nothing(wu2012, weak):
    mujoco = pytest.importorskip("mujoco")
    found = []
    for mechanism in (wu2012, weak):
        model = mujoco.MjModel.from_xml_string(urdf.render_mjcf(mechanism))
        data = mujoco.MjData(model)
        data.ctrl[:] = 1e4 * np.arange(1, 7)
        data.qvel[:] = 3.0
        mujoco.mj_forward(model, data)
        found.append([data.qacc.copy(), data.qfrc_actuator.copy()])
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])
    assert np.abs(found[0][1]).max() == 6e4
    ranges = [model.jnt_actfrcrange[model.joint(f"leg{i}_actuator").id] for i in LEGS]
    assert np.array_equal(ranges, FORCE)
    assert not model.jnt_actfrclimited.any()


ENGINES = ("pinocchio", "pinocchio-ball", "mujoco", "drake", "dart")


@pytest.mark.parametrize("legs", Legs)
@pytest.mark.parametrize("name", ENGINES)
def test_they_change_no_force_of_any_engine_that_reads_the_exports(wu2012, weak, name, legs):
    if name not in registry.with_legs(legs):
        return
    try:
        engine = registry.load(name, legs)
    except sixsps.EngineUnavailable as error:
        pytest.skip(str(error))
    motion = random_motion(wu2012, 4, samples=3, tilt=0.2)
    found = [
        engine(mechanism).inverse_dynamics(motion, lambda _: None).forces for mechanism in (wu2012, weak)
    ]
    assert np.array_equal(*found)
