"""The command `fk`: poses of the platform from leg lengths."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from compare.cli_arguments import MechanismName, OutputFile

LengthsFile = Annotated[
    Path,
    typer.Argument(
        metavar="LENGTHS",
        help="CSV or Parquet file with t,l1..l6 as ik writes it, with or without dl1..dl6 and ddl1..ddl6.",
    ),
]


def fk(
    mechanism: MechanismName,
    lengths: LengthsFile,
    output: OutputFile,
    every: Annotated[
        bool,
        typer.Option("--all", help="All assembly modes of each row, in columns t,mode,x,y,z,qw,qx,qy,qz."),
    ] = False,
    guess: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,ALPHA,BETA,GAMMA",
            help="Pose that the first row is reached from [m, rad]; the home pose by default.",
        ),
    ] = None,
) -> None:
    """Write poses as a motion file. Example: sixsps fk wu2012 lengths.csv --output motion.csv."""
    from compare.inputs import check_not_input
    from compare.poses import guess_of, mode_columns, motion_columns
    from compare.progress import reading, watching
    from sixsps.errors import InputError
    from sixsps.lengths_file import load
    from sixsps.mechanism import Mechanism
    from sixsps.tables import check_table_suffix, write_table

    check_table_suffix(output)
    check_not_input(output, mechanism, str(lengths))
    if every and guess is not None:
        raise InputError("--guess", "with --all", "without it: all poses are found, from no guess")
    hexapod = Mechanism.load(mechanism)
    start = None if every else guess_of(guess, hexapod)
    with reading():
        table = load(lengths)
    with watching(len(table.time)) as watch:
        if every:
            columns, told = mode_columns(hexapod, table, watch)
        else:
            columns, told = motion_columns(hexapod, table, start, watch)
    write_table(columns, output)
    for line in told:
        typer.echo(f"sixsps: {line}", err=True)
    raise typer.Exit(1 if told else 0)
