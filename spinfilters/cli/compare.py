"""``spinfilters compare`` and ``estimate``.

What draws is imported where it draws: matplotlib would be a third of the time before the first frame.
"""

import argparse
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.errors import InputError
from spinfilters.evaluation.comparison import comparison_table
from spinfilters.logs.dataset import Dataset, read_dataset
from spinfilters.logs.input_file import shown
from spinfilters.simulation.scenario import Scenario, simulate, without_map
from spinfilters.workflow.checkpointing import keep_in, remove_checkpoints
from spinfilters.workflow.conditions import conditions_of
from spinfilters.workflow.estimation import Comparison, compare_estimators
from spinfilters.workflow.estimation import Progress as Report
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.run_folder import (
    finished_run,
    mark_run_folder,
    open_run_folder,
    picture_files,
    refuse_source_within,
    write_run,
)
from spinfilters.workflow.run_lock import locked_run
from spinfilters.workflow.settings import ESTIMATORS, Settings, read_settings

if TYPE_CHECKING:
    from spinfilters.workflow.additions import Additions


def compare(options: argparse.Namespace) -> int:
    """Run the estimators, write the run folder and its figures, print the table."""
    settings = _settings(options)
    folder, additions = Path(options.output), _additions(options)
    if options.segment == "all" and options.dataset is not None:
        if additions is not None:
            additions.require_one_run()
        return _compare_segments(options.dataset, folder, settings)
    dataset = _dataset(options)
    refuse_source_within(folder, dataset.path)
    open_run_folder(folder)
    with locked_run(folder):
        if options.resume and finished_run(folder, dataset, settings) is not None:
            return _complete(folder, dataset, settings, additions)
        comparison = _compared(dataset, (folder, bool(options.resume)), settings, additions)
    _print_comparison(comparison, folder)
    _print_lacking(folder, additions)
    return 0


def _complete(folder: Path, dataset: Dataset, settings: Settings, additions: "Additions | None") -> int:
    """Draw the figures that a finished run lacks, and make what else is asked for."""
    with progress_bars() as report:
        made = _draw_missing(folder, settings, report)
        if additions is not None:
            made += additions.complete(
                folder, dataset, settings, lambda done, total: report("convergence", done, total)
            )
    rest = f"made {', '.join(made)}" if made else "nothing is left to do"
    wide_console().print(f"run folder: {folder} is complete, {rest}", highlight=False, soft_wrap=True)
    _print_lacking(folder, additions)
    return 0


def _compared(
    dataset: Dataset, place: tuple[Path, bool], settings: Settings, additions: "Additions | None"
) -> Comparison:
    """Run, write and draw in a folder, going on from its checkpoints when resuming."""
    folder, resume = place
    with progress_bars() as report:
        report("start", 0, 1)
        prepared = prepare(dataset, settings)
        report("start", 1, 1)
        if additions is not None:
            additions.check(prepared, settings)
        if not resume:
            remove_checkpoints(folder)
        mark_run_folder(folder, settings)
        comparison = compare_estimators(prepared, settings, report, keep_in(folder, prepared, settings))
        write_run(folder, comparison, settings)
        if not comparison.interrupted:
            _draw(comparison, folder, report)
            if additions is not None:
                additions.write(
                    folder, comparison, settings, lambda done, total: report("convergence", done, total)
                )
    return comparison


def _draw(comparison: Comparison, folder: Path, report: Report) -> None:
    from spinfilters.workflow.figures import Pictured, draw_run

    pictured = Pictured.from_comparison(comparison)
    draw_run(pictured, folder, lambda done, total: report("figures", done, total))


def _draw_missing(folder: Path, settings: Settings, report: Report) -> list[str]:
    """Figures that a finished run does not have, because Ctrl-C or a kill came while they were drawn."""
    missing = [name for name in picture_files(settings.estimators) if not (folder / name).exists()]
    if not missing:
        return []
    from spinfilters.workflow.figures import Pictured, draw_run

    pictured = Pictured.from_folder(folder)
    return draw_run(pictured, folder, lambda done, total: report("figures", done, total), missing)


def _additions(options: argparse.Namespace) -> "Additions | None":
    """What a run writes only when asked to, or None where nothing was asked."""
    if options.predict is None and not options.convergence:
        return None
    from spinfilters.workflow.additions import Additions

    return Additions(options.predict, options.convergence)


def _compare_segments(recording: str | None, folder: Path, settings: Settings) -> int:
    from spinfilters.cli.segments import compare_segments

    if recording is None:
        raise InputError("--segment all needs a recording; give its folder as DATASET")
    return compare_segments(recording, folder, settings)


def _print_comparison(comparison: Comparison, folder: Path) -> None:
    console = wide_console()
    conditions = conditions_of(comparison.prepared).sentences
    console.print(comparison_table(comparison.evaluations, conditions))
    for evaluation in comparison.evaluations:
        for reason in evaluation.history.status.reasons:
            console.print(
                f"{evaluation.name} is {evaluation.history.status.verdict}: {reason}", highlight=False
            )
    if comparison.interrupted:
        raise InputError(
            f"interrupted; what was estimated is in {folder}, run the command again with --resume to go on from there"
        )
    console.print(
        f"run folder: {folder}   (look at {folder / 'summary.png'})", highlight=False, soft_wrap=True
    )


def _print_lacking(folder: Path, additions: "Additions | None") -> None:
    lacking = None if additions is None else additions.lacking(folder)
    if lacking is not None:
        wide_console().print(lacking, highlight=False, soft_wrap=True)


def _settings(options: argparse.Namespace) -> Settings:
    settings = read_settings(Path(options.config)) if options.config else Settings()
    if options.estimators is not None:
        names = tuple(name.strip() for name in options.estimators.split(",") if name.strip())
        settings = replace(settings, estimators=names)
    elif options.known_map and not options.config:
        settings = replace(settings, estimators=ESTIMATORS)
    if options.drag:
        settings = replace(settings, process=replace(settings.process, drag=True))
    return settings


def _dataset(options: argparse.Namespace) -> Dataset:
    if options.dataset is None:
        if options.segment is not None:
            raise InputError(
                f"--segment {shown(options.segment)} needs a recording; give its folder as DATASET"
            )
        example = simulate(Scenario.disam115(seed=options.seed))
        return example if options.known_map else without_map(example)
    if options.known_map:
        raise InputError(
            "--known-map is for the bundled example; the known map of a data set is its landmarks.csv"
        )
    segment = None
    if options.segment is not None:
        if not re.fullmatch(r"[0-9]{1,9}", options.segment):
            raise InputError(f"--segment {shown(options.segment)} is no segment; give a number or 'all'")
        segment = int(options.segment)
    return read_dataset(options.dataset, segment)
