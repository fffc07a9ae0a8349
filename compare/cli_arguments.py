"""Arguments and options that several commands share, with their completion in a shell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sixsps.legs import Legs


def complete_mechanism(incomplete: str) -> list[str]:
    """Returns the names of the bundled mechanisms that begin so."""
    from sixsps.mechanism_file import bundled_mechanisms

    return [name for name in bundled_mechanisms() if name.startswith(incomplete)]


def complete_motion(incomplete: str) -> list[str]:
    """Returns the names of the bundled motions that begin so."""
    from sixsps.trajectories import bundled_motions

    return [name for name in bundled_motions() if name.startswith(incomplete)]


def complete_engine(incomplete: str) -> list[str]:
    """Returns the names of the engines that begin so."""
    from compare.registry import ENGINES

    return [name for name in ENGINES if name.startswith(incomplete)]


MechanismName = Annotated[
    str,
    typer.Argument(
        metavar="MECHANISM", help="Mechanism file (YAML) or bundled name.", autocompletion=complete_mechanism
    ),
]
MotionName = Annotated[
    str,
    typer.Argument(
        metavar="MOTION", help="Motion file (CSV, Parquet) or bundled name.", autocompletion=complete_motion
    ),
]
Engines = Annotated[
    list[str] | None,
    typer.Option(
        "--engine",
        metavar="NAME",
        help="Engine to compare, repeatable; all by default.",
        autocompletion=complete_engine,
    ),
]
Samples = Annotated[
    int | None, typer.Option(metavar="N", help="Samples of a bundled motion; 2001 by default.")
]
Cutoff = Annotated[
    float | None,
    typer.Option(
        metavar="HZ", help="Corner frequency that smooths a recorded motion; from the data by default."
    ),
]
Fit = Annotated[
    bool, typer.Option("--fit", help="Shift and scale a file's motion to the mechanism's home and strokes.")
]
LegType = Annotated[Legs, typer.Option(help="Joints at the base of the legs: ball (sps) or universal (ups).")]
PayloadName = Annotated[
    str | None,
    typer.Option(
        "--payload",
        metavar="NAME",
        help="What rides on the platform: mass, com and inertia in a YAML file, or a robot by name "
        "(panda, ur5, talos, ...) or URDF file.",
    ),
]
PayloadMotion = Annotated[
    Path | None,
    typer.Option(
        "--payload-motion",
        metavar="FILE",
        help="Motion of the robot's joints (CSV, Parquet): t,q1,q2,... or joint names; it stands without.",
    ),
]
PayloadMount = Annotated[
    str | None,
    typer.Option(
        "--payload-mount",
        metavar="POSE",
        help="Robot's base on the platform: x,y,z[,roll,pitch,yaw] [m, rad]; the platform frame by default.",
    ),
]
OutputFile = Annotated[
    Path, typer.Option("--output", metavar="FILE", help="File to write: .csv or .parquet.")
]
