"""Estimators run on a data set, and their results printed: ``spinfilters compare`` and ``estimate``."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.core.errors import InputError
from spinfilters.evaluation.comparison_table import comparison_table
from spinfilters.io.dataset import Dataset
from spinfilters.models.status import verdict_sentences
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.estimation import Comparison
from spinfilters.run.run_folder import REPORT_FILE
from spinfilters.settings.run_settings import Settings

if TYPE_CHECKING:
    from spinfilters.run.optional_outputs import OptionalOutputs


_FLIGHTS_TOLD = 4


def compare_and_print(
    dataset: Dataset,
    settings: Settings,
    options: argparse.Namespace,
    optional_outputs: "OptionalOutputs | None",
) -> None:
    """Run the estimators, write the run folder and its figures, print the table."""
    folder = Path(options.output)
    output = RunOutput(folder, bool(options.resume), optional_outputs)
    with progress_bars() as report:
        written = compare_into(dataset, settings, output, report)
    if written.comparison is None:
        rest = f"made {', '.join(written.completed)}" if written.completed else "nothing is left to do"
        wide_console().print(f"run folder: {folder} is complete, {rest}", highlight=False, soft_wrap=True)
    else:
        _print_comparison(written.comparison, folder)
        _print_flights(written.comparison, options)
    _print_lacking(folder, optional_outputs)


def _print_comparison(comparison: Comparison, folder: Path) -> None:
    console = wide_console()
    console.print(comparison_table(comparison.evaluations, comparison.conditions.sentences))
    for sentence in verdict_sentences({each.name: each.history.status for each in comparison.evaluations}):
        console.print(sentence, highlight=False)
    if comparison.interrupted:
        raise InputError(
            f"interrupted; what was estimated is in {folder}, run the command again with --resume to go on from there"
        )
    console.print(f"run folder: {folder}   (look at {folder / REPORT_FILE})", highlight=False, soft_wrap=True)


def _print_flights(comparison: Comparison, options: argparse.Namespace) -> None:
    """Print a hint where only part of a recording is free flight.

    The hint comes only if the whole of it is not ok.
    """
    is_whole = options.dataset is not None and options.segment is None
    if not is_whole or all(each.history.status.verdict == "ok" for each in comparison.evaluations):
        return
    from spinfilters.run.free_flight import flights_within

    flights = flights_within(comparison.setup.dataset)
    if flights:
        stretches = ", ".join(f"{flight.start:.3f}:{flight.end:.3f}" for flight in flights[:_FLIGHTS_TOLD])
        more = ", ..." if len(flights) > _FLIGHTS_TOLD else ""
        wide_console().print(
            f"only part of the recording is free flight ({stretches}{more} s): compare that with --segment auto",
            highlight=False,
            soft_wrap=True,
        )


def _print_lacking(folder: Path, optional_outputs: "OptionalOutputs | None") -> None:
    if optional_outputs is not None:
        for line in optional_outputs.sentences(folder):
            wide_console().print(line, highlight=False, soft_wrap=True)
    lacking = None if optional_outputs is None else optional_outputs.lacking(folder)
    if lacking is not None:
        wide_console().print(lacking, highlight=False, soft_wrap=True)
