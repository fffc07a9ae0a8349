"""What a URDF file says against what Pinocchio makes of it: names of any kind, and bodies that cannot be."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sixsps
from compare.payload.cargo import open_cargo
from compare.payload.catalogue import find_robot, robots
from compare.payload.description import bodies, described, parsed
from sixsps.errors import MechanismError
from sixsps.trajectories import bundled

pytest.importorskip("pinocchio", reason="pin has no wheel for this platform")

from compare.payload import robot as robot_module
from compare.payload.faithful import check_faithful
from compare.payload.robot import RobotModel
from compare.payload.whole_tree import PinocchioPayload

KINDS = ("fixed", "revolute", "fixed", "prismatic", "continuous")
LINKS = tuple(f"L{number}" for number in range(6))
JOINTS = tuple(f"J{number}" for number in range(5))
INERTIAL = """<inertial><origin xyz="{x} 0.02 -0.04" rpy="0.1 -0.5 0.7"/><mass value="{mass}"/>
<inertia ixx="0.01" ixy="0.002" ixz="0.001" iyy="0.02" iyz="0.0005" izz="0.015"/></inertial>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0.05 0.1 0.{number}" rpy="0.4 -0.3 1.1"/><axis xyz="0 0.6 0.8"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>"""


def urdf(links=LINKS, joints=JOINTS):
    """A chain with a joint of every kind, in which no two bodies are alike."""
    parts = [
        f'<link name="{name}">{INERTIAL.format(x=0.1 * number, mass=number)}</link>'
        for number, name in enumerate(links, 1)
    ]
    parts += [
        JOINT.format(name=name, kind=kind, parent=links[k], child=links[k + 1], number=k + 1)
        for k, (name, kind) in enumerate(zip(joints, KINDS, strict=True))
    ]
    return f'<robot name="chain">{"".join(parts)}</robot>'


def write(folder, text):
    path = folder / "chain.urdf"
    path.write_text(text)
    return str(path)


def leg_forces(path):
    """Leg forces under the robot's wrench, and those of the whole tree."""
    mechanism = sixsps.Mechanism.load("wu2012")
    aboard = open_cargo(path, None, "0,0,0.1").aboard(mechanism, bundled("sinusoids", mechanism, 3))
    tree = PinocchioPayload(aboard.ride.carrier).tree_forces(aboard.ride)
    return sixsps.inverse_dynamics(aboard.mechanism, aboard.motion), tree.legs.forces


def replaced(names, index, name):
    return (*names[:index], name, *names[index + 1 :])


