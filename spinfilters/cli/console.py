"""Console output of commands: tables that fit the width, and progress bars."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from spinfilters.cli.common_options import prints_text, shows_progress

if TYPE_CHECKING:
    from spinfilters.run.estimation import Progress as Report


WIDTH_OF_FILES = 150


def wide_console() -> Console:
    """Console that tables fit into, a terminal at its own width.

    It is silent where ``--quiet`` or ``--json`` asks for that. Texts are printed as they are:
    file names and comments of recordings may hold brackets and colons.
    """
    console = Console(markup=False, emoji=False, quiet=not prints_text())
    if not console.is_terminal:
        console.width = WIDTH_OF_FILES
    return console


@contextmanager
def progress_bars() -> "Iterator[Report]":
    """Progress bars on standard error, one per name as its work begins; silent where that is no terminal."""
    columns = (TextColumn("{task.description:>12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    is_shown = console.is_terminal and shows_progress()
    with Progress(*columns, console=console, transient=True, disable=not is_shown) as progress:
        tasks = {}

        def report(name: str, done: int, total: int) -> None:
            """Move a bar."""
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=total)
            progress.update(tasks[name], completed=done, total=total)

        yield report
