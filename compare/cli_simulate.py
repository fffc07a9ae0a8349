"""The command `simulate`: computed forces put into forward dynamics."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from compare.cli_arguments import Cutoff, Fit, MechanismName, MotionName, Samples
from compare.simulation.modes import Mode
from sixsps.errors import InputError, printable


def _complete_forward(incomplete: str) -> list[str]:
    from compare.forward import FORWARD

    return [name for name in FORWARD if name.startswith(incomplete)]


def simulate(
    mechanism: MechanismName,
    motion: MotionName,
    engine: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Forward dynamics; exudyn is driven by the leg lengths and takes no mode.",
            autocompletion=_complete_forward,
        ),
    ] = "closed-form",
    output: Annotated[
        Path,
        typer.Option(
            metavar="DIR", help="Folder for simulation.json, trajectory.parquet and errors.parquet."
        ),
    ] = Path("simulation"),
    mode: Annotated[
        Mode | None,
        typer.Option(
            help="Accelerations, forces alone, or forces and a PD; recover by default, with --figures "
            "feedforward."
        ),
    ] = None,
    figures: Annotated[
        bool, typer.Option("--figures", help="Also the paper's figures 3 to 7, SVG and PNG.")
    ] = False,
    force_step: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Time between the forces that feedforward knows [s]; 0.005 by default."
        ),
    ] = None,
    stiffness: Annotated[
        float | None,
        typer.Option(metavar="K", help="Of the PD on each leg [N/m]; from the mechanism by default."),
    ] = None,
    damping: Annotated[
        float | None,
        typer.Option(metavar="D", help="Of the PD on each leg [N s/m]; from the mechanism by default."),
    ] = None,
    samples: Samples = None,
    cutoff: Cutoff = None,
    fit: Fit = False,
) -> None:
    """Put leg forces into forward dynamics. Example: sixsps simulate wu2012 line --output simulation."""
    from compare.figures import available
    from compare.inputs import check_range, load_motion
    from compare.progress import reading, watching
    from compare.simulation.outputs import summary, write_simulation
    from compare.simulation.simulate import Request
    from compare.simulation.simulate import simulate as run
    from sixsps.files import output_folder
    from sixsps.mechanism import Mechanism

    check_range("--force-step", force_step, 1e-6, 10.0)
    check_range("--stiffness", stiffness, 0.0, 1e12)
    check_range("--damping", damping, 0.0, 1e12)
    request = Request(engine, mode, figures, force_step, stiffness, damping)
    if figures and not available():
        raise InputError("--figures", "matplotlib is not installed", 'pip install "sixsps[figures]" first')
    hexapod = Mechanism.load(mechanism)
    with reading():
        sampled = load_motion(motion, hexapod, samples=samples, cutoff=cutoff, fit=fit)
    hexapod.check_inertia()
    folder = output_folder(output)
    with watching(len(sampled)) as watch:
        done = run(hexapod, sampled, request, lambda samples: watch(engine, request.mode_name, samples))
    write_simulation(done, printable(shlex.join(["sixsps", *sys.argv[1:]])), folder)
    for line in summary(done.facts):
        typer.echo(line)
    for note in done.facts["notes"]:
        typer.echo(f"sixsps: {note}", err=True)
    if not done.complete:
        stop = done.facts["stopped"]
        typer.echo(f"sixsps: stopped at t = {stop['t']:g} s: {stop['reason']}", err=True)
    if figures and done.facts["samples"] > 1:
        from compare.simulation.figures import write_figures

        write_figures(done.outcome.trajectory, hexapod, folder)
    typer.echo(f"written: {folder}")
    raise typer.Exit(0 if done.complete and done.accurate else 1)
