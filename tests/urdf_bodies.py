"""The bodies of a URDF file, placed by its own text alone: no library that knows robots has a say."""

from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation


def _numbers(element, name, default):
    text = None if element is None else element.get(name)
    return np.array(default if text is None else [float(part) for part in text.split()])


def _origin(element):
    """Homogeneous matrix of an element's `origin`."""
    origin = element.find("origin")
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", _numbers(origin, "rpy", [0.0] * 3)).as_matrix()
    pose[:3, 3] = _numbers(origin, "xyz", [0.0] * 3)
    return pose


def _moved(joint, value):
    """Homogeneous matrix of the motion of a joint."""
    pose = np.eye(4)
    if joint.get("type") == "fixed":
        return pose
    axis = _numbers(joint.find("axis"), "xyz", [1.0, 0.0, 0.0])
    axis = axis / np.linalg.norm(axis)
    if joint.get("type") == "prismatic":
        pose[:3, 3] = value * axis
    else:
        assert joint.get("type") in ("revolute", "continuous")
        pose[:3, :3] = Rotation.from_rotvec(value * axis).as_matrix()
    return pose


def _inertial(link):
    """Mass, pose of the centre of mass in the link and inertia about it; nothing where it has none."""
    element = link.find("inertial")
    if element is None:
        return None
    mass, inertia = float(element.find("mass").get("value")), element.find("inertia")
    xx, yy, zz, xy, xz, yz = (float(inertia.get(f"i{name}")) for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
    return mass, _origin(element), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class Bodies:
    """The links that have mass, and where joint positions put them."""

    def __init__(self, path):
        root = ElementTree.parse(path).getroot()
        self.links = {link.get("name"): _inertial(link) for link in root.findall("link")}
        # A transmission also has elements called joint, but none of the robot's own.
        self.joints = [joint for joint in root.findall("joint") if joint.find("parent") is not None]
        children = {joint.find("child").get("link") for joint in self.joints}
        (self.root,) = [name for name in self.links if name not in children]

    def placed(self, base, positions):
        """Returns (mass, homogeneous matrix, inertia) of every body.

        Args:
            base: (4, 4) pose of the root link.
            positions: name of a joint -> its position.
        """
        poses, waiting = {self.root: base}, list(self.joints)
        while waiting:
            joint = next(joint for joint in waiting if joint.find("parent").get("link") in poses)
            waiting.remove(joint)
            value = positions.get(joint.get("name"), 0.0)
            parent = poses[joint.find("parent").get("link")]
            poses[joint.find("child").get("link")] = parent @ _origin(joint) @ _moved(joint, value)
        massive = {name: inertial for name, inertial in self.links.items() if inertial}
        return [(mass, poses[name] @ com, inertia) for name, (mass, com, inertia) in massive.items()]


def composite(bodies):
    """Mass, centre of mass and inertia about it of bodies that stand still to each other."""
    mass = sum(m for m, _, _ in bodies)
    com = sum(m * pose[:3, 3] for m, pose, _ in bodies) / mass
    inertia = np.zeros((3, 3))
    for m, pose, own in bodies:
        arm, turn = pose[:3, 3] - com, pose[:3, :3]
        inertia += turn @ own @ turn.T + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, com, inertia
