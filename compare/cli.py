"""The command `sixsps`. Parses, calls and prints; everything else is elsewhere.

Exit status: 0 done and all engines agree, 1 an engine disagrees or failed or a pose is singular,
2 bad input, told in one line on standard error.
"""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from compare.cli_arguments import (
    Cutoff,
    Engines,
    Fit,
    LegType,
    MechanismName,
    MotionName,
    OutputFile,
    PayloadMotion,
    PayloadMount,
    PayloadName,
    Samples,
    complete_engine,
    complete_motion,
)
from compare.cli_kinematics import fk
from compare.cli_limits import check
from compare.cli_simulate import simulate
from compare.cli_tools import export, modes
from compare.cli_workspace import workspace
from sixsps.errors import InputError, SixspsError, printable, shown
from sixsps.legs import Legs

app = typer.Typer(
    name="sixsps",
    help="Leg forces of a hexapod (6-SPS, Stewart-Gough platform) that can be trusted.",
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


_INTERRUPTED = 130
# What typer raises for a command line that it cannot parse; its class has no public name.
_UsageError: Any = typer.BadParameter.__base__


@app.callback()
def _help_without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def compare(
    mechanism: MechanismName = "wu2012",
    motion: MotionName = "line",
    engine: Engines = None,
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder for report and results.")] = Path(
        "report"
    ),
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="REL", help="Relative error allowed; 1e-10 by default, more near singularities."
        ),
    ] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(metavar="S", help="Seconds an engine may take; by default 120 and 0.01 a sample."),
    ] = None,
    traps: Annotated[
        bool, typer.Option("--traps", help="Add calls that are wrong without a word, apart from the engines.")
    ] = False,
    legs: LegType = Legs.sps,
    samples: Samples = None,
    cutoff: Cutoff = None,
    fit: Fit = False,
    payload: PayloadName = None,
    payload_motion: PayloadMotion = None,
    payload_mount: PayloadMount = None,
) -> None:
    """Compare engines along a motion. Example: sixsps compare wu2012 line --output report."""
    from compare.comparison import compare as run_comparison
    from compare.figures import preload
    from compare.inputs import check_range, load_motion
    from compare.outputs import write_outputs
    from compare.payload.cargo import open_cargo
    from compare.progress import reading, watching
    from compare.registry import TRAPS, check_names, with_legs
    from compare.runner import LONGEST_LIMIT_S
    from compare.summary import answer
    from compare.terminal import terminal
    from sixsps.files import output_folder
    from sixsps.mechanism import Mechanism

    cargo = open_cargo(payload, payload_motion, payload_mount)
    check_names(engine or [], traps=True, robot=cargo is not None and cargo.is_robot)
    check_range("--tolerance", tolerance, 0.0, 1.0)
    check_range("--time-limit", time_limit, 0.001, LONGEST_LIMIT_S)
    if traps and legs is Legs.ups:
        raise InputError("--traps", "with --legs ups", "with --legs sps")
    hexapod = Mechanism.load(mechanism)
    hexapod.check_inertia()
    with reading():
        sampled = load_motion(motion, hexapod, samples=samples, cutoff=cutoff, fit=fit)
        aboard = None if cargo is None else cargo.aboard(hexapod, sampled)
    folder = output_folder(output)
    names = list(dict.fromkeys(engine or with_legs(legs, robot=cargo is not None and cargo.is_robot)))
    caught = [name for name in TRAPS if traps and name not in names]
    preload()
    with watching(len(sampled)) as watch:
        comparison = run_comparison(
            hexapod, sampled, names, traps=caught, requested=engine or (), legs=legs,
            tolerance=tolerance, time_limit=time_limit, watch=watch, aboard=aboard,
        )  # fmt: skip
    comparison.results["command"] = printable(shlex.join(["sixsps", *sys.argv[1:]]))
    report = write_outputs(comparison, hexapod, folder)
    _print(terminal(comparison.results))
    typer.echo(answer(comparison.results))
    typer.echo(f"report: {report}")
    raise typer.Exit(0 if comparison.agreed else 1)


@app.command()
def forces(
    mechanism: MechanismName,
    motion: MotionName,
    output: OutputFile,
    engine: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="What computes them; kane by default.", autocompletion=complete_engine
        ),
    ] = None,
    reactions: Annotated[
        bool,
        typer.Option(
            "--reactions",
            help="Also the forces on the legs at base joints a1x,a1y,a1z..a6z and platform joints b1x..b6z "
            "[N], world axes; all forces then by newton-euler.",
        ),
    ] = False,
    samples: Samples = None,
    cutoff: Cutoff = None,
    fit: Fit = False,
    payload: PayloadName = None,
    payload_motion: PayloadMotion = None,
    payload_mount: PayloadMount = None,
) -> None:
    """Write leg forces t,f1..f6 [N]. Example: sixsps forces wu2012 line --output forces.csv."""
    from compare.inputs import check_not_input
    from compare.payload.cargo import open_cargo, open_motions_aboard
    from compare.progress import reading, watching
    from compare.registry import check_names
    from compare.single import chosen_engine, forces_calculation
    from compare.streaming import stream
    from sixsps.mechanism import Mechanism
    from sixsps.tables import check_table_suffix

    name = chosen_engine(engine, reactions)
    check_names([name])
    check_table_suffix(output)
    inputs = (mechanism, motion, payload, payload_motion)
    check_not_input(output, *(str(name) for name in inputs if name is not None))
    cargo = open_cargo(payload, payload_motion, payload_mount)
    hexapod = Mechanism.load(mechanism)
    hexapod.check_inertia()
    with reading():
        hexapod, motions, warnings = open_motions_aboard(
            cargo, motion, hexapod, samples=samples, cutoff=cutoff, fit=fit
        )
    _warn(warnings)
    with watching(motions.samples) as watch:
        singular = stream(motions, forces_calculation(name, hexapod, reactions), output, watch)
    _warn(singular.lines())
    raise typer.Exit(1 if singular.number else 0)


