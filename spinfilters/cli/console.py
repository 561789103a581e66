"""Console output of commands: tables that fit the width, and progress bars."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from spinfilters.run.estimation import Progress as Report


WIDTH_OF_FILES = 150


def wide_console() -> Console:
    """Console that tables fit into, a terminal at its own width.

    Texts are printed as they are: file names and comments of recordings may hold brackets and colons.
    """
    console = Console(markup=False, emoji=False)
    return console if console.is_terminal else Console(width=WIDTH_OF_FILES, markup=False, emoji=False)


@contextmanager
def progress_bars() -> "Iterator[Report]":
    """Progress bars on standard error, one per name as its work begins; silent where that is no terminal."""
    columns = (TextColumn("{task.description:>12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        tasks = {}

        def report(name: str, done: int, total: int) -> None:
            """Move a bar."""
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=total)
            progress.update(tasks[name], completed=done, total=total)

        yield report