def check_same_forces(path, wanted):
    for forces in leg_forces(path):
        assert_allclose(forces, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    return leg_forces(write(tmp_path_factory.mktemp("chain"), urdf()))[0]


@pytest.mark.parametrize(
    "name",
    ["root_joint", "free-flyer", "platform", "leg1_ball", "leg1_ball_x", "leg1_actuator", "base", "world",
     "Composite_platform_x", "payload/joint/J1", "payload/link/L1", "platform_joint", "t", "a b", "ä::1"],
)  # fmt: skip
def test_names_change_no_force(name, tmp_path, wanted):
    for index in (0, 3):
        check_same_forces(write(tmp_path, urdf(links=replaced(LINKS, index, name))), wanted)
    for index in range(len(JOINTS)):
        check_same_forces(write(tmp_path, urdf(joints=replaced(JOINTS, index, name))), wanted)


@pytest.mark.parametrize("index", range(len(JOINTS)))
def test_a_link_and_a_joint_may_share_a_name(index, tmp_path, wanted):
    for link in LINKS:
        check_same_forces(write(tmp_path, urdf(joints=replaced(JOINTS, index, link))), wanted)


@pytest.mark.parametrize("name", ["universe", ""])
def test_names_that_nothing_can_have(name, tmp_path):
    for text in (urdf(joints=replaced(JOINTS, 0, name)), urdf(joints=replaced(JOINTS, 1, name))):
        assert "link or joint: " in refusal(tmp_path, text)
    if name:
        assert "universe; allowed: another name" in refusal(tmp_path, urdf(links=replaced(LINKS, 2, name)))


def refusal(folder, text):
    with pytest.raises(MechanismError) as caught:
        RobotModel(find_robot(write(folder, text)))
    message = str(caught.value)
    assert message.isprintable()
    assert message.startswith(f"{folder / 'chain.urdf'}: ")
    return message


def test_robots_of_the_package_ride_in_the_whole_tree():
    """Those whose links and joints share names, and one of which a moment is negative."""
    for name in ("z1", "b1-z1", "so100", "anymal_c_simple_description/anymal", "romeo_laas_small"):
        if name in robots():
            forces, tree = leg_forces(name)
            assert np.abs(tree - forces).max() <= 1e-12 * np.abs(forces).max(), name


class TestFaithful:
    def test_tells_a_free_flyer_of_the_name_of_a_joint(self, tmp_path, monkeypatch):
        """What is prevented by its name, and what would be seen if it were not."""
        monkeypatch.setattr(robot_module, "_unused", lambda names: "root_joint")
        text = urdf(joints=replaced(JOINTS, 1, "root_joint"))
        assert "Pinocchio reads another mass or place; allowed: that of the text" in refusal(tmp_path, text)

    @pytest.mark.parametrize("name", ["", "J1", "J4"])
    @pytest.mark.parametrize("part", ["mass", "lever", "inertia"])
    def test_tells_a_body_that_is_another(self, name, part, tmp_path):
        robot = RobotModel(find_robot(write(tmp_path, urdf())))
        inertia = robot.model.inertias[robot.model.getJointId(name) if name else 1]
        setattr(inertia, part, getattr(inertia, part) * (1 + 1e-6))
        with pytest.raises(MechanismError, match="Pinocchio reads another mass or place"):
            check_faithful(robot.model, 1, robot.description)

    @pytest.mark.parametrize("name", ["J1", "J3", "J4"])
    def test_tells_a_joint_that_is_elsewhere(self, name, tmp_path):
        robot = RobotModel(find_robot(write(tmp_path, urdf())))
        placement = robot.model.jointPlacements[robot.model.getJointId(name)]
        placement.translation = placement.translation + 1e-6
        with pytest.raises(MechanismError, match=f"what moves with joint {name}"):
            check_faithful(robot.model, 1, robot.description)

    def test_tells_a_joint_that_is_missing(self, tmp_path):
        robot = RobotModel(find_robot(write(tmp_path, urdf())))
        shorter = described(parsed(robot.text.replace('"prismatic"', '"fixed"'), "x"), "x")
        with pytest.raises(MechanismError, match="reads 3 joints that move; allowed: 2 as in the text"):
            check_faithful(robot.model, 1, shorter)


def test_bodies_are_what_moves_as_one():
    found = {body.joint: [link.name for link, _ in body.links] for body in bodies(chain())}
    assert found == {"": ["L0", "L1"], "J1": ["L2", "L3"], "J3": ["L4"], "J4": ["L5"]}


def chain():
    return described(parsed(urdf(), "chain.urdf"), "chain.urdf")


CHANGES = [
    ('value="2"', 'value="-2"', "link L1, mass: -2.0; allowed: at least 0 [kg]"),
    ('value="2"', 'value="1e300"', "link L1, value: 1e300; allowed: a finite number up to 1e+50"),
    ('ixx="0.01"', 'ixx="-5"', "link L0, inertia: principal moments -5, "),
    ('ixx="0.01"', 'ixx="50"', "none negative and none larger than the sum of the other two [kg m^2]"),
    ('ixx="0.01"', 'ixx="1e60"', "link L0, ixx: 1e60; allowed: a finite number up to 1e+50"),
    ('<axis xyz="0 0.6 0.8"/>', '<axis xyz="0 0 0"/>', "joint J1, axis: 0 0 0; allowed: a direction"),
    ("<robot", '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot a="&x;"', "which is XML"),
    ("</robot>", "", "which is XML"),
]


@pytest.mark.parametrize(("old", "new", "said"), CHANGES)
def test_what_no_robot_can_be_is_refused(old, new, said, tmp_path):
    text = urdf()
    if "axis" in old:  # the first joint is a fixed one
        head, tail = text.split('name="J1"')
        text = head + 'name="J1"' + tail.replace(old, new, 1)
    else:
        text = text.replace(old, new, 1)
    assert said in refusal(tmp_path, text)


def test_axis_of_a_fixed_joint_is_nothing(tmp_path):
    path = write(tmp_path, urdf().replace('<axis xyz="0 0.6 0.8"/>', '<axis xyz="0 0 0"/>', 1))
    assert RobotModel(find_robot(path)).names == ("J1", "J3", "J4")


def test_a_moment_that_hardly_matters_is_told(tmp_path):
    path = write(tmp_path, urdf().replace('iyy="0.02"', 'iyy="0.03"', 1))
    (warning,) = RobotModel(find_robot(path)).warnings
    assert warning.startswith("used as given, although no body has such an inertia: link L0: principal")


def test_rods_plates_and_points_are_bodies(tmp_path):
    moments = 'ixx="0.01" ixy="0.002" ixz="0.001" iyy="0.02" iyz="0.0005" izz="0.015"'
    for xx, yy, zz in ((0, 0, 0), (0, 1, 1), (1, 1, 2), (1, 1, 2.000001)):
        plain = f'ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"'
        assert RobotModel(find_robot(write(tmp_path, urdf().replace(moments, plain, 1)))).warnings == ()


def test_namespaces_mean_nothing(tmp_path, wanted):
    text = urdf().replace("<robot", '<robot xmlns="http://www.ros.org" xacro:x="1"', 1)
    check_same_forces(write(tmp_path, text), wanted)


def test_file_of_a_robot_with_another_case(tmp_path):
    path = tmp_path / "chain.URDF"
    path.write_text(urdf())
    assert open_cargo(str(path)).is_robot
