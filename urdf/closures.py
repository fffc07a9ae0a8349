"""Loop closures: the YAML sidecar that says which frames of the URDF coincide.

The keys are those that readers of closed-chain URDFs in the Pinocchio community use.
"""

from __future__ import annotations

from dataclasses import dataclass

import yaml

LEGS = range(1, 7)


@dataclass(frozen=True)
class ClosureFile:
    """Content of the sidecar.

    Attributes:
        closed_loop: pairs of frames whose origins coincide.
        type: of each closure; "3d" is a point.
        name_mot: names of the actuated joints.
    """

    closed_loop: tuple[tuple[str, str], ...]
    type: tuple[str, ...]
    name_mot: tuple[str, ...]


CLOSURES = ClosureFile(
    closed_loop=tuple((f"leg{i}_tip", f"platform_anchor{i}") for i in LEGS),
    type=("3d",) * 6,
    name_mot=tuple(f"leg{i}_actuator" for i in LEGS),
)
"""What every hexapod of `six_sps.urdf.xacro` and `mjcf.py` has."""


def render_closures(closures: ClosureFile = CLOSURES) -> str:
    """Returns the YAML text of the sidecar."""
    content = {
        "closed_loop": [list(pair) for pair in closures.closed_loop],
        "type": list(closures.type),
        "name_mot": list(closures.name_mot),
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None)


def parse_closures(text: str) -> ClosureFile:
    """Returns the content of a sidecar that `render_closures` wrote."""
    content = yaml.safe_load(text)
    return ClosureFile(
        closed_loop=tuple((a, b) for a, b in content["closed_loop"]),
        type=tuple(content["type"]),
        name_mot=tuple(content["name_mot"]),
    )
