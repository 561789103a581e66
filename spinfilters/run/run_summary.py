"""summary.json: what a run was made of and what came out, in numbers."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimator_evaluation import Evaluation, constant_numbers
from spinfilters.evaluation.metrics import numbers, on_identical_measurements, shared_begin, use_numbers
from spinfilters.filters.history import EstimateHistory
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset_reader import has_images
from spinfilters.io.input_file import path_text, read_bytes, reason
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import StateLayout
from spinfilters.run.array_files import finite_numbers
from spinfilters.run.conditions import StatedNoise
from spinfilters.run.estimation import Comparison

SUMMARY_FILE = "summary.json"
SCHEMA = 1
LARGEST_SUMMARY = 1 << 26


def summary(comparison: Comparison) -> dict[str, Any]:
    """The content of summary.json."""
    setup, evaluations = comparison.setup, comparison.evaluations
    shared, conditions = shared_begin(evaluations), comparison.conditions
    told = (*conditions.sensors, *conditions.disturbances)
    return {
        "schema": SCHEMA,
        "dataset": _dataset(setup),
        "process": {"blocks": list(setup.process.layout.blocks), **vars(setup.process.noise)},
        "sensors": dict(setup.noise.values),
        "conditions": conditions.document,
        "identical_measurements": on_identical_measurements(evaluations),
        "start": _start(setup),
        "estimators": {e.name: {**_estimator(e, shared), "noise": _noise(told, e)} for e in evaluations},
    }


def read_summary(folder: Path) -> dict[str, Any]:
    """summary.json of a run folder.

    Raises
    ------
    InputError: missing, too large, not JSON, another schema.
    """
    path = folder / SUMMARY_FILE
    if not path.is_file():
        why = (
            "Is a directory"
            if path.is_dir()
            else "a device or pipe"
            if path.exists()
            else "No such file or directory"
        )
        raise InputError(
            f"{path_text(path)}: cannot be read ({why}); give a folder made by 'spinfilters compare'"
        )
    try:
        document = json.loads(read_bytes(path, LARGEST_SUMMARY).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path_text(path)}: is not JSON ({reason(error)}); make the run again") from None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema is not {SCHEMA}; make the run again with this version")
    return document


def read_process(folder: Path, tolerance: float) -> TorqueFreeProcess:
    """The process model of a run folder's estimators.

    It has its own tolerance of integration (rad and relative rate).

    Raises
    ------
    InputError: as `read_summary`, or the summary does not tell it.
    """
    document = read_summary(folder)
    try:
        told = dict(document["process"])
        layout = StateLayout(tuple(told.pop("blocks")))
        return TorqueFreeProcess(layout, ProcessNoise(**told), tolerance)
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise not_whole(folder, error) from None


def not_whole(folder: Path, error: Exception) -> InputError:
    """InputError for a summary that is not whole."""
    return InputError(f"{folder}: {SUMMARY_FILE} is not whole ({error!r}); make the run again")


def _dataset(setup: Setup) -> dict[str, Any]:
    dataset = setup.dataset
    return {
        "kind": dataset.kind,
        "description": dataset.description,
        "sensors": list(dataset.log.sensors),
        "frames": len(setup.timeline),
        "start_s": setup.timeline[0].time,
        "end_s": setup.timeline[-1].time,
        "images": str(dataset.path.resolve())
        if dataset.path is not None and has_images(dataset.path)
        else None,
        "segment": None if dataset.segment is None else dataset.segment.number,
    }


def _start(setup: Setup) -> dict[str, Any]:
    start, noise = setup.initial, setup.gyro_noise
    return {
        "frames": len(start.mean),
        "end_s": setup.end_of_initialisation,
        "iterations": start.iterations,
        "converged": start.converged,
        "fit": start.fit,
        "momentum_residual": start.momentum_residual,
        "rejected": start.rejected,
        "noise_ratio": start.noise_ratio,
        "gyro_relative_error": None if noise is None else noise.relative_error,
        "gyro_correlation_samples": None if noise is None else noise.correlation_time,
    }


def _noise(told: Sequence[StatedNoise], evaluation: Evaluation) -> dict[str, Any]:
    """Levels of noise that an estimate rests on in the end."""
    return {each.name: each.identified(evaluation.history.noise).level for each in told}


def _runtime(history: EstimateHistory) -> dict[str, float | None]:
    """Time in all, with that of the initialisation, and by epoch of the estimator's own, s."""
    own = history.runtime[history.own]
    runtime = own[own > 0]
    return {
        "total": float(history.runtime.sum()),
        "per_frame_median": float(np.median(runtime)) if runtime.size else None,
        "per_frame_max": float(runtime.max()) if runtime.size else None,
    }


def _estimator(evaluation: Evaluation, shared: float) -> dict[str, Any]:
    history, body = evaluation.history, evaluation.body
    found = numbers(evaluation, shared)
    errors = {key: value for key, value in found.items() if key.startswith(_ERROR_KEYS)}
    return {
        "status": str(history.status.verdict),
        "reasons": list(history.status.reasons),
        "checks": [
            {"name": each.check, "numbers": finite_numbers(each.numbers)} for each in history.status.findings
        ],
        "holds": {name: str(state) for name, state in history.status.holds.items()},
        "frames": len(history.time),
        "initialisation_epochs": history.initialisation,
        "measurements": {"accepted": found["accepted"], "rejected": found["rejected"]},
        "observations": use_numbers(evaluation, shared),
        "runtime_s": _runtime(history),
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
        **constant_numbers(evaluation.constants),
        "deviation_parts": {name: part.document for name, part in evaluation.deviation_parts.items()},
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
    "shared_epochs",
    "initialisation",
)
