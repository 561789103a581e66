"""The comparison of estimators on one recording."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spinfilters.api.argument_ranges import SECONDS_AHEAD
from spinfilters.api.blas_threads import on_one_blas_thread
from spinfilters.api.recordings import load
from spinfilters.api.results import Run
from spinfilters.data.argument_checks import (
    A_RECORDING,
    ESTIMATORS,
    called,
    checked_arguments,
    names,
    number,
    one_of,
    optional,
    path,
    truth,
)
from spinfilters.data.dataset import Dataset
from spinfilters.data.input_file import path_text
from spinfilters.errors import InputError
from spinfilters.pipeline.comparison_run import RunOutput, compare_dataset, compare_into, silent
from spinfilters.pipeline.estimation import Comparison, Progress
from spinfilters.runs.run_folder import CONFIG_FILE, SEGMENTS_FOLDER
from spinfilters.runs.run_summary import SUMMARY_FILE, read_summary
from spinfilters.settings.estimator_names import names_in
from spinfilters.settings.run_settings import Settings, read_settings, settings_from

if TYPE_CHECKING:
    from spinfilters.pipeline.optional_outputs import OptionalOutputs

AnySettings = Settings | Mapping[str, Any] | str | os.PathLike[str]
"""Settings, the tables of a settings file, or the path of one."""


@checked_arguments(
    data=one_of(Dataset, path_of=A_RECORDING, cure="a path or a data set of spinfilters.load or .simulate"),
    segment=optional(one_of(int, str, cure='a number, times such as "6.55:7.4", or "auto"')),
    settings=optional(
        one_of(Settings, Mapping, path_of="a settings file", cure="Settings, a mapping of tables, or a path")
    ),
    output=optional(path("a folder")),
    resume=truth,
    predict=optional(number(SECONDS_AHEAD)),
    convergence=truth,
    explain=truth,
    progress=called,
)
@on_one_blas_thread
def compare(
    data: Dataset | str | os.PathLike[str],
    estimators: Sequence[str] | str | None = None,
    settings: AnySettings | None = None,
    segment: int | str | None = None,
    output: str | os.PathLike[str] | None = None,
    *,
    resume: bool = False,
    predict: float | None = None,
    convergence: bool = False,
    explain: bool = False,
    progress: Progress = silent,
) -> Run:
    """Estimators side by side on one recording, as ``spinfilters compare`` runs them.

    Parameters
    ----------
    data: a data set, or the path of one (see `load`).   segment: of a recording, see `load`.
    estimators: names among "mekf", "ukf", "smoother", "filterpy-ekf", "filterpy-ukf", "embedded", "embedded-double"; one text
        may list several, with commas. None takes those of the settings, by default the first three.
    settings: `Settings`, a mapping such as ``{"sensors": {"pixel_std": 0.5}}``, or the path of a settings file.
    output: folder to write the run into, with checkpoints and pictures; None writes nothing, and `Run.save` can later.
    resume: go on from what an interrupted run has left in ``output``; a finished run is read from there.
    predict: s to go on after the last epoch.   convergence: whether to show how the smoother settles.
    explain: whether to run again with the errors of the models that are found. All three are files of ``output``.
    progress: called with what is being done, steps done and steps in all.

    Raises
    ------
    InputError: what the command refuses with exit code 2; the text is one line that names the value and the cure.
    KeyboardInterrupt: Ctrl-C; what was estimated is in ``output``, if given, for ``resume`` to go on from.
    """
    chosen = _settings(settings, estimators)
    dataset = _dataset(data, segment)
    optional_outputs = _additions(predict, convergence, explain)
    if output is None:
        if resume or optional_outputs is not None:
            raise InputError("resume, predict, convergence and explain work in a run folder; give output")
        return Run.from_comparison(_whole(compare_dataset(dataset, chosen, progress), None), chosen)
    folder = Path(output)
    written = compare_into(dataset, chosen, RunOutput(folder, resume, optional_outputs), progress)
    if written.comparison is None:
        return Run.from_folder(folder, chosen)
    return Run.from_comparison(_whole(written.comparison, folder), chosen, folder)


@checked_arguments(folder=path("a run's folder"))
def load_run(folder: str | os.PathLike[str]) -> Run:
    """Run of a folder that a comparison has written, read without running anything.

    Parameters
    ----------
    folder: of ``spinfilters compare -o``, of `compare` with ``output``, or of `Run.save`; of several segments that of one, such as
        ``runs/mine/segments/001``.

    Raises
    ------
    InputError: no folder of a run, an unfinished or a damaged one; the text is one line that names the file and the cure.
    """
    place = Path(folder)
    if not (place / SUMMARY_FILE).exists() and (place / SEGMENTS_FOLDER).is_dir():
        raise InputError(
            f"{path_text(place)}: holds runs of several segments; give one of them ({SEGMENTS_FOLDER}/...)"
        )
    read_summary(place)  # tells first that a folder holds no finished run
    return Run.from_folder(place, read_settings(place / CONFIG_FILE))


def _whole(comparison: Comparison, folder: Path | None) -> Comparison:
    """A comparison that Ctrl-C has not cut short."""
    if comparison.interrupted:
        raise KeyboardInterrupt(
            "nothing was written; give output to go on from there next time"
            if folder is None
            else f"what was estimated is in {folder}; resume=True goes on from there"
        )
    return comparison


def _settings(settings: AnySettings | None, estimators: Sequence[str] | str | None) -> Settings:
    if settings is None:
        chosen = Settings()
    elif isinstance(settings, Settings):
        chosen = settings
    elif isinstance(settings, Mapping):
        chosen = settings_from(settings, "settings")
    else:
        chosen = read_settings(Path(settings))
    if estimators is None:
        return chosen
    return replace(chosen, estimators=_names(estimators))


def _names(estimators: Sequence[str] | str) -> tuple[str, ...]:
    """Names from a list, or from one text with commas. InputError: no names."""
    if isinstance(estimators, Settings | Mapping):
        raise InputError("estimators are settings; give them by name: compare(data, settings=...)")
    names(ESTIMATORS)("estimators", estimators)
    return names_in(estimators) if isinstance(estimators, str) else tuple(estimators)


def _dataset(data: Dataset | str | os.PathLike[str], segment: int | str | None) -> Dataset:
    if isinstance(data, Dataset):
        if segment is not None:
            raise InputError(f"segment {segment} is of a recording's folder; give its path, not a data set")
        return data
    return load(data, segment)


def _additions(predict: float | None, convergence: bool, explain: bool) -> "OptionalOutputs | None":
    """Optional outputs that were asked for, or None."""
    if predict is None and not convergence and not explain:
        return None
    from spinfilters.pipeline.optional_outputs import OptionalOutputs

    return OptionalOutputs(predict, convergence, explain)
