"""The run folder: what others read (trajectories, maps, summary.json) and what the figures are drawn from."""

import shutil
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.trajectory import write_map_ply, write_trajectory_csv, write_trajectory_tum
from spinfilters.logs.atomic_write import make_folder, write_json, write_toml
from spinfilters.logs.dataset import Dataset, read_dataset
from spinfilters.logs.dataset_options import NOISE_KEYS
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.logs.input_file import named, shown
from spinfilters.logs.measurement_log import MeasurementStream
from spinfilters.logs.pose_files import write_tum
from spinfilters.logs.settings_files import read_toml
from spinfilters.state.status import Verdict
from spinfilters.workflow.checkpointing import CHECKPOINT_FILE, remove_checkpoints
from spinfilters.workflow.estimation import Comparison
from spinfilters.workflow.history_file import read_history, write_history
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.provenance import provenance
from spinfilters.workflow.run_summary import SUMMARY_FILE, read_summary, summary
from spinfilters.workflow.settings import ESTIMATORS, Settings

CONFIG_FILE, DATASET_FOLDER, TRUTH_FILE = "config.toml", "dataset", "truth.tum"
HISTORY_FILE = "history.npz"
FIGURES = ("summary", "rates", "inertia", "polhode", "scene", "consistency")
"""Names of the figures of a run, besides errors-<estimator>."""
PREDICTION_PICTURE, CONVERGENCE_PICTURE = "prediction.png", "convergence.png"
"""Files that a run has where they were asked for (`spinfilters.workflow.additions`)."""

DECISIVE = ("kind", "log", "truth", "rig", "known_map")
"""Parts of a data set that decide the numbers of a run, with the noise among its options."""


def picture_files(estimators: Sequence[str]) -> list[str]:
    """Files of the figures that every run of these estimators has."""
    return [f"{name}.png" for name in (*FIGURES, *(f"errors-{each}" for each in estimators))]


def open_run_folder(folder: Path) -> None:
    """Make the folder; refuse one that holds something else than a run.

    Raises
    ------
    InputError: it is a file, holds foreign files, or cannot be written.
    """
    if folder.is_dir() and any(folder.iterdir()) and not _is_run(folder):
        raise InputError(f"{folder}: is not empty and not a run folder; choose another folder with -o")
    make_folder(folder)


def write_configuration(folder: Path, settings: Settings) -> None:
    """config.toml: the settings and what the run was made with. It comes first and marks the folder as a run's.

    Numbers of an earlier run that was made otherwise do not outlive its configuration.
    """
    document = configuration(settings)
    if not _is_configured(folder, document):
        (folder / SUMMARY_FILE).unlink(missing_ok=True)
    write_toml(folder / CONFIG_FILE, document)


def configuration(settings: Settings) -> dict[str, Any]:
    """The content of config.toml."""
    return {**settings.document, "provenance": provenance()}


def mark_run_folder(folder: Path, settings: Settings) -> None:
    """Mark a folder that holds no run yet as that of one, before anything is kept in it."""
    if not _is_run(folder):
        write_configuration(folder, settings)


def write_run(folder: Path, comparison: Comparison, settings: Settings) -> None:
    """Everything but the figures, in place of an earlier run; summary.json comes last, so that a folder with one is whole.

    Checkpoints stay until then, and beyond where Ctrl-C cut the run short.
    """
    open_run_folder(folder)
    write_configuration(folder, settings)
    _clear(folder, comparison.prepared.dataset.path)
    _write_measurements(folder, comparison.prepared)
    for evaluation in comparison.evaluations:
        part = folder / evaluation.name
        make_folder(part)
        write_trajectory_csv(part / "trajectory.csv", evaluation.trajectory)
        write_trajectory_tum(part / "trajectory.tum", evaluation.trajectory)
        write_history(part / HISTORY_FILE, evaluation.history)
        if evaluation.name in comparison.maps:
            write_map_ply(part / "map.ply", comparison.maps[evaluation.name])
    write_json(folder / SUMMARY_FILE, summary(comparison))
    if not comparison.interrupted:
        remove_checkpoints(folder)


