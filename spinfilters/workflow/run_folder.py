"""The run folder: what others read (trajectories, maps, summary.json) and what the figures are drawn from."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from spinfilters.errors import InputError
from spinfilters.evaluation.evaluation import Evaluation, numbers
from spinfilters.evaluation.trajectory import write_map_ply, write_trajectory_csv, write_trajectory_tum
from spinfilters.logs.atomic_write import make_folder, write_json, write_toml
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.workflow.estimation import Comparison
from spinfilters.workflow.history_file import write_history
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.provenance import provenance
from spinfilters.workflow.settings import Settings

SUMMARY_FILE, CONFIG_FILE, DATASET_FOLDER = "summary.json", "config.toml", "dataset"
SCHEMA = 1
LARGEST_SUMMARY = 1 << 26


def open_run_folder(folder: Path) -> None:
    """Make the folder; refuse one that holds something else than a run.

    Raises
    ------
    InputError: it is a file, holds foreign files, or cannot be written.
    """
    if folder.is_dir() and any(folder.iterdir()):
        known = (SUMMARY_FILE, CONFIG_FILE, DATASET_FOLDER, "segments")
        if not any((folder / name).exists() for name in known):
            raise InputError(f"{folder}: is not empty and not a run folder; choose another folder with -o")
    make_folder(folder)


def write_run(folder: Path, comparison: Comparison, settings: Settings) -> None:
    """Everything but the figures; summary.json comes last, so that a folder with one is whole."""
    make_folder(folder)
    (folder / SUMMARY_FILE).unlink(missing_ok=True)
    write_toml(folder / CONFIG_FILE, {**settings.document, "provenance": provenance()})
    write_dataset(comparison.prepared.dataset, folder / DATASET_FOLDER)
    for evaluation in comparison.evaluations:
        part = folder / evaluation.name
        make_folder(part)
        write_trajectory_csv(part / "trajectory.csv", evaluation.trajectory)
        write_trajectory_tum(part / "trajectory.tum", evaluation.trajectory)
        write_history(part / "history.npz", evaluation.history)
        if comparison.prepared.map_points is not None:
            write_map_ply(part / "map.ply", comparison.prepared.map_points)
    write_json(folder / SUMMARY_FILE, summary(comparison))


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
            raise InputError(f"{path}: {path.stat().st_size} bytes is no summary of a run; make the run again")
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give a folder made by 'spinfilters compare'") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({' '.join(str(error).split())}); make the run again") from None
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


_ERROR_KEYS = ("rms", "ape", "principal_moments_error", "k1_error", "k2_error", "axes_angle", "center_of_mass_error", "nees")
