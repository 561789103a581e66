"""The command ``campaign``: run a study, report it, repeat one of its runs."""

import json
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, NoReturn

from spinfilters.api.arguments import CampaignArguments
from spinfilters.cli.campaign_progress import rows_with_bar
from spinfilters.cli.command import Command, CommandGroup
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument, ArgumentGroup, NumberRange

NO_SHARDS: Final = (
    "campaigns have no shards any more; distribute runs to the workers of a Dask scheduler with --scheduler"
)


@dataclass(frozen=True, kw_only=True)
class RunStudyArguments:
    """Arguments of ``campaign run``."""

    study: Annotated[str, Argument("study file", positional=True, metavar="STUDY.toml")]
    output: Annotated[str, Argument("folder of the rows", short="-o", metavar="OUT")]
    how: Annotated[CampaignArguments, ArgumentGroup()] = field(default_factory=CampaignArguments)
    shard: Annotated[str | None, Argument("no longer available; use --scheduler", metavar="i/N")] = None


def run_study(options: RunStudyArguments) -> int:
    """Run every cell of a study with every seed, with a bar of progress; 1 where no run of them all has a result."""
    if options.shard is not None:
        raise InputError(NO_SHARDS)
    done = rows_with_bar(options.study, Path(options.output), options.how, "runs", "with --resume ")
    faulty = f", {done.faulty} of the new ones without a result" if done.faulty else ""
    if done.commonest_reason:
        faulty += f" (mostly: {done.commonest_reason})"
    report = f"spinfilters campaign report {shlex.quote(options.output)}"
    _print_line(f"{done.done} of {done.total} runs in {options.output}{faulty}; now: {report}")
    print_document(
        {
            "folder": options.output,
            "done": done.done,
            "total": done.total,
            "without_result": done.faulty,
            "commonest_reason": done.commonest_reason or None,
        }
    )
    return int(0 < done.faulty == done.done)


@dataclass(frozen=True, kw_only=True)
class ReportArguments:
    """Arguments of ``campaign report``."""

    folder: Annotated[str, Argument("folder of a campaign", positional=True, metavar="OUT")]


def report_campaign(options: ReportArguments) -> int:
    """Write the report of a finished or interrupted campaign."""
    from spinfilters.api.campaign_frames import require_installed

    require_installed("pyarrow")
    from spinfilters.campaigns.campaign_report import write_report

    written = write_report(Path(options.folder))
    _print_line(f"report: {written}")
    print_document({"report": str(written)})
    return 0


@dataclass(frozen=True, kw_only=True)
class MergeArguments:
    """Arguments of ``campaign merge`` in earlier versions."""

    folders: Annotated[tuple[str, ...], Argument("folders of shards", positional=True, metavar="SHARD")]
    output: Annotated[str | None, Argument("folder", short="-o", metavar="OUT")] = None


def refuse_shards(_: MergeArguments) -> NoReturn:
    """InputError: campaigns have no shards any more."""
    raise InputError(NO_SHARDS)


@dataclass(frozen=True, kw_only=True)
class RepeatArguments:
    """Arguments of ``campaign repeat``."""

    folder: Annotated[str, Argument("folder of a campaign", positional=True, metavar="OUT")]
    run: Annotated[
        int,
        NumberRange(0, 10**9, whole=True),
        Argument("number of a run, such as 17", positional=True, metavar="RUN"),
    ]
    output: Annotated[str | None, Argument("folder of the run's data set", short="-o", metavar="DATASET")] = (
        None
    )


def repeat_run(options: RepeatArguments) -> int:
    """Make one run again, print its row, write its data set where a folder is given."""
    from spinfilters.api.campaign_frames import repeated_run

    target = None if options.output is None else Path(options.output)
    row = repeated_run(Path(options.folder), options.run, target)
    numbers = {key: value for key, value in row.items() if not isinstance(value, list)}
    _print_line(json.dumps(numbers, indent=2))
    print_document(numbers)
    if target is not None:
        _print_line(f"data set of run {options.run}: {target}")
    return 0


def _print_line(text: str) -> None:
    from spinfilters.cli.console import wide_console

    wide_console().print(text, highlight=False, soft_wrap=True)


COMMAND = CommandGroup(
    "campaign",
    (
        Command(
            "run",
            RunStudyArguments,
            run_study,
            help="run every cell of a study with every seed",
            common=PrintingOptions,
        ),
        Command(
            "report",
            ReportArguments,
            report_campaign,
            help="report a finished or interrupted campaign",
            common=PrintingOptions,
        ),
        Command(
            "merge", MergeArguments, refuse_shards, help="no longer available; use campaign run --scheduler"
        ),
        Command("repeat", RepeatArguments, repeat_run, help="make one run again", common=PrintingOptions),
    ),
    default="run",
    description="Runs every cell of a study with every seed: spinfilters campaign STUDY.toml -o OUT, short for campaign run.",
)
