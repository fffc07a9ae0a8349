"""What the text of a URDF file says of links and joints, by itself: no library for robots has a say.

It is what a model that such a library has made of the file is held against, and what is checked for
bodies that cannot be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, ParseError, TreeBuilder
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.arrays import LARGEST, Array
from sixsps.errors import MechanismError

# What Pinocchio calls its world; a link or joint of that name would be taken for it.
_WORLD = "universe"
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_SHORTEST_AXIS = 1e-9


@dataclass(frozen=True, eq=False)
class Link:
    """A link of a robot; one without `inertial` has no mass.

    Attributes:
        name: of the link.
        mass: [kg].
        com: (3,) centre of mass in the link's frame [m].
        inertia: (3, 3) about the centre of mass, link axes [kg m^2].
    """

    name: str
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a robot.

    Attributes:
        name: of the joint.
        kind: fixed, revolute, continuous, prismatic, ...
        parent: name of a link.
        child: name of a link.
        origin: (4, 4) pose of the child in the parent where the joint is at zero.
        lower: least position [rad, m]; -inf where there is none.
        upper: largest position [rad, m]; inf where there is none.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Description:
    """Links and joints by name.

    Attributes:
        links: in the order of the file.
        joints: in the order of the file.
        source: the file.
    """

    links: dict[str, Link]
    joints: dict[str, Joint]
    source: str


def parsed(text: str, source: str) -> Element:
    """Returns the root element of a URDF file; prefixes of names mean nothing, as to URDF's own parser.

    Raises:
        MechanismError: it is no XML.
    """
    builder, parser = TreeBuilder(), ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(text, True)
        return builder.close()
    except (ExpatError, ParseError, AssertionError, ValueError) as error:
        raise MechanismError("payload", str(error), "a URDF file, which is XML", source) from None


def names_in(root: Element, source: str) -> set[str]:
    """Returns the names of all links and joints.

    Raises:
        MechanismError: one of them is empty or that of Pinocchio's world.
    """
    names = {element.get("name", "") for tag in ("link", "joint") for element in root.findall(tag)}
    if "" in names:
        raise MechanismError("link or joint", "without a name", "names that are not empty", source)
    if _WORLD in names:
        raise MechanismError("link or joint", _WORLD, "another name: Pinocchio calls its world so", source)
    return names


def described(root: Element, source: str) -> Description:
    """Returns what the elements say, each value by itself checked.

    Raises:
        MechanismError: naming link or joint, value and what is allowed.
    """
    links = [_link(element, source) for element in root.findall("link")]
    joints = [_joint(element, source) for element in root.findall("joint")]
    return Description({link.name: link for link in links}, {joint.name: joint for joint in joints}, source)


def _link(element: Element, source: str) -> Link:
    name, inertial = element.get("name", ""), element.find("inertial")
    if inertial is None:
        return Link(name, 0.0, np.zeros(3), np.zeros((3, 3)))
    read = _Reader(f"link {name}", source)
    (mass,) = read.numbers(inertial.find("mass"), "value", 1)
    if mass < 0:
        raise MechanismError(f"link {name}, mass", mass, "at least 0 [kg]", source)
    inertia = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (read.numbers(inertia, moment, 1)[0] for moment in _MOMENTS)
    pose = read.origin(inertial)
    turned = pose[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ pose[:3, :3].T
    return Link(name, mass, pose[:3, 3], turned)


def _joint(element: Element, source: str) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    read = _Reader(f"joint {name}", source)
    parent, child = (read.text(element.find(tag), "link") for tag in ("parent", "child"))
    lower, upper = -math.inf, math.inf
    if kind in ("revolute", "prismatic"):
        limit = element.find("limit")
        (given_lower,), (given_upper,) = (read.numbers(limit, side, 1, (0.0,)) for side in ("lower", "upper"))
        if given_lower < given_upper:  # zero and zero stand for what is not known
            lower, upper = given_lower, given_upper
    if kind != "fixed":
        axis = read.numbers(element.find("axis"), "xyz", 3, (1.0, 0.0, 0.0))
        if math.hypot(*axis) < _SHORTEST_AXIS:
            given = " ".join(f"{number:g}" for number in axis)
            raise MechanismError(f"joint {name}, axis", given, "a direction", source)
    return Joint(name, kind, parent, child, read.origin(element), lower, upper)


@dataclass(frozen=True)
class _Reader:
    """Reads attributes of the elements of a link or joint."""

    owner: str
    source: str

    def text(self, element: Element | None, name: str) -> str:
        value = None if element is None else element.get(name)
        if value is None:
            raise MechanismError(self.owner, f"no {name}", f"an attribute {name}", self.source)
        return value

    def numbers(
        self, element: Element | None, name: str, count: int, default: Sequence[float] | None = None
    ) -> tuple[float, ...]:
        if default is not None and (element is None or element.get(name) is None):
            return tuple(default)
        given = self.text(element, name)
        try:
            numbers = tuple(float(part) for part in given.split())
        except ValueError:
            numbers = ()
        if len(numbers) != count or not all(abs(number) <= LARGEST for number in numbers):
            allowed = f"{count} finite numbers" if count > 1 else "a finite number"
            raise MechanismError(f"{self.owner}, {name}", given, f"{allowed} up to {LARGEST:g}", self.source)
        return numbers

    def origin(self, element: Element) -> Array:
        """Returns the (4, 4) pose that an element's `origin` gives."""
        origin, zero, pose = element.find("origin"), (0.0, 0.0, 0.0), np.eye(4)
        pose[:3, 3] = self.numbers(origin, "xyz", 3, zero)
        pose[:3, :3] = Rotation.from_euler("xyz", self.numbers(origin, "rpy", 3, zero)).as_matrix()
        return pose


