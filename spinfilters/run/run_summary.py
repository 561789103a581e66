"""summary.json: what a run was made of and what came out, in numbers."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from spinfilters.core.errors import InputError
from spinfilters.evaluation.epoch_spans import (
    ALWAYS,
    EpochSpan,
    on_identical_measurements,
    own_span,
    second_half,
    shared_begin,
    shared_span,
    use_by_sensor,
)
from spinfilters.evaluation.estimator_evaluation import INTERVAL_LEVELS, Evaluation
from spinfilters.evaluation.metrics import ERRORS, Metric, metrics
from spinfilters.evaluation.spin_regime import spin_verdict
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset_reader import has_images
from spinfilters.io.input_file import path_text, read_bytes, reason
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import StateLayout
from spinfilters.run.array_files import finite_document, finite_numbers
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
        "estimators": {
            e.name: {
                **_estimator(e, shared),
                "measurements_by_sensor": use_by_sensor(e.history, setup.timeline),
                "noise": _noise(told, e),
            }
            for e in evaluations
        },
    }


def read_summary(folder: Path) -> dict[str, Any]:
    """summary.json of a run folder.

    Raises
    ------
    InputError
        Missing, too large, not JSON, another schema.
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
    InputError
        As `read_summary`, or the summary does not hold it.
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


def _estimator(evaluation: Evaluation, shared: float) -> dict[str, Any]:
    """Verdict and numbers of one estimator."""
    status = evaluation.history.status
    spin = spin_verdict(evaluation)
    checks = [{"name": each.check, "numbers": finite_numbers(each.numbers)} for each in status.findings]
    return {
        "status": str(status.verdict),
        "reasons": list(status.reasons),
        "checks": checks,
        "holds": {name: str(state) for name, state in status.holds.items()},
        **estimator_numbers(evaluation, shared),
        "spin": None if spin is None else spin.document,
        "deviation_parts": {name: part.document for name, part in evaluation.deviation_parts.items()},
        "intervals": interval_document(evaluation),
    }


def interval_document(evaluation: Evaluation) -> dict[str, dict[str, list[float | None]]] | None:
    """Half widths by quantity and per cent, as summary.json holds them; None where one Gaussian says it."""
    if evaluation.intervals is None:
        return None
    names = [f"{100 * level:g}" for level in INTERVAL_LEVELS]
    return {
        quantity: dict(zip(names, finite_document(half_widths.tolist()), strict=True))
        for quantity, half_widths in evaluation.intervals.items()
    }


def estimator_numbers(evaluation: Evaluation, shared: float = ALWAYS) -> dict[str, Any]:
    """An estimator's numbers as `summary.json` holds them, by the keys of metrics.

    Parameters
    ----------
    evaluation : Evaluation
        Of the estimator; its numbers are over its own epochs, those that a filter has after its initialisation.
    shared : float
        Time (s) from which on all estimators of a run have epochs of their own; ``shared_epochs`` are over these.

    Returns
    -------
    dict[str, Any]
        Numbers, lists, texts and tables of them; ``errors`` is None without a truth.
    """
    own, common = own_span(evaluation), shared_span(evaluation, shared)
    document: dict[str, Any] = {}
    for metric in metrics():
        if metric.key and not metric.needs_truth:
            _place(document, metric.key, metric.of(own))
            if metric.of_epochs:
                parent = metric.key.removesuffix(metric.leaf)
                _place(document, f"{parent}shared_epochs.{metric.leaf}", metric.of(common))
    return document | {ERRORS: _error_numbers(evaluation, own, common)}


def _place(document: dict[str, Any], key: str, value: Any) -> None:
    """Put a value where a key with dots says."""
    *tables, leaf = key.split(".")
    for name in tables:
        document = document.setdefault(name, {})
    document[leaf] = value


def _error_numbers(evaluation: Evaluation, own: EpochSpan, common: EpochSpan) -> dict[str, Any] | None:
    if evaluation.errors is None or evaluation.body_errors is None:
        return None
    chosen = [metric for metric in metrics() if metric.needs_truth]
    late, first = second_half(evaluation), evaluation.history.initialisation_end
    rms = [(each, each.leaf.replace("rms_", "rms_second_half_", 1)) for each in chosen if each.of_epochs]
    halves = [(metric, name) for metric, name in rms if name != metric.leaf]
    bounded = [metric for metric in chosen if metric.bound is not None]
    found = {metric.leaf: metric.of(own) for metric in chosen}
    found = {
        metric.leaf: found[metric.leaf] for metric in chosen if metric.null or found[metric.leaf] is not None
    }
    bound = {metric.leaf: metric.bound_of(own) for metric in bounded}
    bound |= {name: metric.bound_of(late) for metric, name in halves if metric.bound is not None}
    return {
        **found,
        **{name: metric.of(late) for metric, name in halves},
        "bound": None if evaluation.bound is None else bound,
        **({} if evaluation.bound_missing is None else {"bound_missing": evaluation.bound_missing}),
        "shared_epochs": _span_numbers(chosen, common),
        "initialisation": None
        if first is None
        else _span_numbers(chosen, EpochSpan(evaluation, ALWAYS, first)),
    }


def _span_numbers(chosen: list[Metric], span: EpochSpan) -> dict[str, Any] | None:
    """Errors of other epochs than the estimator's own, with their bounds; None without any."""
    if span.errors is None:
        return None
    found: dict[str, Any] = {"epochs": len(span.errors.time)}
    for metric in chosen:
        if metric.of_epochs:
            value, bound = metric.of(span), metric.bound_of(span)
            found |= {metric.leaf: value} if metric.null or value is not None else {}
            found |= {f"bound_{metric.leaf}": bound} if span.bound is not None and metric.bound else {}
    return found
