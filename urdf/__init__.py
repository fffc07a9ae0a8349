"""The hexapod as a multibody description: URDF with loop closures, MJCF, SDF, and a Pinocchio model.

All are in the home pose when their coordinates are zero. URDF, MJCF and the Pinocchio model are a tree that
is cut open at the six platform joints: `base` carries six legs (ball at A_i, prismatic actuator) and, on a
floating joint, the `platform`; frames `leg<i>_tip` and `platform_anchor<i>` coincide where a loop closes,
i = 1..6. In SDF ball joints close the loops.

All but `load_pinocchio` does without Pinocchio.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from urdf.closures import ClosureFile as ClosureFile
    from urdf.closures import parse_closures as parse_closures
    from urdf.closures import render_closures as render_closures
    from urdf.mjcf import render_mjcf as render_mjcf
    from urdf.options import Loops as Loops
    from urdf.pinocchio_hexapod import PinocchioHexapod as PinocchioHexapod
    from urdf.pinocchio_hexapod import load_pinocchio as load_pinocchio
    from urdf.render import render_urdf as render_urdf
    from urdf.sdf import render_sdf as render_sdf

# Imported when first asked for: the options of a command line need none of it.
_PLACES = {
    "ClosureFile": "closures",
    "Loops": "options",
    "PinocchioHexapod": "pinocchio_hexapod",
    "load_pinocchio": "pinocchio_hexapod",
    "parse_closures": "closures",
    "render_closures": "closures",
    "render_mjcf": "mjcf",
    "render_sdf": "sdf",
    "render_urdf": "render",
}
_MODULES = ("closures", "export", "layout", "mjcf", "render", "sdf")

__all__ = sorted(_PLACES)


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        value = getattr(import_module(f"urdf.{_PLACES[name]}"), name)
    elif name in _MODULES:
        value = import_module(f"urdf.{name}")
    else:
        raise AttributeError(f"module 'urdf' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
