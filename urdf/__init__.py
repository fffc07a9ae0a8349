"""The hexapod as a multibody description: URDF with loop closures, and MJCF.

A tree that is cut open at the six platform joints, in the home pose when all coordinates are zero:
`base` carries six legs (ball at A_i, prismatic actuator) and, on a floating joint, the `platform`.
Frames `leg<i>_tip` and `platform_anchor<i>` coincide where a loop closes, i = 1..6.
"""

from urdf.closures import ClosureFile, parse_closures, render_closures
from urdf.mjcf import render_mjcf
from urdf.render import render_urdf

__all__ = ["ClosureFile", "parse_closures", "render_closures", "render_mjcf", "render_urdf"]
