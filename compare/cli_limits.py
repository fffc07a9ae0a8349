"""The command `check`: a motion held against the limits of a mechanism."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from compare.cli_arguments import Cutoff, Fit, MechanismName, MotionName, Samples, complete_engine
from sixsps.errors import InputError


def check(
    mechanism: MechanismName,
    motion: MotionName,
    engine: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="What computes forces where they are limited.",
            autocompletion=complete_engine,
        ),
    ] = "kane",
    output: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="All violations as .csv or .parquet, or everything as .json."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Margins over time: .svg, .pdf or .png.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON instead of a table.")] = False,
    samples: Samples = None,
    cutoff: Cutoff = None,
    fit: Fit = False,
) -> None:
    """Hold a motion against limits and singular poses. Example: sixsps check wu2012 line."""
    from compare.check import check as run
    from compare.check_report import check_output, json_text, write
    from compare.check_table import table
    from compare.figure_style import check_suffix
    from compare.figures import available
    from compare.inputs import check_not_input, load_motion
    from compare.margin_figure import write_figure
    from compare.progress import reading, watching
    from compare.registry import check_names
    from sixsps.mechanism import Mechanism

    check_names([engine])
    for path, check_path in ((output, check_output), (figure, check_suffix)):
        if path is not None:
            check_path(path)
            check_not_input(path, mechanism, motion)
    if figure is not None and not available():
        raise InputError("--figure", "matplotlib is not installed", 'pip install "sixsps[figures]" first')
    hexapod = Mechanism.load(mechanism)
    with reading():
        sampled = load_motion(motion, hexapod, samples=samples, cutoff=cutoff, fit=fit)
    with watching(len(sampled)) as watch:
        found = run(hexapod, sampled, engine, watch)
    if output is not None:
        write(found, output)
    if figure is not None:
        write_figure(found, figure)
    typer.echo(json_text(found) if as_json else table(found), nl=False)
    raise typer.Exit(0 if found.passed else 1)
