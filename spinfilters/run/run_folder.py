"""The run folder: what others read (trajectories, maps, summary.json) and what the figures are drawn from."""

import os
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimated_motion import (
    read_map_ply,
    write_frame_tum,
    write_map_ply,
    write_trajectory_csv,
    write_trajectory_tum,
)
from spinfilters.evaluation.estimator_evaluation import evaluate
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.filters.history import EstimateHistory
from spinfilters.inference.setup import Setup, knows_frames
from spinfilters.io.camera import RIG_FILES
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import dataset_files, write_dataset
from spinfilters.io.input_file import path_text, read_toml, value_text
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.output_files import make_folder, write_json, write_toml
from spinfilters.io.sensor_tables import write_tum
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import Verdict
from spinfilters.plots.figures import FigureData, picture_files
from spinfilters.run.array_files import read_history, write_history
from spinfilters.run.checkpoints import remove_checkpoints
from spinfilters.run.conditions import told_sentences
from spinfilters.run.estimation import Comparison
from spinfilters.run.provenance import provenance
from spinfilters.run.readers import read_dataset
from spinfilters.run.run_lock import LOCK_FILE
from spinfilters.run.run_summary import SUMMARY_FILE, not_whole, read_summary, summary
from spinfilters.settings.run_settings import Settings, estimator_names

CONFIG_FILE, DATASET_FOLDER, TRUTH_FILE = "config.toml", "dataset", "truth.tum"
HISTORY_FILE, MAP_FILE, FRAME_FILE = "history.npz", "map.ply", "trajectory_g.tum"
REPORT_FILE = "report.html"
PREDICTION_PICTURE, CONVERGENCE_PICTURE = "prediction.png", "convergence.png"
PREDICTION_ERRORS_PICTURE = "prediction-errors.png"
EXPLANATIONS_FILE = "explanations.json"
REFERENCE_FILE, REFERENCE_ARRAYS = "reference.json", "reference.npz"
RACE_FILE, RACE_TABLE, RACE_ARRAYS, RACE_PICTURE = "race.json", "race.csv", "race.npz", "race.png"
PREDICTION_FILE, PREDICTION_ERRORS_TABLE = "prediction.json", "prediction_errors.csv"
PREDICTION_TABLE, PREDICTION_ARRAYS, CONVERGENCE_ARRAYS, REFERENCE_TABLE = (
    *("prediction.csv", "prediction.npz"),
    *("convergence.npz", "reference.csv"),
)
"""Files that a run has where they were asked for (`spinfilters.run.optional_outputs`); all but pictures by estimator."""
SURFACE_PICTURES = {
    name: f"convergence-{name.replace('_', '-')}.png"
    for name in ("position", "attitude", "velocity", "body_rate")
}
SETTLING_ANIMATIONS = {"velocity": "convergence-velocity.gif", "body_rate": "convergence-body-rate.gif"}
CONSTANTS_PICTURE, COSTS_PICTURE = "convergence-constants.png", "convergence-costs.png"
"""Pictures of how each quantity converges, with the arrays."""
ESTIMATOR_FILES = (
    *("trajectory.csv", "trajectory.tum", FRAME_FILE, MAP_FILE, HISTORY_FILE),
    *(PREDICTION_TABLE, PREDICTION_ARRAYS, CONVERGENCE_ARRAYS, REFERENCE_TABLE, PREDICTION_ERRORS_TABLE),
    *(*SURFACE_PICTURES.values(), *SETTLING_ANIMATIONS.values(), CONSTANTS_PICTURE, COSTS_PICTURE),
)
"""Everything that a run writes into the folder of an estimator, besides its checkpoint."""
RECONSTRUCTION_FOLDER, MODEL_FILE = "reconstruction", "model.ply"
RECONSTRUCTION_FILE, ANIMATION_FILE = "reconstruction.json", "reprojection.gif"
"""Dense model of `spinfilters.run.reconstruction`."""
ALIGNMENT_FILE, ALIGNMENT_PICTURE = "alignment.json", "alignment.png"
"""The model on a known shape, of `spinfilters.run.aligned_shape`."""
SEGMENTS_FOLDER = "segments"
_UNFINISHED = re.compile(r"\.[0-9a-f]{16}\.part")
"""Names of what was being written when a run was killed (`spinfilters.io.output_files`)."""

DECISIVE = ("kind", "log", "truth", "rig", "known_map", "inspector")
"""Parts of a data set that decide the numbers of a run, with noise and calibration among its options."""


def reference_pictures(estimator: str) -> tuple[str, str]:
    """Pictures of an estimator against a reference: values, and differences."""
    return f"reference-{estimator}.png", f"reference-differences-{estimator}.png"


