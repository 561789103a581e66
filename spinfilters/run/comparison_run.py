"""A comparison from a data set to its run folder: initialise, estimate, evaluate, write, draw.

What draws is imported where it draws: matplotlib would be a third of the time before the first epoch.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spinfilters.core.errors import InputError
from spinfilters.evaluation.trajectory_errors import common_stamps
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.output_files import made_folder
from spinfilters.plots.figures import FigureData, draw_run, picture_files
from spinfilters.run.checkpoints import StoreOf, checkpoint_stores, no_checkpoints, remove_checkpoints
from spinfilters.run.estimation import Comparison, ComparisonExtent, Progress, compare_estimators
from spinfilters.run.picture_process import EarlyPictures, draw_together, picture_processes
from spinfilters.run.preparation import prepare
from spinfilters.run.run_folder import (
    REPORT_FILE,
    figure_data_of,
    finished_run,
    mark_run_folder,
    read_figure_data,
    refuse_foreign_run,
    refuse_source_within,
    write_run,
)
from spinfilters.run.run_lock import locked_run
from spinfilters.settings.run_settings import Settings

if TYPE_CHECKING:
    from spinfilters.io.reference_motion import ReferenceMotion
    from spinfilters.run.optional_outputs import OptionalOutputs


@dataclass(frozen=True)
class RunOutput:
    """Run folder and what is written there.

    Attributes
    ----------
    folder : Path
        Of the run.
    resume : bool
        Go on from its checkpoints, or complete it where it is finished.
    optional_outputs : OptionalOutputs or None
        What is written only when asked for, None for nothing.
    with_figures : bool
        Whether pictures and a page are made.
    """

    folder: Path
    resume: bool = False
    optional_outputs: "OptionalOutputs | None" = None
    with_figures: bool = True


@dataclass(frozen=True)
class WrittenRun:
    """A run folder.

    Attributes
    ----------
    comparison : Comparison or None
        None where a finished run was there already, whose estimators were not run again.
    summary : mapping or None
        Content of summary.json, where it was written now.
    completed : tuple of str
        Names of what that finished run lacked and was made now.
    optional_outputs : OptionalOutputs or None
        What was written besides, which holds a reference where the data set's truth served as one.
    """

    comparison: Comparison | None
    summary: Mapping[str, Any] | None = None
    completed: tuple[str, ...] = ()
    optional_outputs: "OptionalOutputs | None" = None


def without_unmatched_truth(dataset: Dataset) -> "tuple[Dataset, ReferenceMotion | None]":
    """The data set, and its truth as a reference where none of its stamps is that of a measurement.

    Errors need equal stamps; a truth of another rate or clock has none, and then says as much as any other reference.
    """
    truth = dataset.truth
    if truth is None:
        return dataset, None
    try:
        common_stamps(truth.time, dataset.log.times)
    except InputError:  # none in common
        pass
    else:
        return dataset, None
    from spinfilters.io.reference_motion import reference_of_truth

    try:
        reference = reference_of_truth(truth, "truth.csv")
    except InputError:  # too few rows for anything
        reference = None
    return replace(dataset, truth=None), reference


def silent(_name: str, _done: int, _total: int) -> None:
    """Progress callback that does nothing."""


def compare_dataset(dataset: Dataset, settings: Settings, report: Progress = silent) -> Comparison:
    """Every estimator on a data set, in memory. Errors: `prepare`, `compare_estimators`."""
    dataset, _ = without_unmatched_truth(dataset)
    return compare_estimators(_initialised(dataset, settings, report), settings, report, no_checkpoints)


def compare_into(
    dataset: Dataset, settings: Settings, output: RunOutput, report: Progress = silent
) -> WrittenRun:
    """Every estimator on a data set, with checkpoints, results and figures in a run folder.

    Raises
    ------
    InputError
        As `compare_dataset`; the folder holds something else, belongs to another running process or cannot be written; what is
        asked for in addition cannot be made.
    """
    folder = output.folder
    dataset, late = without_unmatched_truth(dataset)
    if late is not None:
        output = replace(output, optional_outputs=with_reference(output.optional_outputs, late))
    refuse_source_within(folder, dataset.path)
    refuse_foreign_run(folder)
    with made_folder(folder), locked_run(folder):
        if output.resume and finished_run(folder, dataset, settings) is not None:
            completed = tuple(_complete(dataset, settings, output, report))
            return WrittenRun(None, completed=completed, optional_outputs=output.optional_outputs)
        written = _compare_and_write(dataset, settings, output, report)
        return replace(written, optional_outputs=output.optional_outputs)


def write_comparison(
    folder: Path, comparison: Comparison, settings: Settings, report: Progress = silent
) -> None:
    """Write results and figures of a comparison made in memory, the files of `compare_into`. Errors: `write_run`."""
    refuse_source_within(folder, comparison.setup.dataset.path)
    refuse_foreign_run(folder)
    with made_folder(folder), locked_run(folder):
        write_run(folder, comparison, settings)
        if not comparison.interrupted:
            figure_data = figure_data_of(comparison)
            _draw(folder, figure_data, report)
            _write_report(folder, figure_data)


def with_reference(
    optional_outputs: "OptionalOutputs | None", reference: "ReferenceMotion"
) -> "OptionalOutputs":
    """What is written, and a comparison with a reference unless another one was asked for."""
    from spinfilters.run.optional_outputs import OptionalOutputs

    chosen = optional_outputs or OptionalOutputs()
    return chosen if chosen.reference is not None else replace(chosen, reference=reference)


def _compare_and_write(
    dataset: Dataset, settings: Settings, output: RunOutput, report: Progress
) -> WrittenRun:
    """Run, write and draw in a locked folder, from its checkpoints when resuming."""
    with (
        picture_processes(output.with_figures) as processes,  # they load what draws meanwhile
        EarlyPictures(processes, settings.estimators) as early,
    ):
        return _estimate_and_write(dataset, settings, output, report, early)


def _estimate_and_write(
    dataset: Dataset,
    settings: Settings,
    output: RunOutput,
    report: Progress,
    early: EarlyPictures,
) -> WrittenRun:
    folder, optional_outputs = output.folder, output.optional_outputs
    setup = _initialised(dataset, settings, report)
    if optional_outputs is not None:
        optional_outputs.check(setup, settings)
    extent = ComparisonExtent(on_estimate=early.take)
    comparison = compare_estimators(setup, settings, report, _checkpoints(output, setup, settings), extent)
    has_figures = output.with_figures and not comparison.interrupted  # by Ctrl-C: no figures of a part
    figure_data = figure_data_of(comparison) if has_figures else None
    if figure_data is not None and early.processes:
        early.take_all(figure_data)
    written = WrittenRun(comparison, write_run(folder, comparison, settings))
    if comparison.interrupted:
        return written
    if figure_data is not None and early.processes:
        draw_together(figure_data, folder, _figure_progress(report), early)
    elif figure_data is not None:
        _draw(folder, figure_data, report)
    try:
        if optional_outputs is not None:
            optional_outputs.write(
                folder,
                comparison,
                settings,
                lambda done, total: report("convergence", done, total),
                output.with_figures,
            )
    finally:  # the page stands, whatever came of these
        if figure_data is not None:
            _write_report(folder, figure_data)
    return written


def _initialised(dataset: Dataset, settings: Settings, report: Progress) -> Setup:
    report("start", 0, 1)
    setup = prepare(dataset, settings)
    report("start", 1, 1)
    return setup


def _checkpoints(output: RunOutput, setup: Setup, settings: Settings) -> StoreOf:
    """Checkpoints of this run; those of an earlier one are removed unless it is resumed."""
    if not output.resume:
        remove_checkpoints(output.folder)
    mark_run_folder(output.folder, settings)
    return checkpoint_stores(output.folder, setup, settings)


def _draw(
    folder: Path, figure_data: FigureData, report: Progress, names: Sequence[str] | None = None
) -> list[str]:
    """Draw these figures, or all; their names."""
    return draw_run(figure_data, folder, _figure_progress(report), names)


def _figure_progress(report: Progress) -> Callable[[int, int], None]:
    return lambda done, total: report("figures", done, total)


def _write_report(folder: Path, figure_data: FigureData) -> None:
    from spinfilters.run.run_report import write_run_report

    write_run_report(figure_data, folder)


def _complete(dataset: Dataset, settings: Settings, output: RunOutput, report: Progress) -> list[str]:
    """Complete a finished run's figures and extras; their names."""
    made = _draw_missing(output.folder, settings, report) if output.with_figures else []
    if output.optional_outputs is not None:
        made += output.optional_outputs.complete(
            output.folder,
            dataset,
            settings,
            lambda done, total: report("convergence", done, total),
            output.with_figures,
        )
    if output.with_figures and (made or not (output.folder / REPORT_FILE).exists()):
        _write_report(output.folder, read_figure_data(output.folder))
        made.append(REPORT_FILE)
    return made


def _draw_missing(folder: Path, settings: Settings, report: Progress) -> list[str]:
    """Draw the figures that a finished run lacks because it was stopped while they were drawn."""
    missing = [name for name in picture_files(settings.estimators) if not (folder / name).exists()]
    return _draw(folder, read_figure_data(folder), report, missing) if missing else []
