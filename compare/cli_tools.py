"""Commands that hand results to other programs, and those that size a mechanism: `export`, `modes`."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from compare.cli_arguments import Cutoff, Fit, LegType, MechanismName, MotionName
from sixsps.legs import Legs
from urdf.options import Loops

if TYPE_CHECKING:
    from sixsps.mechanism import Mechanism

export = typer.Typer(
    help="Write a mechanism, or its forces along a motion, in the form that another program reads.",
    rich_markup_mode=None,
)

DescriptionPath = Annotated[
    Path, typer.Option("--output", metavar="PATH", help="Folder, or file name of the URDF, MJCF or SDF.")
]


class ForceFormat(StrEnum):
    """What `export driving-functions` can write."""

    adams = "adams"
    matlab = "matlab"
    csv = "csv"
    json = "json"


@export.command()
def urdf(mechanism: MechanismName, output: DescriptionPath, legs: LegType = Legs.sps) -> None:
    """Write URDF, closure YAML and MJCF. Example: sixsps export urdf wu2012 --output description."""
    from urdf.export import export_urdf

    _describe(export_urdf, mechanism, output, legs)


@export.command()
def mjcf(mechanism: MechanismName, output: DescriptionPath, legs: LegType = Legs.sps) -> None:
    """Write MJCF. Example: sixsps export mjcf wu2012 --output wu2012.xml."""
    from urdf.export import export_mjcf

    _describe(export_mjcf, mechanism, output, legs)


@export.command()
def sdf(
    mechanism: MechanismName,
    output: DescriptionPath,
    legs: LegType = Legs.sps,
    loops: Annotated[
        Loops, typer.Option(help="Close them by ball joints, or by constraints that only Drake reads.")
    ] = Loops.joints,
) -> None:
    """Write SDF. Example: sixsps export sdf wu2012 --output wu2012.sdf."""
    from functools import partial

    from urdf.export import export_sdf

    _describe(partial(export_sdf, loops=loops), mechanism, output, legs)


def _describe(
    write: Callable[[Mechanism, Path, Legs], list[Path]], mechanism: str, output: Path, legs: Legs
) -> None:
    from sixsps.mechanism import Mechanism

    for path in write(Mechanism.load(mechanism), output, legs):
        typer.echo(str(path))


@export.command()
def c(
    mechanism: MechanismName,
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder for source, headers and example.")],
    derivatives: Annotated[
        bool, typer.Option("--derivatives", help="Also the exact derivatives of the forces.")
    ] = False,
) -> None:
    """Write C99 for controllers: forces, lengths. Example: sixsps export c wu2012 --output controller."""
    from compare.c_export import export_c
    from sixsps.mechanism import Mechanism

    for path in export_c(Mechanism.load(mechanism), output, derivatives):
        typer.echo(str(path))


@export.command()
def driving_functions(
    mechanism: MechanismName,
    motion: MotionName,
    format: Annotated[  # noqa: A002  shown in the help
        ForceFormat, typer.Option(help="ADAMS/Solver splines, MATLAB function, table, or JSON.")
    ],
    output: Annotated[Path, typer.Option(metavar="FILE", help="File to write: .adm, .m, .csv or .json.")],
    tolerance: Annotated[
        float,
        typer.Option(metavar="REL", help="Interpolation error allowed, relative to the largest force."),
    ] = 1e-6,
    cutoff: Cutoff = None,
    fit: Fit = False,
) -> None:
    """Write leg forces as splines over time.

    Few knots, and a stated error. Example:
    sixsps export driving-functions wu2012 line --format adams --output forces.adm.
    """
    from functools import partial

    from compare.driving_functions import check_output, interpolation, summary, write
    from compare.inputs import check_not_input, check_range, load_motion
    from compare.progress import reading
    from sixsps.driving_functions import TOLERANCES, driving_functions
    from sixsps.mechanism import Mechanism
    from sixsps.trajectories import bundled, bundled_motions

    check_range("--tolerance", tolerance, *TOLERANCES)
    check_output(format, output)
    check_not_input(output, mechanism, motion)
    hexapod = Mechanism.load(mechanism)
    with reading():
        given = load_motion(motion, hexapod, cutoff=cutoff, fit=fit)
        everywhere = motion in bundled_motions()
        sampled = partial(bundled, motion, hexapod) if everywhere else given
        functions = driving_functions(hexapod, sampled, interpolation(format, everywhere), tolerance)
    write(functions, format, output)
    typer.echo(f"{output}: {summary(functions)}")


def modes(
    mechanism: MechanismName,
    stiffness: Annotated[
        str,
        typer.Option(metavar="K", help="Stiffness of each actuator, one number or six with commas [N/m]."),
    ],
    pose: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,ALPHA,BETA,GAMMA",
            help="Position [m] and Euler angles [rad], R = Rx Ry Rz; the home pose by default.",
        ),
    ] = None,
    point: Annotated[
        str, typer.Option(metavar="X,Y,Z", help="Point of the platform for the compliance, its axes [m].")
    ] = "0,0,0",
    force: Annotated[
        str, typer.Option(metavar="FX,FY,FZ", help="Force on the platform's centre of mass, world axes [N].")
    ] = "0,0,0",
    preload: Annotated[
        bool, typer.Option("--preload/--no-preload", help="What gravity and force do to the stiffness.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="JSON instead of a table.")] = False,
    output: Annotated[Path | None, typer.Option(metavar="FILE", help="File to write it to.")] = None,
) -> None:
    """Natural frequencies, mode shapes and compliance. Example: sixsps modes wu2012 --stiffness 1e6."""
    from compare.modes import json_text, mapping, numbers, pose_of, table
    from sixsps.files import write_atomically
    from sixsps.mechanism import Mechanism
    from sixsps.modes import modes as modes_of

    stiffnesses = numbers("--stiffness", stiffness, 1, 6)
    place, load = numbers("--point", point, 3), numbers("--force", force, 3)
    hexapod = Mechanism.load(mechanism)
    position, rotation = pose_of(hexapod, pose)
    k = stiffnesses if len(stiffnesses) == 6 else stiffnesses[0]
    found = modes_of(hexapod, position, rotation, k, force=load, preload=preload)
    answer = (hexapod.name, position, found, place)
    text = json_text(mapping(*answer)) if as_json else table(*answer)
    if output is None:
        typer.echo(text, nl=False)
        return
    with write_atomically(output) as temporary:
        temporary.write_text(text, encoding="utf-8")
