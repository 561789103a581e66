"""The run folder: what others read (trajectories, maps, summary.json) and what the figures are drawn from."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from spinfilters.errors import InputError
from spinfilters.evaluation.evaluation import Evaluation, numbers
from spinfilters.evaluation.trajectory import write_map_ply, write_trajectory_csv, write_trajectory_tum
from spinfilters.logs.atomic_write import make_folder, write_json, write_toml
from spinfilters.logs.dataset import Dataset, read_dataset
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.logs.input_file import reason
from spinfilters.logs.measurement_log import MeasurementStream
from spinfilters.logs.pose_files import write_tum
from spinfilters.logs.settings_files import read_toml
from spinfilters.state.status import Verdict
from spinfilters.workflow.checkpointing import CHECKPOINT_FILE, remove_checkpoints
from spinfilters.workflow.estimation import Comparison
from spinfilters.workflow.history_file import write_history
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.provenance import provenance
from spinfilters.workflow.settings import ESTIMATORS, Settings

SUMMARY_FILE, CONFIG_FILE, DATASET_FOLDER, TRUTH_FILE = "summary.json", "config.toml", "dataset", "truth.tum"
FIGURES = ("summary", "rates", "inertia", "polhode", "scene", "consistency")
"""Names of the figures of a run, besides errors-<estimator>."""
ASKED_FOR = ("prediction", "convergence")
"""Names of figures that a run has where they were asked for (`spinfilters.workflow.additions`)."""
SCHEMA = 1
LARGEST_SUMMARY = 1 << 26


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
    """config.toml: the settings and what the run was made with. It comes first and marks the folder as a run's."""
    write_toml(folder / CONFIG_FILE, configuration(settings))


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
        write_history(part / "history.npz", evaluation.history)
        if evaluation.name in comparison.maps:
            write_map_ply(part / "map.ply", comparison.maps[evaluation.name])
    write_json(folder / SUMMARY_FILE, summary(comparison))
    if not comparison.interrupted:
        remove_checkpoints(folder)


def finished_run(folder: Path, dataset: Dataset, settings: Settings) -> dict[str, Any] | None:
    """Summary of a whole run that was made of the same measurements, settings and versions; None where there is none."""
    try:
        if read_toml(folder / CONFIG_FILE) != configuration(settings):
            return None
        earlier = read_dataset(folder / DATASET_FOLDER).log
        same = earlier.sensors == dataset.log.sensors and all(
            map(_equal, earlier.streams, dataset.log.streams)
        )
        document = read_summary(folder)
        return document if same and _is_whole(document, settings) else None
    except InputError:
        return None


def _equal(one: MeasurementStream, other: MeasurementStream) -> bool:
    return np.array_equal(one.time, other.time) and np.array_equal(one.values, other.values)


def _is_whole(document: dict[str, Any], settings: Settings) -> bool:
    """Whether every estimator did all frames or failed."""
    try:
        total, made = document["dataset"]["frames"], [document["estimators"][n] for n in settings.estimators]
        return all(each["frames"] == total or each["status"] == str(Verdict.FAILED) for each in made)
    except (KeyError, TypeError):
        return False


def _is_run(folder: Path) -> bool:
    try:
        return "provenance" in read_toml(folder / CONFIG_FILE)
    except InputError:
        return False


def _clear(folder: Path, source: Path | None) -> None:
    """Remove an earlier run, but not its data set when that is what the new run was made from, and no checkpoint."""
    figures = [f"{name}.png" for name in (*FIGURES, *ASKED_FOR, *(f"errors-{name}" for name in ESTIMATORS))]
    for name in (SUMMARY_FILE, TRUTH_FILE, *figures):
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


def summary(comparison: Comparison) -> dict[str, Any]:
    """The content of summary.json."""
    prepared = comparison.prepared
    return {
        "schema": SCHEMA,
        "dataset": _dataset(prepared),
        "process": {"blocks": list(prepared.process.layout.blocks), **vars(prepared.process.noise)},
        "sensors": vars(prepared.noise),
        "start": _start(prepared),
        "estimators": {evaluation.name: _estimator(evaluation) for evaluation in comparison.evaluations},
    }


def read_summary(folder: Path) -> dict[str, Any]:
    """summary.json of a run folder.

    Raises
    ------
    InputError: missing, too large, not JSON, another schema.
    """
    path = folder / SUMMARY_FILE
    try:
        if path.stat().st_size > LARGEST_SUMMARY:
            raise InputError(
                f"{path}: {path.stat().st_size} bytes is no summary of a run; make the run again"
            )
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); give a folder made by 'spinfilters compare'"
        ) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON ({reason(error)}); make the run again") from None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema is not {SCHEMA}; make the run again with this version")
    return document


def _dataset(prepared: Prepared) -> dict[str, Any]:
    dataset = prepared.dataset
    return {
        "kind": dataset.kind,
        "description": dataset.description,
        "sensors": list(dataset.log.sensors),
        "frames": len(prepared.timeline),
        "start_s": prepared.timeline[0].time,
        "end_s": prepared.timeline[-1].time,
        "segment": None if dataset.segment is None else dataset.segment.number,
    }


def _start(prepared: Prepared) -> dict[str, Any]:
    frames, noise = prepared.start.frames, prepared.gyro_noise
    return {
        "frames": len(frames.mean),
        "end_s": prepared.start_end,
        "iterations": frames.iterations,
        "converged": frames.converged,
        "fit": prepared.start.fit,
        "momentum_residual": prepared.start.momentum_residual,
        "gyro_relative_error": None if noise is None else noise.relative_error,
        "gyro_correlation_samples": None if noise is None else noise.correlation_time,
    }


def _estimator(evaluation: Evaluation) -> dict[str, Any]:
    history, body = evaluation.history, evaluation.body
    runtime = history.runtime[history.runtime > 0]
    errors = {key: value for key, value in numbers(evaluation).items() if key.startswith(_ERROR_KEYS)}
    return {
        "status": str(history.status.verdict),
        "reasons": list(history.status.reasons),
        "frames": len(history.time),
        "measurements": {"accepted": int(history.accepted.sum()), "rejected": int(history.rejected.sum())},
        "runtime_s": {
            "total": float(runtime.sum()),
            "per_frame_median": float(np.median(runtime)) if runtime.size else None,
            "per_frame_max": float(runtime.max()) if runtime.size else None,
        },
        "principal_moments": body.principal_moments.tolist(),
        "principal_moments_std": body.principal_moments_std.tolist(),
        "principal_moments_cov": body.principal_moments_cov.tolist(),
        "principal_axes_g": body.principal_axes_g.tolist(),
        "principal_axes_std_rad": body.principal_axes_std.tolist(),
        "center_of_mass_g": None if body.center_of_mass_g is None else body.center_of_mass_g.tolist(),
        "center_of_mass_std_m": None if body.center_of_mass_std is None else body.center_of_mass_std.tolist(),
        "k1": body.k1,
        "k1_std": body.k1_std,
        "k2": body.k2,
        "k2_std": body.k2_std,
        "drag_per_rad": body.drag,
        "drag_std_per_rad": body.drag_std,
        "nis_per_dof": evaluation.nis_ratio,
        "errors": errors if evaluation.errors is not None else None,
    }


_ERROR_KEYS = (
    "rms",
    "ape",
    "principal_moments_error",
    "k1_error",
    "k2_error",
    "axes_angle",
    "center_of_mass_error",
    "nees",
    "bound",
)