def refuse_foreign_run(folder: Path) -> None:
    """Refuse a folder that holds something else than a run, or leads out of itself.

    Raises
    ------
    InputError
        It holds foreign files, or a link in the place of a folder that a run writes into.
    """
    if folder.is_dir() and any(each.name != LOCK_FILE for each in folder.iterdir()) and not _is_run(folder):
        raise InputError(
            f"{path_text(folder)}: is not empty and not a run folder; choose another folder with -o"
        )
    cameras = [f"{DATASET_FOLDER}/{file.parent}" for file in RIG_FILES]
    segments = folder / SEGMENTS_FOLDER
    inner = [
        folder / name
        for name in (*estimator_names(), DATASET_FOLDER, *cameras, SEGMENTS_FOLDER, RECONSTRUCTION_FOLDER)
    ]
    for path in (*inner, *(segments.iterdir() if segments.is_dir() else ())):
        if path.is_symlink():
            raise InputError(
                f"{path_text(path)}: is a symbolic link, and a run writes into its own folder only; remove the link or choose "
                "another "
                "folder with -o"
            )


def write_configuration(folder: Path, settings: Settings) -> None:
    """Write config.toml, which marks the folder as a run's.

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
    """Mark a folder without a run as that of one, before anything is kept in it."""
    if not _is_run(folder):
        write_configuration(folder, settings)


def write_run(folder: Path, comparison: Comparison, settings: Settings) -> dict[str, Any]:
    """Write everything but the figures; summary.json comes last.

    Checkpoints stay until then, and beyond where Ctrl-C cut the run short.

    Parameters
    ----------
    folder : Path
        Of the run; made where it does not exist.
    comparison : Comparison
        What the estimators left behind.
    settings : Settings
        They become config.toml.

    Returns
    -------
    dict
        Content of summary.json, before its numbers are rounded to text.

    Raises
    ------
    InputError
        The folder holds something else than a run, or the data set that the run is made from.
    """
    refuse_foreign_run(folder)
    make_folder(folder)
    source = comparison.setup.dataset.path
    refuse_source_within(folder, source)
    write_configuration(folder, settings)
    _clear(folder, source)
    with ThreadPoolExecutor(1) as pool:  # while a file reaches the disk, others are made
        estimates = pool.submit(_write_estimates, folder, comparison)
        _write_measurements(folder, comparison.setup)
        document = summary(comparison)
        estimates.result()
    write_json(folder / SUMMARY_FILE, document)
    if not comparison.interrupted:
        remove_checkpoints(folder)
    return document


def _write_estimates(folder: Path, comparison: Comparison) -> None:
    """Write the folders of the estimators, one after the other: a long recording has no room for two."""
    for evaluation in comparison.evaluations:
        part = folder / evaluation.name
        make_folder(part)
        write_trajectory_csv(part / "trajectory.csv", evaluation.trajectory)
        write_trajectory_tum(part / "trajectory.tum", evaluation.trajectory)
        if evaluation.history.layout.translates:
            write_frame_tum(part / FRAME_FILE, evaluation.history)
        write_history(part / HISTORY_FILE, evaluation.history)
        if evaluation.name in comparison.maps:
            write_map_ply(part / MAP_FILE, comparison.maps[evaluation.name])


def read_histories(folder: Path, names: Sequence[str]) -> list[EstimateHistory]:
    """Histories of estimators in a run folder.

    Raises
    ------
    InputError
        As `spinfilters.run.array_files.read_history`, or a history of another estimator than its folder's.
    """
    paths = [folder / name / HISTORY_FILE for name in names]
    histories = [read_history(path) for path in paths]
    for path, name, history in zip(paths, names, histories, strict=True):
        if history.name != name:
            raise InputError(
                f"{path_text(path)}: is of {value_text(history.name)}, not of {name}; make the run again"
            )
    return histories


class LastBelief(NamedTuple):
    """Run and estimator, where its belief is from in words, that belief after the last epoch, and its noise by option."""

    run: Path
    estimator: str
    source: str
    belief: Gaussian
    noise: dict[str, float]


def last_belief(folder: Path) -> LastBelief:
    """Belief after the last epoch of a run's first estimator, or of the estimator whose folder it is, with its noise.

    Raises
    ------
    InputError
        No run, or a damaged one.
    """
    run, name = folder.resolve(), ""
    if (run / HISTORY_FILE).exists():
        run, name = run.parent, run.name
    document = read_summary(run)
    try:
        name = name or str(next(iter(document["estimators"])))
        told = document["estimators"][name]["noise"]
        noise = {key: float(each["value"]) for key, each in told.items() if each["value"] is not None}
    except (KeyError, StopIteration, TypeError, ValueError) as error:
        raise not_whole(run, error) from None
    (history,) = read_histories(run, [name])
    belief = history.belief(len(history.time) - 1)
    source = f"the last state of {name} in {run.name}, at t = {float(history.time[-1]):.3f} s of its clock"
    return LastBelief(run, name, source, belief, noise)


def figure_data_of(comparison: Comparison) -> FigureData:
    """Data of the figures of a run that has just ended."""
    points = comparison.maps.get(comparison.evaluations[0].name)
    return FigureData(
        comparison.setup.dataset, comparison.evaluations, points, comparison.conditions.sentences
    )


def read_figure_data(folder: Path) -> FigureData:
    """Data of the figures of a run folder.

    Raises
    ------
    InputError
        A folder that is no run, or a damaged one.
    """
    document = read_summary(folder)
    try:
        names = [str(name) for name in document["estimators"]]
        _ = names[0]
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise not_whole(folder, error) from None
    dataset = read_dataset(folder / DATASET_FOLDER)
    alignment = Alignment.NONE if knows_frames(dataset) else Alignment.FIRST_FRAME
    evaluations = [evaluate(each, dataset.truth, alignment) for each in read_histories(folder, names)]
    map_path = folder / names[0] / MAP_FILE
    points = read_map_ply(map_path) if map_path.exists() else None
    return FigureData(dataset, evaluations, points, told_sentences(document))


def finished_run(folder: Path, dataset: Dataset, settings: Settings) -> dict[str, Any] | None:
    """Summary of a complete run of the same data set, settings and versions, or None."""
    try:
        if not _is_configured(folder, configuration(settings)):
            return None
        earlier, document = read_dataset(folder / DATASET_FOLDER), read_summary(folder)
        same = _equal(_decisive(earlier), _decisive(dataset))
        return document if same and _is_whole(document, settings) else None
    except InputError:
        return None


def _decisive(dataset: Dataset) -> tuple[Any, ...]:
    options = dataset.options
    told = options.noise, dict(options.calibration), options.covariance_inflation
    return (*(getattr(dataset, part) for part in DECISIVE), told)


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
    """Whether every estimator did all epochs or failed."""
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
    """Remove an earlier run's files except checkpoints and the data set in use."""
    pictures = [*picture_files(estimator_names()), PREDICTION_PICTURE, CONVERGENCE_PICTURE]
    pictures += [PREDICTION_ERRORS_PICTURE, RACE_PICTURE]
    pictures += [picture for name in estimator_names() for picture in reference_pictures(name)]
    documents = (SUMMARY_FILE, REPORT_FILE, EXPLANATIONS_FILE, REFERENCE_FILE, PREDICTION_FILE)
    documents += (REFERENCE_ARRAYS, RACE_FILE, RACE_TABLE, RACE_ARRAYS)
    for name in (*documents, TRUTH_FILE, *pictures):
        (folder / name).unlink(missing_ok=True)
    if not _is_own_dataset(folder, source):
        _remove(folder / DATASET_FOLDER, dataset_files())
    files = (MODEL_FILE, RECONSTRUCTION_FILE, ANIMATION_FILE, ALIGNMENT_FILE, ALIGNMENT_PICTURE)
    _remove(folder / RECONSTRUCTION_FOLDER, files)
    for name in estimator_names():
        _remove(folder / name, ESTIMATOR_FILES)


