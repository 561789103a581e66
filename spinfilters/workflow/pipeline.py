"""A comparison from a data set to its run folder: initialise, estimate, evaluate, write, draw.

What draws is imported where it draws: matplotlib would be a third of the time before the first epoch.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from spinfilters.logs.dataset import Dataset
from spinfilters.workflow.checkpointing import KeeperOf, forget, keep_in, remove_checkpoints
from spinfilters.workflow.estimation import Comparison, Progress, compare_estimators
from spinfilters.workflow.figure_entry import picture_files
from spinfilters.workflow.preparation import Prepared, prepare
from spinfilters.workflow.run_folder import (
    finished_run,
    mark_run_folder,
    open_run_folder,
    refuse_source_within,
    write_run,
)
from spinfilters.workflow.run_lock import locked_run
from spinfilters.workflow.settings import Settings

if TYPE_CHECKING:
    from spinfilters.workflow.additions import Additions


@dataclass(frozen=True)
class RunOutput:
    """Where a run is written.

    Attributes
    ----------
    folder: of the run.   resume: go on from its checkpoints, or complete it where it is finished.
    additions: what is written only when asked for, None for nothing.
    """

    folder: Path
    resume: bool = False
    additions: "Additions | None" = None


@dataclass(frozen=True)
class WrittenRun:
    """A run folder.

    Attributes
    ----------
    comparison: None where a finished run was there already, whose estimators were not run again.
    completed: names of what that finished run lacked and was made now.
    """

    comparison: Comparison | None
    completed: tuple[str, ...] = ()


def silent(_name: str, _done: int, _total: int) -> None:
    """Progress that nobody is told of."""


def compare_dataset(dataset: Dataset, settings: Settings, report: Progress = silent) -> Comparison:
    """Every estimator on a data set, in memory. Errors: `prepare`, `compare_estimators`."""
    return compare_estimators(_initialised(dataset, settings, report), settings, report, forget)


def compare_into(
    dataset: Dataset, settings: Settings, output: RunOutput, report: Progress = silent
) -> WrittenRun:
    """Every estimator on a data set, with checkpoints, results and figures in a run folder.

    Raises
    ------
    InputError: as `compare_dataset`; the folder holds something else, belongs to another running process or cannot be written; what
        is asked for in addition cannot be made.
    """
    folder = output.folder
    refuse_source_within(folder, dataset.path)
    open_run_folder(folder)
    with locked_run(folder):
        if output.resume and finished_run(folder, dataset, settings) is not None:
            return WrittenRun(None, tuple(_complete(dataset, settings, output, report)))
        return WrittenRun(_compare_and_write(dataset, settings, output, report))


def write_comparison(
    folder: Path, comparison: Comparison, settings: Settings, report: Progress = silent
) -> None:
    """Results and figures of a comparison that was made in memory, as `compare_into` writes them. Errors: `write_run`."""
    refuse_source_within(folder, comparison.prepared.dataset.path)
    open_run_folder(folder)
    with locked_run(folder):
        _write_and_draw(folder, comparison, settings, report)


def _compare_and_write(
    dataset: Dataset, settings: Settings, output: RunOutput, report: Progress
) -> Comparison:
    """Run, write and draw in a folder that is locked, going on from its checkpoints when resuming."""
    folder, additions = output.folder, output.additions
    prepared = _initialised(dataset, settings, report)
    if additions is not None:
        additions.check(prepared, settings)
    comparison = compare_estimators(prepared, settings, report, _checkpoints(output, prepared, settings))
    _write_and_draw(folder, comparison, settings, report)
    if additions is not None and not comparison.interrupted:
        additions.write(folder, comparison, settings, lambda done, total: report("convergence", done, total))
    return comparison


def _initialised(dataset: Dataset, settings: Settings, report: Progress) -> Prepared:
    report("start", 0, 1)
    prepared = prepare(dataset, settings)
    report("start", 1, 1)
    return prepared


def _checkpoints(output: RunOutput, prepared: Prepared, settings: Settings) -> KeeperOf:
    """Of this run; those of an earlier one are removed unless it is resumed."""
    if not output.resume:
        remove_checkpoints(output.folder)
    mark_run_folder(output.folder, settings)
    return keep_in(output.folder, prepared, settings)


def _write_and_draw(folder: Path, comparison: Comparison, settings: Settings, report: Progress) -> None:
    """The run folder; figures only where Ctrl-C has not cut the run short."""
    write_run(folder, comparison, settings)
    if comparison.interrupted:
        return
    from spinfilters.workflow.figures import Pictured, draw_run

    draw_run(Pictured.from_comparison(comparison), folder, lambda done, total: report("figures", done, total))


def _complete(dataset: Dataset, settings: Settings, output: RunOutput, report: Progress) -> list[str]:
    """Draw the figures that a finished run lacks, and make what else is asked for; their names."""
    made = _draw_missing(output.folder, settings, report)
    if output.additions is not None:
        made += output.additions.complete(
            output.folder, dataset, settings, lambda done, total: report("convergence", done, total)
        )
    return made


def _draw_missing(folder: Path, settings: Settings, report: Progress) -> list[str]:
    """Figures that a finished run does not have, because Ctrl-C or a kill came while they were drawn."""
    missing = [name for name in picture_files(settings.estimators) if not (folder / name).exists()]
    if not missing:
        return []
    from spinfilters.workflow.figures import Pictured, draw_run

    pictured = Pictured.from_folder(folder)
    return draw_run(pictured, folder, lambda done, total: report("figures", done, total), missing)