def read_histories(folder: Path, names: Sequence[str]) -> list[EstimateHistory]:
    """Histories of estimators in a run folder.

    Raises
    ------
    InputError: as `spinfilters.workflow.history_file.read_history`, or a history of another estimator than its folder's.
    """
    paths = [folder / name / HISTORY_FILE for name in names]
    histories = [read_history(path) for path in paths]
    for path, name, history in zip(paths, names, histories, strict=True):
        if history.name != name:
            raise InputError(f"{named(path)}: is of {shown(history.name)}, not of {name}; make the run again")
    return histories


def finished_run(folder: Path, dataset: Dataset, settings: Settings) -> dict[str, Any] | None:
    """Summary of a whole run that was made of the same data set, settings and versions; None where there is none."""
    try:
        if not _is_configured(folder, configuration(settings)):
            return None
        earlier, document = read_dataset(folder / DATASET_FOLDER), read_summary(folder)
        same = _equal(_decisive(earlier), _decisive(dataset))
        return document if same and _is_whole(document, settings) else None
    except InputError:
        return None


def _decisive(dataset: Dataset) -> tuple[Any, ...]:
    noise = tuple(getattr(dataset.options, key) for key in NOISE_KEYS)
    return (*(getattr(dataset, part) for part in DECISIVE), noise)


def _equal(one: Any, other: Any) -> bool:
    """Dataclasses by their fields, sequences by their members, arrays by their elements."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    if is_dataclass(one) and is_dataclass(other):
        names = [each.name for each in fields(one)]
        return type(one) is type(other) and all(_equal(getattr(one, n), getattr(other, n)) for n in names)
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_equal, one, other))
    return one == other


def _is_whole(document: dict[str, Any], settings: Settings) -> bool:
    """Whether every estimator did all frames or failed."""
    try:
        total, made = document["dataset"]["frames"], [document["estimators"][n] for n in settings.estimators]
        return all(each["frames"] == total or each["status"] == str(Verdict.FAILED) for each in made)
    except (KeyError, TypeError):
        return False


def _is_configured(folder: Path, document: dict[str, Any]) -> bool:
    """Whether what lies in a folder was made with the settings and versions of a `configuration`."""
    try:
        return read_toml(folder / CONFIG_FILE) == document
    except InputError:
        return False


def _is_run(folder: Path) -> bool:
    try:
        return "provenance" in read_toml(folder / CONFIG_FILE)
    except InputError:
        return False


def _clear(folder: Path, source: Path | None) -> None:
    """Remove an earlier run, but not its data set when that is what the new run was made from, and no checkpoint."""
    pictures = (*picture_files(ESTIMATORS), PREDICTION_PICTURE, CONVERGENCE_PICTURE)
    for name in (SUMMARY_FILE, TRUTH_FILE, *pictures):
        (folder / name).unlink(missing_ok=True)
    for place in (folder / name for name in (DATASET_FOLDER, *ESTIMATORS)):
        in_use = source is not None and source.resolve().is_relative_to(place.resolve())
        if place.is_dir() and not place.is_symlink() and not in_use:
            _empty(place)


def _empty(place: Path) -> None:
    """Remove what a folder holds but a checkpoint, and the folder where nothing is left."""
    for path in place.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != CHECKPOINT_FILE:
            path.unlink()
    if not any(place.iterdir()):
        place.rmdir()


def _write_measurements(folder: Path, prepared: Prepared) -> None:
    """The data set; and, where truth and estimates share their frames, the truth in the TUM format."""
    dataset = prepared.dataset
    write_dataset(dataset, folder / DATASET_FOLDER)
    if prepared.known_frames and dataset.truth is not None:
        poses = np.hstack([dataset.truth.center_of_mass, dataset.truth.q_ig])
        write_tum(folder / TRUTH_FILE, MeasurementStream("pose", dataset.truth.time, poses))