@dataclass(frozen=True, eq=False)
class Body:
    """Links that move as one: those that fixed joints hold to the child of a joint, or to the root.

    Attributes:
        joint: name of the joint, empty for the root's body.
        parent: name of the joint of the body that carries it.
        placement: (4, 4) pose in the parent body where the joint is at zero.
        links: with their (4, 4) poses in the body.
    """

    joint: str
    parent: str
    placement: Array
    links: list[tuple[Link, Array]]

    def moments(self) -> tuple[Array, Array]:
        """Returns the integral of (x, 1) (x, 1)^T dm in the body's frame, (4, 4), and its scale."""
        pairs = [_second_moments(link) for link, _ in self.links]
        poses = [pose for _, pose in self.links]
        terms = [pose @ own @ pose.T for own, pose in zip(pairs, poses, strict=True)]
        scales = [np.abs(p) @ np.abs(own) @ np.abs(p.T) for own, p in zip(pairs, poses, strict=True)]
        return sum(terms, np.zeros((4, 4))), sum(scales, np.zeros((4, 4)))


def bodies(description: Description) -> Iterator[Body]:
    """Yields the bodies, each after the one that carries it, with all joints at zero.

    Raises:
        MechanismError: the joints do not make one tree of the links.
    """
    children: dict[str, list[Joint]] = {}
    for joint in description.joints.values():
        children.setdefault(joint.parent, []).append(joint)
    held = {joint.child for joint in description.joints.values()}
    waiting = [("", "", name, np.eye(4)) for name in description.links if name not in held]
    while waiting:
        name, parent, root, placement = waiting.pop()
        body = Body(name, parent, placement, [])
        rigid = [(root, np.eye(4))]
        while rigid:
            link, pose = rigid.pop()
            body.links.append((description.links[link], pose))
            for joint in children.get(link, []):
                if joint.kind == "fixed":
                    rigid.append((joint.child, pose @ joint.origin))
                else:
                    waiting.append((joint.name, name, joint.child, pose @ joint.origin))
        yield body


def _second_moments(link: Link) -> Array:
    """Returns the integral of (x, 1) (x, 1)^T dm in the link's frame, (4, 4)."""
    com = np.append(link.com, 1.0)
    moments = link.mass * np.outer(com, com)
    moments[:3, :3] += np.trace(link.inertia) / 2 * np.eye(3) - link.inertia
    return moments
