"""Mechanism to SDF text, with true ball or universal joints and the loops closed by ball joints of its own.

SDF describes a graph of links, not a tree: the platform is the child of six ball joints
`leg<i>_closure`, one at each leg's tip, and nothing is cut open. All poses are those at home, where every
joint coordinate is zero. Version 1.6 has all that is needed; newer readers take it, and DART takes nothing
newer.

Not every reader of SDF takes a graph. Drake reads all joints and then refuses the loops, unless they are
closed by constraints of its own (`Loops.drake`); DART keeps the first closure as a joint of its tree and
says that it drops the others. Both leave the world's gravity aside.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np

from sixsps.arrays import Array
from sixsps.bodies import Link
from sixsps.errors import printable
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from urdf.closures import LEGS
from urdf.layout import LOWER_RADIUS, UPPER_RADIUS, Disc, Layout, LegLayout, provenance, strength
from urdf.names import comment, file_stem
from urdf.options import Loops, option

_VERSION = "1.6"
# Of the base, relative to the platform's mass. It never moves; without inertia readers would give it 1 kg.
_BASE_MASS = 1e-6
_ORIGIN = (0.0, 0.0, 0.0)
_COLORS = {"steel": "0.65 0.68 0.72 1", "blue": "0.13 0.35 0.60 1", "orange": "0.90 0.55 0.15 1"}


def render_sdf(mechanism: Mechanism, legs: Legs = Legs.sps, loops: Loops = Loops.joints) -> str:
    """Returns the SDF of the mechanism, a world with one model; floats read back exactly.

    It is a world because SDF knows gravity there alone. The model's name is the mechanism's less what SDF
    reserves ("::", leading underscores); the mechanism's own name stands in a comment.

    Args:
        mechanism: geometry and inertia.
        legs: a ball at the base, or a universal joint: first axis along x of the leg's home frame,
            fixed in the base, second along y, fixed in the leg.
        loops: what closes them.

    Raises:
        InputError: `legs` or `loops` is none of theirs.
        MechanismError: the mechanism is geometry alone.
    """
    legs, loops = option(Legs, "legs", legs), option(Loops, "loops", loops)
    gravity = _text(mechanism.gravity)
    layout = Layout.of(mechanism)
    root = ET.Element("sdf", version=_VERSION)
    if loops is Loops.drake:
        root.set("xmlns:drake", "http://drake.mit.edu")
    root.append(ET.Comment(comment(f" {printable(mechanism.name)} ")))
    root.append(ET.Comment(provenance(mechanism)))
    world = ET.SubElement(root, "world", name="hexapod_world")
    ET.SubElement(world, "gravity").text = gravity
    model = ET.SubElement(world, "model", name=_model_name(mechanism))
    _base(model, mechanism, layout)
    for i, place in zip(LEGS, layout.legs, strict=True):
        _leg(model, i, mechanism, place, legs)
    _platform(model, mechanism, layout)
    close = _close_by_joint if loops is Loops.joints else _close_by_constraint
    for i, anchor in zip(LEGS, mechanism.platform_anchors, strict=True):
        close(model, i, anchor)
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _model_name(mechanism: Mechanism) -> str:
    stem = file_stem(mechanism.name)
    return "hexapod" if stem == "world" else stem  # which SDF reserves


def _base(model: ET.Element, mechanism: Mechanism, layout: Layout) -> None:
    base = ET.SubElement(model, "link", name="base")
    mass = _BASE_MASS * mechanism.platform.mass
    _inertial(base, mass, layout.base.center, mass * layout.base.radius**2 * np.eye(3))
    _disc(base, layout.base, "steel")
    _joint(model, "base_fixed", "fixed", "world", "base")


def _leg(model: ET.Element, i: int, mechanism: Mechanism, place: LegLayout, legs: Legs) -> None:
    name, leg, anchor = f"leg{i}", mechanism.legs[i - 1], mechanism.base_anchors[i - 1]
    turn = (0.0, place.pitch, place.yaw)
    lower = _link(model, f"{name}_lower", anchor, turn)
    _half(lower, leg.lower, 1.0, LOWER_RADIUS, "blue")
    upper = _link(model, f"{name}_upper", anchor + place.length * _direction(place), turn)
    _half(upper, leg.upper, -1.0, UPPER_RADIUS, "steel")
    if legs is Legs.sps:
        _joint(model, f"{name}_ball", "ball", "base", f"{name}_lower")
    else:
        universal = _joint(model, f"{name}_universal", "universal", "base", f"{name}_lower")
        for tag, direction in (("axis", (1, 0, 0)), ("axis2", (0, 1, 0))):
            _limits(_axis(universal, tag, direction), effort=0.0)  # no motor turns it
    actuator = _joint(model, f"{name}_actuator", "prismatic", f"{name}_lower", f"{name}_upper")
    shortest, longest = (length - place.length for length in leg.length_limits)
    _limits(_axis(actuator, "axis", (0, 0, 1)), lower=shortest, upper=longest, **strength(mechanism, i - 1))


def _direction(place: LegLayout) -> Array:
    sine = math.sin(place.pitch)
    return np.array([math.cos(place.yaw) * sine, math.sin(place.yaw) * sine, math.cos(place.pitch)])


def _platform(model: ET.Element, mechanism: Mechanism, layout: Layout) -> None:
    link = _link(model, "platform", layout.home, _ORIGIN)
    platform = mechanism.platform
    _inertial(link, platform.mass, platform.com, platform.inertia)
    _disc(link, layout.platform, "orange")


def _close_by_joint(model: ET.Element, i: int, anchor: Array) -> None:
    closure = _joint(model, f"leg{i}_closure", "ball", f"leg{i}_upper", "platform")
    _pose(closure, anchor, _ORIGIN)


def _close_by_constraint(model: ET.Element, i: int, anchor: Array) -> None:
    tag = "drake:ball_constraint"
    constraint = ET.SubElement(model, tag)
    ET.SubElement(constraint, f"{tag}_body_A").text = f"leg{i}_upper"
    ET.SubElement(constraint, f"{tag}_body_B").text = "platform"
    ET.SubElement(constraint, f"{tag}_p_AP").text = _text((0, 0, 0))
    ET.SubElement(constraint, f"{tag}_p_BQ").text = _text(anchor)


def _link(model: ET.Element, name: str, position: Array, turn: Iterable[float]) -> ET.Element:
    link = ET.SubElement(model, "link", name=name)
    _pose(link, position, turn)
    return link


def _half(link: ET.Element, half: Link, sense: float, radius: float, color: str) -> None:
    """Fills a link that extends from its joint along z in the direction of `sense`."""
    inertia = np.diag([half.transverse, half.transverse, half.axial])
    _inertial(link, half.mass, (0.0, 0.0, sense * half.com), inertia)
    _cylinder(link, (0.0, 0.0, sense * half.length / 2), _ORIGIN, radius * half.length, half.length, color)


def _joint(model: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(model, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent").text = parent
    ET.SubElement(joint, "child").text = child
    return joint


def _axis(joint: ET.Element, tag: str, direction: Iterable[float]) -> ET.Element:
    axis = ET.SubElement(joint, tag)
    ET.SubElement(axis, "xyz").text = _text(direction)
    return axis


def _limits(axis: ET.Element, **limits: float) -> None:
    element = ET.SubElement(axis, "limit")
    for tag, value in limits.items():
        ET.SubElement(element, tag).text = repr(float(value))


def _inertial(link: ET.Element, mass: float, com: Iterable[float], inertia: Array) -> None:
    inertial = ET.SubElement(link, "inertial")
    _pose(inertial, com, _ORIGIN)
    ET.SubElement(inertial, "mass").text = repr(float(mass))
    moments = ET.SubElement(inertial, "inertia")
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        ET.SubElement(moments, f"i{'xyz'[i]}{'xyz'[j]}").text = repr(float(inertia[i, j]))


def _disc(link: ET.Element, disc: Disc, color: str) -> None:
    _cylinder(link, disc.center, (0.0, disc.pitch, disc.yaw), disc.radius, disc.thickness, color)


def _cylinder(
    link: ET.Element, center: Iterable[float], turn: Iterable[float], radius: float, length: float, color: str
) -> None:
    visual = ET.SubElement(link, "visual", name="visual")
    _pose(visual, center, turn)
    cylinder = ET.SubElement(ET.SubElement(visual, "geometry"), "cylinder")
    ET.SubElement(cylinder, "radius").text = repr(float(radius))
    ET.SubElement(cylinder, "length").text = repr(float(length))
    material = ET.SubElement(visual, "material")
    for tag in ("ambient", "diffuse"):
        ET.SubElement(material, tag).text = _COLORS[color]


def _pose(element: ET.Element, position: Iterable[float], turn: Iterable[float]) -> None:
    """Position [m] and roll, pitch, yaw [rad]."""
    ET.SubElement(element, "pose").text = _text([*position, *turn])


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