@app.command()
def ik(
    mechanism: MechanismName,
    motion: MotionName,
    output: OutputFile,
    rates: Annotated[bool, typer.Option("--rates", help="Also length rates dl1..dl6 [m/s].")] = False,
    samples: Samples = None,
    cutoff: Cutoff = None,
    fit: Fit = False,
) -> None:
    """Write leg lengths t,l1..l6 [m]. Example: sixsps ik wu2012 line --rates --output lengths.csv."""
    from compare.inputs import check_not_input, open_motions
    from compare.progress import reading, watching
    from compare.single import lengths_calculation
    from compare.streaming import stream
    from sixsps.mechanism import Mechanism
    from sixsps.tables import check_table_suffix

    check_table_suffix(output)
    check_not_input(output, mechanism, motion)
    hexapod = Mechanism.load(mechanism)
    with reading():
        motions = open_motions(motion, hexapod, samples=samples, cutoff=cutoff, fit=fit)
    with watching(motions.samples) as watch:
        stream(motions, lengths_calculation(hexapod, rates), output, watch)


@app.command()
def engines() -> None:
    """List the engines: what is here, which version, or why not. Example: sixsps engines."""
    from compare.registry import ENGINES
    from compare.runner import probe

    for outcome in probe(list(ENGINES)):
        here = outcome.status == "ok"
        typer.echo(f"{outcome.engine:<16}{outcome.facts['version'] if here else outcome.reason}")


@app.command()
def digits(
    motion: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MOTION]...",
            help="Bundled names or files; line and sinusoids by default.",
            autocompletion=complete_motion,
        ),
    ] = None,
    engine: Engines = None,
    samples: Annotated[int, typer.Option(metavar="N", help="Samples of a bundled motion.")] = 401,
    output: Annotated[Path | None, typer.Option(metavar="FILE", help="File for the table.")] = None,
) -> None:
    """Table of correct digits on all bundled mechanisms. Example: sixsps digits line sinusoids."""
    from compare.digits import MOTIONS, cases, markdown
    from compare.registry import ENGINES, check_names
    from sixsps.files import write_atomically

    check_names(engine or [])
    done = list(cases(motion or MOTIONS, list(dict.fromkeys(engine or ENGINES)), samples))
    table = markdown(done)
    if output is None:
        typer.echo(table, nl=False)
    else:
        with write_atomically(output) as temporary:
            temporary.write_text(table, encoding="utf-8")
    raise typer.Exit(0 if all(case.agreed for case in done) else 1)


@app.command()
def errata(
    output: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the table and the case it is made from.")
    ] = None,
) -> None:
    """Show what the paper's misprints cost. Example: sixsps errata --output errata."""
    from sixsps.files import output_folder

    try:
        from sixsps.errata import markdown, write
    except Exception as error:  # a broken library says what it likes
        raise SixspsError(f"the errata need python-flint: {type(error).__name__}: {error}") from error

    if output is None:
        typer.echo(markdown())
        return
    for path in write(output_folder(output)):
        typer.echo(str(path))


app.command()(simulate)
app.command()(modes)
app.command()(check)
app.command()(fk)
app.command()(workspace)
app.add_typer(export, name="export")


def _print(renderable: Any) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=80)
    console.print(renderable)


def _warn(lines: list[str]) -> None:
    for line in lines:
        typer.echo(f"sixsps: {line}", err=True)


def main() -> None:
    """Runs the command and ends the process with its exit status."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _terminate)
    sys.exit(_status(lambda: app(standalone_mode=False)))


def _terminate(number: int, _frame: object) -> None:
    """Ends the process by an exception, so that temporary files go and engines' processes end."""
    raise SystemExit(128 + number)


def _value_at_fault(error: Exception) -> str:
    """Returns the value that typer's message about a bad option leaves out."""
    details: list[Any] = getattr(error.__cause__, "errors", list)()
    return f": {shown(details[0]['input'])}" if details else ""


def _status(command: Callable[[], Any]) -> int:
    try:
        return _interrupted_or(int(command() or 0))
    except InputError as error:
        _warn([str(error)])
        return 2
    except SixspsError as error:
        _warn([str(error)])
        return 1
    except _UsageError as error:
        message = " ".join(error.format_message().split()).rstrip(".") + _value_at_fault(error)
        _warn([f"{message}; see --help"])
        return 2
    except typer.Exit as stop:
        return _interrupted_or(int(stop.exit_code))
    except OSError as error:  # a full disk, or a standard output that is full or closed
        _warn([printable(str(error))])
        return 1
    except (typer.Abort, KeyboardInterrupt):
        return _interrupted_or(_INTERRUPTED)


def _interrupted_or(status: int) -> int:
    """Returns an exit status; that of an interruption, which typer gives without a word, is told."""
    if status == _INTERRUPTED:
        _warn(["interrupted; nothing was left half-written"])
    return status
