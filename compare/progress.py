"""Progress on a terminal's standard error; silence where that is no terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from compare.runner import Watcher


@contextmanager
def reading() -> Iterator[None]:
    """Shows that input is being read and smoothed, which takes a while where it is long."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status("reading the motion"):
        yield


@contextmanager
def watching(samples: int | None) -> Iterator[Watcher]:
    """Yields a watcher for `compare.runner.run` that shows one bar an engine.

    Args:
        samples: number of samples that every engine has to do; None where it is not known.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda *_: None
        return
    columns = (TextColumn("{task.description:<16}"), TextColumn("{task.fields[state]:<11}"))
    with Progress(
        *columns, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), console=console, transient=True
    ) as progress:
        tasks = {}

        def watch(engine: str, state: str, done: int) -> None:
            if engine not in tasks:
                tasks[engine] = progress.add_task(engine, total=samples, state=state)
            shown = samples if state == "ok" else done
            progress.update(tasks[engine], completed=shown, state=state)

        yield watch
