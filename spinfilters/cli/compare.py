"""``spinfilters compare``, ``estimate`` and ``plot``."""

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from spinfilters.errors import InputError
from spinfilters.evaluation.comparison import comparison_table
from spinfilters.logs.dataset import Dataset, read_dataset, read_segments
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.workflow.additions import Additions
from spinfilters.workflow.checkpointing import keep_in, remove_checkpoints
from spinfilters.workflow.estimation import Comparison, compare_estimators
from spinfilters.workflow.estimation import Progress as Report
from spinfilters.workflow.figures import Pictured, draw_run
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.run_folder import finished_run, mark_run_folder, open_run_folder, write_run
from spinfilters.workflow.segments import run_segments, segment_medians, segment_table, write_segments
from spinfilters.workflow.settings import Settings, read_settings

WIDTH_OF_FILES = 150
RECORDING_ESTIMATORS = ("mekf", "ukf", "smoother")


def compare(options: argparse.Namespace) -> int:
    """Run the estimators, write the run folder and its figures, print the table."""
    settings = _settings(options)
    folder, additions = Path(options.output), Additions(options.predict, options.convergence)
    if options.segment == "all":
        additions.require_one_run()
        return _compare_segments(read_segments(options.dataset), folder, settings)
    dataset = _dataset(options)
    open_run_folder(folder)
    finished = options.resume and finished_run(folder, dataset, settings) is not None
    if finished and not additions.missing(folder):
        console = _wide_console()
        console.print(f"run folder: {folder} is complete, nothing is left to do", highlight=False)
        return 0
    comparison = _compared(dataset, (folder, bool(options.resume)), settings, additions)
    _print_comparison(comparison, folder)
    return 0


def _compared(
    dataset: Dataset, place: tuple[Path, bool], settings: Settings, additions: Additions
) -> Comparison:
    """Run, write and draw in a folder, going on from its checkpoints when resuming."""
    folder, resume = place
    with _bars() as report:
        report("start", 0, 1)
        prepared = prepare(dataset, settings)
        report("start", 1, 1)
        additions.check(prepared, settings)
        if not resume:
            remove_checkpoints(folder)
        mark_run_folder(folder, settings)
        comparison = compare_estimators(prepared, settings, report, keep_in(folder, prepared, settings))
        write_run(folder, comparison, settings)
        if not comparison.interrupted:
            draw_run(
                Pictured.from_comparison(comparison),
                folder,
                lambda done, total: report("figures", done, total),
            )
            additions.write(
                folder, comparison, settings, lambda done, total: report("convergence", done, total)
            )
    return comparison


def _print_comparison(comparison: Comparison, folder: Path) -> None:
    console = _wide_console()
    console.print(comparison_table(comparison.evaluations))
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


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of a run folder again."""
    folder = Path(options.run)
    with _bars() as report:
        paths = draw_run(
            Pictured.from_folder(folder), folder, lambda done, total: report("figures", done, total)
        )
    Console().print(f"{len(paths)} figures in {folder}", highlight=False)
    return 0


def _compare_segments(datasets: list[Dataset], folder: Path, settings: Settings) -> int:
    open_run_folder(folder)
    with _bars() as report:
        results = run_segments(
            datasets, folder, settings, lambda *_: None, lambda done, total: report("segments", done, total)
        )
    write_segments(folder, results, settings)
    console = _wide_console()
    console.print(segment_table(results, settings))
    for name, (first, second, good, total) in segment_medians(results, settings).items():
        console.print(
            f"{name}: median J1/J3 {first:.4f}, J2/J3 {second:.4f} of {good} segments that are ok, of {total}",
            highlight=False,
        )
    if len(results) < len(datasets):
        raise InputError(
            f"interrupted after {len(results)} of {len(datasets)} segments; run the command again to go on from there"
        )
    console.print(
        f"run folder: {folder}   (look at {folder / f'throws-{settings.estimators[0]}.png'})", soft_wrap=True
    )
    return 0


def _settings(options: argparse.Namespace) -> Settings:
    settings = read_settings(Path(options.config)) if options.config else Settings()
    if options.estimators is not None:
        names = tuple(name.strip() for name in options.estimators.split(",") if name.strip())
        settings = replace(settings, estimators=names)
    elif options.dataset is not None and not options.config:
        settings = replace(settings, estimators=RECORDING_ESTIMATORS)
    if options.drag:
        settings = replace(settings, process=replace(settings.process, drag=True))
    return settings


def _dataset(options: argparse.Namespace) -> Dataset:
    if options.dataset is None:
        if options.segment is not None:
            raise InputError(f"--segment {options.segment} needs a recording; give its folder as DATASET")
        if options.seed < 0:
            raise InputError(f"--seed {options.seed} is negative; give a whole number of at least 0")
        return simulate(Scenario(seed=options.seed))
    segment = None
    if options.segment is not None:
        if not re.fullmatch(r"[0-9]{1,9}", options.segment):
            raise InputError(f"--segment {options.segment} is no segment; give a number or 'all'")
        segment = int(options.segment)
    return read_dataset(options.dataset, segment)


def _wide_console() -> Console:
    """A terminal at its own width; a file or a pipe at one that the tables fit into."""
    console = Console()
    return console if console.is_terminal else Console(width=WIDTH_OF_FILES)


@contextmanager
def _bars() -> Iterator[Report]:
    """Progress bars that appear as work begins, one per name; on standard error, silent where that is no terminal."""
    columns = (TextColumn("{task.description:>12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        tasks = {}

        def report(name: str, done: int, total: int) -> None:
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=total)
            progress.update(tasks[name], completed=done, total=total)

        yield report
