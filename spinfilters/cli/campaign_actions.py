"""``spinfilters campaign``: run a study, report it, repeat one of its runs."""

import argparse
import json
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from spinfilters.api.campaign_frames import campaign_rows, repeated_run, require_installed
from spinfilters.cli.console import wide_console
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import value_text

if TYPE_CHECKING:
    from spinfilters.campaigns.engine import Advance


def campaign(options: argparse.Namespace) -> int:
    """Run the action named by the first argument, or a study file."""
    if options.what == "merge" or options.shard is not None:
        raise InputError(
            "campaigns have no shards any more; let the workers of a Dask scheduler share the runs, with --scheduler"
        )
    parts = {"report": _report, "repeat": _repeat}
    if options.what in parts:
        _refuse_run_options(options)
        return parts[options.what](options)
    return _run(options)


def _run(options: argparse.Namespace) -> int:
    if options.arguments:
        raise InputError(
            f"{value_text(options.arguments[0])} is one argument too many; give one study file and -o OUT"
        )
    if options.output is None:
        raise InputError("a campaign needs a folder for its rows; give it with -o OUT")
    last = _carried_out(options)
    faulty = f", {last.faulty} of the new ones without a result" if last.faulty else ""
    report = f"spinfilters campaign report {shlex.quote(options.output)}"
    _say(f"{last.done} of {last.total} runs in {options.output}{faulty}; now: {report}")
    return 0


def _carried_out(options: argparse.Namespace) -> "Advance":
    """Final progress of a campaign. InputError: interrupted before."""
    last: list[Advance] = []
    with _progress_line() as tell:

        def follow(advance: "Advance") -> None:
            """Show the progress of a campaign."""
            last[:] = [advance]
            tell(advance.done, advance.total, advance.faulty, advance.seconds_left)

        try:
            campaign_rows(
                Path(options.what),
                Path(options.output),
                workers=options.workers,
                scheduler=options.scheduler,
                resume=options.resume,
                progress=follow,
            )
        except KeyboardInterrupt:
            if not last:
                raise
            raise InputError(
                f"interrupted; {last[0].done} of {last[0].total} runs are in {options.output}, run the command again "
                "with --resume to go on from there"
            ) from None
    return last[0]


def _report(options: argparse.Namespace) -> int:
    require_installed("pyarrow")
    from spinfilters.campaigns.campaign_report import write_report

    page = write_report(Path(_only(options, "report", "OUT")))
    _say(f"report: {page}")
    return 0


def _repeat(options: argparse.Namespace) -> int:
    if len(options.arguments) != 2 or not options.arguments[1].isdecimal():
        raise InputError("repeat needs a campaign's folder and the number of a run: campaign repeat OUT 17")
    folder, run = options.arguments
    target = None if options.output is None else Path(options.output)
    row = repeated_run(Path(folder), int(run), target)
    _say(json.dumps({key: value for key, value in row.items() if not isinstance(value, list)}, indent=2))
    if target is not None:
        _say(f"data set of run {run}: {target}")
    return 0


def _only(options: argparse.Namespace, what: str, name: str) -> str:
    if len(options.arguments) != 1:
        raise InputError(f"campaign {what} needs one folder: campaign {what} {name}")
    return options.arguments[0]


def _refuse_run_options(options: argparse.Namespace) -> None:
    given = {"--workers": options.workers, "--scheduler": options.scheduler}
    given["--resume"] = options.resume or None
    unused = [name for name, value in given.items() if value is not None]
    if options.output is not None and options.what == "report":
        unused.append("-o")
    if unused:
        raise InputError(f"{unused[0]} is not for campaign {options.what}; leave it out")


def _say(text: str) -> None:
    wide_console().print(text, highlight=False, soft_wrap=True)


@contextmanager
def _progress_line() -> Iterator:
    """A bar with the time left, on standard error; silent where that is no terminal."""
    from rich.console import Console

    console = Console(stderr=True)
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)

        def tell(done: int, total: int, faulty: int, left: float | None) -> None:
            """Show how many runs are done."""
            rest = "" if left is None else f"{_duration(left)} left"
            bad = f", {faulty} without a result" if faulty else ""
            bar.update(task, completed=done, total=total, description=rest + bad)

        yield tell


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return (
        f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
    )
