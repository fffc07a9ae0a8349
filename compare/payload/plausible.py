"""Links whose inertia no body can have: a whole robot that they matter to is refused, others are told."""

from __future__ import annotations

import numpy as np

from compare.payload.description import Description, bodies
from sixsps.arrays import Array
from sixsps.errors import MechanismError

# Published robots have such links: placeholders of frames without mass, estimates that were fitted, mirrored
# or rounded, and what they miss is up to 0.07 of the whole robot's least moment. Below this share of it the
# moments that turn the robot are wrong by less than that; beyond it the file is taken to be wrong.
_MATTERS = 0.1
# Files give six digits. Of a thin plate the moments then miss the triangle equality by that much.
_ROUNDING = 1e-6
# Placeholders of a milligram or a gram, of this share of the robot's least moment, are not worth a word.
_UNSEEN = 1e-5
_SHOWN = 3


def check_inertias(description: Description) -> tuple[str, ...]:
    """Returns what is to be told of links whose principal moments no body can have.

    Raises:
        MechanismError: one of them matters to the whole robot.
    """
    told = []
    whole = _least_moment(description)
    for link in description.links.values():
        principal = np.linalg.eigvalsh(link.inertia)
        missing = max(-principal[0], principal[2] - principal[0] - principal[1])
        if missing <= max(_ROUNDING * np.abs(principal).max(), _UNSEEN * whole):
            continue
        found = "principal moments " + ", ".join(f"{moment:.4g}" for moment in principal)
        if missing > _MATTERS * whole:
            words = "none negative and none larger than the sum of the other two [kg m^2]"
            raise MechanismError(f"link {link.name}, inertia", found, words, description.source)
        told.append(f"link {link.name}: {found} kg m^2")
    return () if not told else (_told(told),)


def _told(links: list[str]) -> str:
    others = len(links) - _SHOWN
    more = f" and {others} more" if others > 0 else ""
    shown = "; ".join(links[:_SHOWN])
    return f"used as given, although no body has such an inertia: {shown}{more}"


def _least_moment(description: Description) -> float:
    """Returns the robot's least principal moment about its centre of mass, joints at zero [kg m^2]."""
    poses, whole = {"": np.eye(4)}, np.zeros((4, 4))
    for body in bodies(description):
        poses[body.joint] = poses[body.parent] @ body.placement
        whole += poses[body.joint] @ body.moments()[0] @ poses[body.joint].T
    return max(0.0, float(np.linalg.eigvalsh(_about_com(whole))[0]))


def _about_com(moments: Array) -> Array:
    """Returns the (3, 3) inertia about the centre of mass from the integral of (x, 1) (x, 1)^T dm."""
    mass, first = moments[3, 3], moments[:3, 3]
    second = moments[:3, :3] - (np.outer(first, first) / mass if mass > 0 else 0.0)
    return np.asarray(np.trace(second) * np.eye(3) - second)
