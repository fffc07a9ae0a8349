"""The hexapod as a multibody description: URDF with loop closures, MJCF, SDF, and a Pinocchio model.

All are in the home pose when their coordinates are zero. URDF, MJCF and the Pinocchio model are a tree that
is cut open at the six platform joints: `base` carries six legs (ball at A_i, prismatic actuator) and, on a
floating joint, the `platform`; frames `leg<i>_tip` and `platform_anchor<i>` coincide where a loop closes,
i = 1..6. In SDF ball joints close the loops.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from urdf.closures import ClosureFile, parse_closures, render_closures
from urdf.mjcf import render_mjcf
from urdf.render import render_urdf
from urdf.sdf import render_sdf

if TYPE_CHECKING:
    from urdf.pinocchio_hexapod import PinocchioHexapod as PinocchioHexapod
    from urdf.pinocchio_hexapod import load_pinocchio as load_pinocchio

# Imported when first asked for: Pinocchio is not everywhere.
_PINOCCHIO = ("PinocchioHexapod", "load_pinocchio")

__all__ = [
    "ClosureFile",
    "PinocchioHexapod",
    "load_pinocchio",
    "parse_closures",
    "render_closures",
    "render_mjcf",
    "render_sdf",
    "render_urdf",
]


def __getattr__(name: str) -> Any:
    if name in _PINOCCHIO:
        return getattr(import_module("urdf.pinocchio_hexapod"), name)
    raise AttributeError(f"module 'urdf' has no attribute {name!r}")
