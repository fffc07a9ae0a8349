"""The command `workspace`: what a mechanism can reach within its limits."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from compare.cli_arguments import MechanismName
from sixsps.errors import printable

if TYPE_CHECKING:
    from sixsps.workspace import Workspace


class Kind(StrEnum):
    """Which workspaces are sought."""

    translation = "translation"
    orientation = "orientation"
    both = "both"


def workspace(
    mechanism: MechanismName,
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for workspace.json, .parquet, .svg and .png.")
    ] = Path("workspace"),
    kind: Annotated[Kind, typer.Option(help="Positions, orientations, or both.")] = Kind.both,
    orientation: Annotated[
        str | None,
        typer.Option(
            metavar="ALPHA,BETA,GAMMA",
            help="Orientation of the reference pose, Euler angles [rad], R = Rx Ry Rz; 0,0,0 by default.",
        ),
    ] = None,
    position: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Position of the reference pose [m]; home by default."),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(metavar="REL", help="Gap allowed between the bounds of the volume, of the upper one."),
    ] = 0.01,
    cells: Annotated[
        int, typer.Option(metavar="N", help="Cells that each search may look at, of 2 kB; 1000 to 5000000.")
    ] = 300_000,
    singularity: Annotated[
        bool,
        typer.Option(
            "--singularity/--no-singularity", help="Whether poses beyond a singularity are out of reach."
        ),
    ] = True,
) -> None:
    """Positions and orientations within all limits. Example: sixsps workspace wu2012 --output workspace."""
    from compare import workspace_figures
    from compare.figures import available
    from compare.inputs import check_range
    from compare.modes import numbers
    from compare.progress import watching
    from compare.workspace import RESULTS, facts, table, write_cells
    from compare.workspace import orientation as rotation_of
    from sixsps.files import filled_folder, write_json
    from sixsps.home import home_position
    from sixsps.mechanism import Mechanism
    from sixsps.workspace import constant_orientation_workspace, orientation_workspace

    check_range("--tolerance", tolerance, 1e-6, 0.5)
    check_range("--cells", cells, 1000, 5_000_000)
    rotation = rotation_of(orientation)
    place = None if position is None else numbers("--position", position, 3)
    hexapod = Mechanism.load(mechanism)
    home_position(hexapod)  # what has no length limits is refused before a folder is made for it
    searches: dict[str, Callable[..., Workspace]] = {
        "translation": constant_orientation_workspace,
        "orientation": orientation_workspace,
    }
    found = []
    with filled_folder(output) as folder, watching(cells) as watch:
        for name, search in searches.items():
            if kind in (name, Kind.both):

                def told(judged: int, lower: float, upper: float, name: str = name) -> None:
                    gap = 1 - lower / upper if upper > 0 else 1.0
                    watch(name, f"gap {gap:.1%}", judged)

                found.append(
                    search(
                        hexapod, position=place, rotation=rotation, tolerance=tolerance, cells=cells,
                        singularity=singularity, watch=told,
                    )
                )  # fmt: skip
                watch(name, "ok", found[-1].judged)
        command = printable(shlex.join(["sixsps", *sys.argv[1:]]))
        written = [
            write_json(facts(found, command, cells, singularity), folder / RESULTS),
            write_cells(found, folder),
        ]
        if available():
            watch("figures", "drawing", 0)
            written += workspace_figures.write_figures(found, folder)
    for one in found:
        typer.echo(table(one))
    if not available():
        typer.echo('sixsps: no picture without matplotlib: pip install "sixsps[figures]"', err=True)
    typer.echo(f"written: {folder} ({', '.join(path.name for path in written)})")
