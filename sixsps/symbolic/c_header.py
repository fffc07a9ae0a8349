"""What the C files say: the header's description of functions, conventions, results and parameters."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from importlib.metadata import version

from sixsps.parameters import PARAMETERS
from sixsps.singularity import REGULAR_CONDITION, SINGULAR_CONDITION

SOURCE, HEADER, NUMBERS = "hexapod.c", "hexapod.h", "hexapod_parameters.h"
"""File names: of the functions, of their declarations, of the parameters of one mechanism."""

PARAMETER_GROUPS: dict[str, str] = {
    "gravity": "x y z, world axes [m/s^2]",
    "base.anchors": "centres of the base joints, x y z of leg 1, then of legs 2 to 6, world axes [m]",
    "platform.anchors": "centres of the platform joints from O1, likewise, platform axes [m]",
    "platform.mass": "[kg]",
    "platform.com": "centre of mass from O1, x y z, platform axes [m]",
    "platform.inertia": "entries xx yy zz xy xz yz of the matrix about the centre of mass, platform axes "
    "[kg m^2]",
    "legs": "of leg 1, then of legs 2 to 6, four numbers of the lower and four of the upper link: mass [kg]; "
    "com, the distance of the centre of mass from the link's joint (lower: at the base, upper: at the "
    "platform) [m]; transverse and axial inertia about the centre of mass [kg m^2]",
}
"""Key of a mechanism file -> the entries of the parameter vector that begin with it, in order."""

_ARRAYS = {
    "position": "of O1 [m]",
    "quaternion": "w x y z, turns platform axes into world axes; of any length but 0",
    "velocity": "of O1 [m/s]",
    "angular_velocity": "of the platform [rad/s]",
    "acceleration": "of O1 [m/s^2]",
    "angular_acceleration": "of the platform [rad/s^2]",
    "force": "external, on the platform's centre of mass [N]",
    "moment": "external, on the platform [N m]",
    "forces": "of the actuators [N]; positive where one pushes, which extends its leg",
    "lengths": "from base joint to platform joint [m]",
    "length_rates": "[m/s]",
    "length_accelerations": "[m/s^2]",
    "by_pose": "d forces / d [dp; dtheta] [N/m, N/rad]",
    "by_twist": "d forces / d [velocity; angular_velocity] [N s/m, N s]",
    "by_acceleration": "d forces / d [acceleration; angular_acceleration] [kg, kg m]",
    "by_wrench": "d forces / d [force; moment] [1, 1/m]",
}

_TEXT_WIDTH = 96


def comment(text: str) -> str:
    """Returns any text as a C comment in ASCII, which nothing in the text can end.

    Args:
        text: lines stay lines; where a long one is wrapped it goes on two columns further in.
    """
    plain = text.encode("ascii", "backslashreplace").decode()
    # "*/" ends a comment, compilers warn of "/*", and "??/" is a backslash in any text of C99.
    plain = re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", plain)
    lines = []
    for line in plain.split("\n"):
        indent = len(line) - len(line.lstrip(" "))
        hanging = " " * (indent + 2) if indent else ""
        lines += textwrap.wrap(line, _TEXT_WIDTH, subsequent_indent=hanging) or [""]
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in lines), " */"]) + "\n"


def versions() -> str:
    """Returns in words what writes the files."""
    return f"sixsps {version('sixsps')} with CasADi {version('casadi')}"


def parameter_ranges() -> dict[str, range]:
    """Returns key of `PARAMETER_GROUPS` -> the indices of its entries in the parameter vector."""
    ranges, start = {}, 0
    for key in PARAMETER_GROUPS:
        size = sum(name == key or name.startswith(f"{key}.") for name in PARAMETERS)
        ranges[key] = range(start, start + size)
        start += size
    return ranges


def declaration(signature: str, about: str, arrays: Iterable[str]) -> str:
    """Returns the declaration of a function with its description.

    Args:
        signature: of the function in C.
        about: what it is for.
        arrays: names of its arguments.
    """
    listed = [f"  {name}: {_ARRAYS[name]}" for name in arrays if name in _ARRAYS]
    return comment("\n".join([about, "", *listed])) + f"{signature};\n"


def header_text(declarations: Iterable[str], kilobytes: int) -> str:
    """Returns the header.

    Args:
        declarations: of the functions.
        kilobytes: of stack that a call takes at most.
    """
    ranges = parameter_ranges().items()
    about = _ABOUT.format(
        versions=versions(),
        kilobytes=kilobytes,
        condition=f"{REGULAR_CONDITION:.0e}",
        singular=f"{SINGULAR_CONDITION:.0e}",
        shortest=f"{1 / REGULAR_CONDITION:.0e}",
        order="\n".join(f"  {_span(places)}: {key}, {PARAMETER_GROUPS[key]}" for key, places in ranges),
    )
    return "\n".join([comment(about), _OPENING, *declarations, _CLOSING])


def _span(places: range) -> str:
    return f"{places[0]}" if len(places) == 1 else f"{places[0]} to {places[-1]}"


# Below which cond(J) no pose is refused: the squares of J's entries sum to 6 or more, platform radius 1,
# so the largest singular value is 1 or more and |det J| >= cond^-5. The test passes from |det J| = 6.2e-11.
_ABOUT = f"""\
Leg forces and leg motion of a hexapod (6-SPS, Stewart-Gough platform).

Written by {{versions}}. {HEADER} and {SOURCE} are the same for every mechanism; the numbers of one \
are in {NUMBERS}. C99; in C++ the functions have C linkage.

The functions allocate nothing, keep nothing between calls and call nothing but sqrt: threads and \
interrupts may call them at the same time. A call does the same operations whatever the data, until all \
results are there; these are written last, and may overlap what is given. Stack: at most {{kilobytes}} KiB. \
double has to be IEEE 754 binary64; options such as -ffast-math are refused.

Units are SI. Vectors are in world axes unless said otherwise. O1 is the origin of the platform's axes.

Every function returns
  HEXAPOD_OK (0): all results are written, all are finite and, for forces and their derivatives, the pose \
is certainly regular: cond(J) is below {{condition}}, and every leg is longer than {{shortest}} of the \
platform radius. J takes the six leg forces to force and moment about O1, moments divided by the platform \
radius, which is the RMS distance of the platform joints from O1; cond is the ratio of the largest to the \
smallest singular value. About log10(cond(J)) of 16 digits are lost.
  HEXAPOD_NOT_REGULAR (1): the pose is singular, or it may be; nothing is written. This is returned for \
every pose with cond(J) above {{singular}}, which is what sixsps calls singular. It may be returned sooner, \
because the test takes a lower bound of the smallest singular value from det J, and that is low where \
several singular values are small at once; but not where cond(J) is below 100 and no leg is as short as \
above.
  HEXAPOD_NOT_FINITE (2): a result is infinite or not a number, because an argument is, by overflow, or \
because a leg without length has no direction; nothing is written. For forces, a pose that is not a number \
is not regular either and gives 1.

The entries of parameters[{len(PARAMETERS)}]:
{{order}}"""

_OPENING = f"""\
#ifndef SIXSPS_HEXAPOD_H
#define SIXSPS_HEXAPOD_H

#define HEXAPOD_PARAMETERS {len(PARAMETERS)}

#define HEXAPOD_OK 0
#define HEXAPOD_NOT_REGULAR 1
#define HEXAPOD_NOT_FINITE 2

#ifdef __cplusplus
extern "C" {{
#endif
"""

_CLOSING = """\
#ifdef __cplusplus
}
#endif

#endif
"""