def _remove(place: Path, names: Sequence[str]) -> None:
    """Remove these and unfinished files, then empty folders."""
    for path in (*(place / name for name in names), *place.glob("**/.*.part")):
        if path.name in map(os.path.basename, names) or _UNFINISHED.fullmatch(path.name):
            with suppress(FileNotFoundError, NotADirectoryError):
                path.unlink()
    for each in (*(place / Path(name).parent for name in names), place):
        with suppress(OSError):  # absent, or files of others are in it
            each.rmdir()


def refuse_source_within(folder: Path, source: Path | None) -> None:
    """Refuse a run from a file that it would replace."""
    if source is None or _is_own_dataset(folder, source):
        return
    inner = [(folder / name).resolve() for name in (DATASET_FOLDER, *estimator_names())]
    if any(source.resolve().is_relative_to(place) for place in inner):
        raise InputError(
            f"{path_text(source)}: is inside {path_text(folder)}, whose files the run replaces; choose another folder with -o"
        )


def _is_own_dataset(folder: Path, source: Path | None) -> bool:
    """Whether a run is made from the data set that lies in its own folder."""
    return source is not None and source.resolve() == (folder / DATASET_FOLDER).resolve()


def _write_measurements(folder: Path, setup: Setup) -> None:
    """Write the data set, and the truth as TUM where frames agree.

    The truth is written where it shares the frames of the estimates.
    """
    dataset = setup.dataset
    if not _is_own_dataset(folder, dataset.path):
        write_dataset(dataset, folder / DATASET_FOLDER)
    if setup.known_frames and dataset.truth is not None:
        poses = np.hstack([dataset.truth.center_of_mass, dataset.truth.q_ig])
        write_tum(folder / TRUTH_FILE, MeasurementStream("pose", dataset.truth.time, poses))
