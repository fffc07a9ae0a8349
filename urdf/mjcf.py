"""Mechanism to MJCF text, with true ball or universal joints and the loops closed by `<connect>`.

Everything hangs on one root body and the platform rides on three slides and a ball instead of a
free joint: MuJoCo allows a free joint only on top level, and Pinocchio's reader drops all but one
top-level body. The coordinates are those of a free joint: position, quaternion; world-frame
velocity, body-frame angular velocity.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array
from sixsps.bodies import Leg, Link
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from urdf.closures import CLOSURES, LEGS
from urdf.layout import LOWER_RADIUS, UPPER_RADIUS, Disc, Layout, LegLayout, provenance
from urdf.options import option

# Of the base, relative to the platform's mass; it weighs nothing in any force.
_BASE_MASS = 1e-6
_COLORS = {"steel": "0.65 0.68 0.72 1", "blue": "0.13 0.35 0.60 1", "orange": "0.90 0.55 0.15 1"}


def render_mjcf(mechanism: Mechanism, legs: Legs = Legs.sps) -> str:
    """Returns the MJCF of the mechanism; floats read back exactly.

    Args:
        mechanism: geometry and inertia.
        legs: a ball at the base, or a universal joint: first axis along x of the leg's home frame,
            fixed in the base, second along y.

    Raises:
        InputError: `legs` is neither.
    """
    legs = option(Legs, "legs", legs)
    layout = Layout.of(mechanism)
    root = ET.Element("mujoco", model=mechanism.name)
    root.append(ET.Comment(provenance(mechanism)))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=_text(mechanism.gravity))
    _defaults(root)
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "light", pos="0 0 3", dir="0 0 -1", directional="true")
    base = ET.SubElement(world, "body", name="base")
    # Never moves; Pinocchio's reader wants the inertia of a root body all the same. MuJoCo computes
    # about the common centre of mass, base included: a heavy base, or one left behind at the origin,
    # would draw that away from the hexapod and cost digits.
    mass = repr(_BASE_MASS * mechanism.platform.mass)
    ET.SubElement(base, "inertial", pos=_text(layout.base.center), mass=mass, diaginertia="1 1 1")
    _disc(base, layout.base, "steel")
    for i, leg, place in zip(LEGS, mechanism.legs, layout.legs, strict=True):
        lower = ET.SubElement(
            base, "body", name=f"leg{i}_lower", pos=_text(mechanism.base_anchors[i - 1]),
            quat=_quaternion(place.pitch, place.yaw),
        )  # fmt: skip
        _base_joint(lower, f"leg{i}", legs)
        force = None if mechanism.limits.force is None else mechanism.limits.force[i - 1]
        _leg(lower, f"leg{i}", leg, place, force)
    _platform(base, mechanism, layout)
    _closures(root)
    _actuators(root)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _defaults(root: ET.Element) -> None:
    default = ET.SubElement(root, "default")
    # Drawn only: the legs of a hexapod overlap at shared joints.
    ET.SubElement(default, "geom", contype="0", conaffinity="0", group="1")
    ET.SubElement(default, "site", size="0.005", group="3")


def _base_joint(lower: ET.Element, name: str, legs: Legs) -> None:
    if legs is Legs.sps:
        ET.SubElement(lower, "joint", name=f"{name}_ball", type="ball")
        return
    # Hinges of one body turn in their order: the first axis stands still, the second turns with it.
    for axis, direction in (("x", (1, 0, 0)), ("y", (0, 1, 0))):
        ET.SubElement(lower, "joint", name=f"{name}_universal_{axis}", type="hinge", axis=_text(direction))


def _leg(lower: ET.Element, name: str, leg: Leg, place: LegLayout, force: Array | None) -> None:
    _link(lower, leg.lower, 1.0, LOWER_RADIUS, "blue")
    upper = ET.SubElement(lower, "body", name=f"{name}_upper", pos=_text((0, 0, place.length)))
    shortest, longest = (limit - place.length for limit in leg.length_limits)
    # Ranges are for readers and must neither push nor clamp: a limit never changes a number here.
    joint = ET.SubElement(
        upper, "joint", name=f"{name}_actuator", type="slide", axis="0 0 1", limited="false",
        range=_text((shortest, longest)),
    )  # fmt: skip
    if force is not None:
        joint.attrib |= {"actuatorfrclimited": "false", "actuatorfrcrange": _text(force)}
    _link(upper, leg.upper, -1.0, UPPER_RADIUS, "steel")
    ET.SubElement(upper, "site", name=f"{name}_tip", pos="0 0 0")


def _link(body: ET.Element, link: Link, sense: float, radius: float, color: str) -> None:
    # MuJoCo refuses a thin disc whose axial moment is too large by a rounding.
    inertia = _text((link.transverse, link.transverse, min(link.axial, 2 * link.transverse)))
    com = _text((0, 0, sense * link.com))
    ET.SubElement(body, "inertial", pos=com, mass=repr(float(link.mass)), diaginertia=inertia)
    ends = _text((0, 0, 0, 0, 0, sense * link.length))
    size = repr(radius * link.length)
    ET.SubElement(body, "geom", type="cylinder", fromto=ends, size=size, rgba=_COLORS[color])


def _platform(base: ET.Element, mechanism: Mechanism, layout: Layout) -> None:
    body = ET.SubElement(base, "body", name="platform", pos=_text(layout.home))
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        ET.SubElement(
            body, "joint", name=f"platform_{axis}", type="slide", axis=_text(direction)
        )  # fmt: skip
    ET.SubElement(body, "joint", name="platform_ball", type="ball")
    platform = mechanism.platform
    inertial = {"pos": _text(platform.com), "mass": repr(float(platform.mass))}
    ET.SubElement(body, "inertial", inertial | _principal(platform.inertia))
    _disc(body, layout.platform, "orange")
    for index, anchor in zip(LEGS, mechanism.platform_anchors, strict=True):
        ET.SubElement(body, "site", name=f"platform_anchor{index}", pos=_text(anchor))


def _principal(inertia: Array) -> dict[str, str]:
    """Returns the inertia as principal moments and axes.

    MuJoCo refuses moments that miss the triangle inequality by a rounding, as those of a thin plate
    may once it is turned; the largest one is therefore cut at the sum of the others.
    """
    if np.any(inertia - np.diag(np.diag(inertia))):
        moments, axes = np.linalg.eigh(inertia)
        axes[:, 0] *= np.linalg.det(axes)
        turn = {"quat": _text(Rotation.from_matrix(axes).as_quat(scalar_first=True))}
    else:
        moments, turn = np.array(np.diag(inertia)), {}
    largest = int(np.argmax(moments))
    moments[largest] = min(moments[largest], np.delete(moments, largest).sum())
    return {"diaginertia": _text(moments)} | turn


def _closures(root: ET.Element) -> None:
    equality = ET.SubElement(root, "equality")
    for i, (tip, anchor) in zip(LEGS, CLOSURES.closed_loop, strict=True):
        ET.SubElement(equality, "connect", name=f"leg{i}_closure", site1=tip, site2=anchor)


def _actuators(root: ET.Element) -> None:
    actuator = ET.SubElement(root, "actuator")
    for joint in CLOSURES.name_mot:
        ET.SubElement(actuator, "motor", name=joint, joint=joint)


def _disc(body: ET.Element, disc: Disc, color: str) -> None:
    ET.SubElement(
        body, "geom", type="cylinder", pos=_text(disc.center), quat=_quaternion(disc.pitch, disc.yaw),
        size=_text((disc.radius, disc.thickness / 2)), rgba=_COLORS[color],
    )  # fmt: skip


def _quaternion(pitch: float, yaw: float) -> str:
    """Returns the unit quaternion of a turn by `pitch` about y, then by `yaw` about z."""
    cp, sp, cy, sy = math.cos(pitch / 2), math.sin(pitch / 2), math.cos(yaw / 2), math.sin(yaw / 2)
    return _text((cy * cp, -sy * sp, cy * sp, sy * cp))


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
