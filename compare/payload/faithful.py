"""Whether a robot that a library has read is the one that the file's text describes."""

from __future__ import annotations

from typing import Any

import numpy as np

from compare.payload.description import Body, Description, bodies
from sixsps.arrays import Array
from sixsps.errors import MechanismError

# Both add up the same terms, turned by the same angles: a hundred roundings would be 2e-14.
_ROUNDING = 1e-9


def check_faithful(model: Any, base: int, description: Description) -> None:
    """Refuses a Pinocchio model whose bodies are others than in the text.

    Names that a library has uses of its own for have made it weld bodies to others without a word.

    Args:
        model: of the robot; its bodies are those of the text, and one more that is empty where `base` is 1.
        base: joint of the root link, 0 where it is fixed to the world.
        description: what the text says.

    Raises:
        MechanismError: naming the body that is another.
    """
    expected = list(bodies(description))
    links = sum(len(body.links) for body in expected)
    if model.njoints != base + len(expected) or links != len(description.links):
        found = f"Pinocchio reads {model.njoints - base - 1} joints that move"
        raise MechanismError("payload", found, f"{len(expected) - 1} as in the text", description.source)
    for body in expected:
        number = model.getJointId(body.joint) if body.joint else base
        if number >= model.njoints or not _is_same(model, number, base, body):
            what = f"what moves with joint {body.joint}" if body.joint else "the root link"
            found, allowed = "Pinocchio reads another mass or place", "that of the text"
            raise MechanismError(what, found, allowed, description.source)


def _is_same(model: Any, number: int, base: int, body: Body) -> bool:
    moments, scale = body.moments()
    if not _agree(_moments(model.inertias[number]), moments, scale):
        return False
    if not body.joint:
        return True
    parent = model.getJointId(body.parent) if body.parent else base
    placement = model.jointPlacements[number].homogeneous
    reach = 1.0 + np.abs(body.placement).max()
    return model.parents[number] == parent and _agree(placement, body.placement, np.full((4, 4), reach))


def _moments(inertia: Any) -> Array:
    """Returns the integral of (x, 1) (x, 1)^T dm of Pinocchio's inertia, (4, 4)."""
    com = np.append(inertia.lever, 1.0)
    moments = inertia.mass * np.outer(com, com)
    moments[:3, :3] += np.trace(inertia.inertia) / 2 * np.eye(3) - inertia.inertia
    return np.asarray(moments)


def _agree(found: Array, wanted: Array, scale: Array) -> bool:
    # Turned moments round as the largest of their terms.
    return bool((np.abs(found - wanted) <= _ROUNDING * np.maximum(scale, scale[:3, :3].max() * 1e-3)).all())
