"""Mechanism to URDF text, through the project's own xacro template."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources
from typing import Any
from xml.dom.minidom import Document

import xacro

from sixsps.bodies import Leg, Link
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from urdf.layout import LOWER_RADIUS, UPPER_RADIUS, Disc, Layout, LegLayout, provenance, strength
from urdf.options import option

# URDF demands an effort and a velocity limit of every joint, and the mechanism need not have one.
_NO_LIMIT = "1e9"


def render_urdf(mechanism: Mechanism, legs: Legs = Legs.sps) -> str:
    """Returns the URDF of the cut-open mechanism; floats read back exactly.

    Only numbers reach the template, which evaluates Python: the mechanism's name is set afterwards,
    as an attribute of the finished document.

    Args:
        mechanism: geometry and inertia.
        legs: a ball at the base, or a universal joint: first axis along x of the leg's home frame,
            fixed in the base, second along y.

    Raises:
        InputError: `legs` is neither.
    """
    legs = option(Legs, "legs", legs)
    template = resources.files("urdf") / "six_sps.urdf.xacro"
    with resources.as_file(template) as path:
        document = xacro.process_file(str(path), mappings=_arguments(mechanism, legs))
    _remove_comments(document)
    document.documentElement.setAttribute("name", mechanism.name)
    document.insertBefore(document.createComment(provenance(mechanism)), document.documentElement)
    text: str = document.toprettyxml(indent="  ")
    return text


def _arguments(mechanism: Mechanism, legs: Legs) -> dict[str, str]:
    layout = Layout.of(mechanism)
    arguments = {
        "no_limit": _NO_LIMIT,
        "universal": str(legs is Legs.ups),
        "home": _text(layout.home),
        "anchor_radius": repr(layout.anchor_radius),
    }
    arguments |= _disc("base", layout.base) | _disc("platform", layout.platform)
    platform = mechanism.platform
    arguments |= _inertial("platform", platform.mass, platform.com, platform.inertia.tolist())
    for i, (leg, place) in enumerate(zip(mechanism.legs, layout.legs, strict=True)):
        arguments[f"leg{i + 1}_anchor"] = _text(mechanism.base_anchors[i])
        arguments[f"platform_anchor{i + 1}"] = _text(mechanism.platform_anchors[i])
        arguments |= _leg(f"leg{i + 1}", leg, place)
        actuator = strength(mechanism, i)
        for name in ("effort", "velocity"):
            arguments[f"leg{i + 1}_{name}"] = repr(actuator[name]) if name in actuator else _NO_LIMIT
    return arguments


def _leg(name: str, leg: Leg, place: LegLayout) -> dict[str, str]:
    shortest, longest = leg.length_limits
    arguments = {
        f"{name}_rpy": _text((0.0, place.pitch, place.yaw)),
        f"{name}_tip_at_home": _text((0.0, 0.0, place.length)),
        f"{name}_shortest": repr(shortest - place.length),
        f"{name}_longest": repr(longest - place.length),
    }
    arguments |= _link(f"{name}_lower", leg.lower, 1.0, LOWER_RADIUS)
    return arguments | _link(f"{name}_upper", leg.upper, -1.0, UPPER_RADIUS)


def _link(name: str, link: Link, sense: float, radius: float) -> dict[str, str]:
    """Arguments of a link that extends from its joint along z in the direction of `sense`."""
    t, a = link.transverse, link.axial
    inertia = [[t, 0.0, 0.0], [0.0, t, 0.0], [0.0, 0.0, a]]
    return _inertial(name, link.mass, (0.0, 0.0, sense * link.com), inertia) | {
        f"{name}_visual_xyz": _text((0.0, 0.0, sense * link.length / 2)),
        f"{name}_visual_rpy": "0 0 0",
        f"{name}_radius": repr(radius * link.length),
        f"{name}_length": repr(float(link.length)),
    }


def _inertial(name: str, mass: float, com: Iterable[float], inertia: list[list[float]]) -> dict[str, str]:
    entries = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
    return {
        f"{name}_mass": repr(float(mass)),
        f"{name}_com": _text(com),
        **{f"{name}_i{key}": repr(float(inertia[i][j])) for key, (i, j) in entries.items()},
    }


def _disc(name: str, disc: Disc) -> dict[str, str]:
    return {
        f"{name}_visual_xyz": _text(disc.center),
        f"{name}_visual_rpy": _text((0.0, disc.pitch, disc.yaw)),
        f"{name}_radius": repr(disc.radius),
        f"{name}_length": repr(disc.thickness),
    }


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _remove_comments(document: Document) -> None:
    """Takes out the template's comments and xacro's banner, which would name a local path."""
    parents: list[Any] = [document, document.documentElement]
    for parent in parents:
        for node in list(parent.childNodes):
            if node.nodeType == node.COMMENT_NODE:
                parent.removeChild(node)
