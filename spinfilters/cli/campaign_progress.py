"""Progress of a campaign on a terminal, and what its interruption says."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spinfilters.api.arguments import CampaignArguments
from spinfilters.cli.common_options import shows_progress
from spinfilters.core.errors import InputError

if TYPE_CHECKING:
    from spinfilters.campaigns.engine import Advance


def rows_with_bar(
    study: Mapping[str, Any] | str, folder: Path, how: CampaignArguments, title: str, cure: str = ""
) -> "Advance":
    """Make the rows of a study that a folder lacks, with a bar of progress.

    Parameters
    ----------
    study : mapping or str
        Its tables, or the path of its file.
    folder : Path
        Of the rows.
    how : CampaignArguments
        Workers, scheduler and whether to go on with rows that are there.
    title : str
        Of the bar.
    cure : str
        How an interrupted command is run again, such as "with --resume ".

    Raises
    ------
    InputError
        As `spinfilters.campaign`; Ctrl-C, after the first row.
    """
    last: list[Advance] = []
    with _progress_bar(title) as show:

        def follow(advance: "Advance") -> None:
            """Show the progress of a campaign."""
            last[:] = [advance]
            show(advance)

        try:
            from spinfilters.api.campaign_frames import campaign_rows

            return campaign_rows(study, folder, how, follow)
        except KeyboardInterrupt:
            if not last:
                raise
            raise interruption(f"{last[0].done} of {last[0].total} runs", folder, cure) from None


def interruption(made: str, folder: Path, cure: str = "") -> InputError:
    """What an interrupted command says of a folder with a part of its results, such as "3 of 40 runs"."""
    return InputError(f"interrupted; {made} are in {folder}, run the command again {cure}to continue")


@contextmanager
def _progress_bar(title: str) -> "Iterator[Callable[[Advance], None]]":
    """A bar with the time left, on standard error; silent where that is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console = Console(stderr=True)
    is_shown = console.is_terminal and shows_progress()
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True, disable=not is_shown) as bar:
        task = bar.add_task("", total=None)

        def show(advance: "Advance") -> None:
            """Show how many runs are done."""
            left = advance.seconds_left
            rest = "" if left is None else f"{_duration(left)} left"
            bad = f", {advance.faulty} without a result" if advance.faulty else ""
            bar.update(task, completed=advance.done, total=advance.total, description=rest + bad)

        yield show


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
