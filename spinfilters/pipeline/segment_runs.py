"""Every segment of a recording.

A run each, a table and a picture of the fitted inertia of all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from rich.table import Table

from spinfilters.data.atomic_write import write_json
from spinfilters.data.dataset import Dataset
from spinfilters.errors import InputError
from spinfilters.pipeline.estimation import compare_estimators
from spinfilters.pipeline.pooled_acceleration import PooledAcceleration, pooled_acceleration, strength_of
from spinfilters.pipeline.pooled_moments import PooledMoments, pooled_moments
from spinfilters.pipeline.preparation import prepare
from spinfilters.plots.style import draw_figure
from spinfilters.plots.throws import Throw, throws_figure
from spinfilters.runs.run_folder import (
    SEGMENTS_FOLDER,
    finished_run,
    refuse_foreign_run,
    write_configuration,
    write_run,
)
from spinfilters.runs.run_summary import read_summary
from spinfilters.settings.run_settings import Settings


@dataclass(frozen=True)
class SegmentResult:
    """One segment: its number, its summary.json, or why there is none."""

    number: int
    summary: dict[str, Any] | None
    failure: str | None = None


def run_segments(
    datasets: Sequence[Dataset],
    folder: Path,
    settings: Settings,
    on_segment: Callable[[int, int], None],
) -> list[SegmentResult]:
    """A run folder per segment.

    One that was already made with the same settings is not made again.
    Ctrl-C ends the loop; what is done is returned.
    """
    write_configuration(folder, settings)
    results: list[SegmentResult] = []
    try:
        for index, dataset in enumerate(datasets):
            on_segment(index, len(datasets))
            results.append(_run_segment(dataset, folder, settings))
        on_segment(len(datasets), len(datasets))
    except KeyboardInterrupt:
        pass
    return results


def _run_segment(dataset: Dataset, folder: Path, settings: Settings) -> SegmentResult:
    number = 0 if dataset.segment is None else dataset.segment.number or 0
    place = folder / SEGMENTS_FOLDER / f"{number:03d}"
    if (done := finished_run(place, dataset, settings)) is not None:
        return SegmentResult(number, done)
    try:
        refuse_foreign_run(place)
        comparison = compare_estimators(prepare(dataset, settings), settings, lambda *_: None)
    except InputError as error:
        return SegmentResult(number, None, str(error))
    if comparison.interrupted:
        raise KeyboardInterrupt
    write_run(place, comparison, settings)
    return SegmentResult(number, read_summary(place))


def write_segments(folder: Path, results: Sequence[SegmentResult], settings: Settings) -> None:
    """segments.json, and throws-<estimator>.png of every estimator that has a result."""
    document = {
        str(r.number): {"failure": r.failure} if r.summary is None else r.summary["estimators"]
        for r in results
    }
    pooled = {
        name: None if found is None else found.document for name, found in pool(results, settings).items()
    }
    accelerations = {
        name: None if found is None else found.document
        for name, found in pool_accelerations(results, settings).items()
    }
    write_json(
        folder / "segments.json",
        {"schema": 1, "segments": document, "pooled": pooled, "pooled_acceleration": accelerations},
    )
    for name in settings.estimators:
        estimates = [(r.number, r.summary["estimators"][name]) for r in results if r.summary is not None]
        throws = [_throw(number, estimate) for number, estimate in estimates]
        throws = [
            throw
            for throw in throws
            if np.isfinite(throw.ratios).all() and np.isfinite(throw.covariance).all()
        ]
        if throws:
            draw_figure(partial(throws_figure, throws), folder / throws_picture(name))


def throws_picture(estimator: str) -> str:
    """File of the picture of all segments; there is none where no segment has finite moments."""
    return f"throws-{estimator}.png"


def _throw(number: int, estimate: dict[str, Any]) -> Throw:
    moments, covariance = _numbers(estimate["principal_moments"]), _numbers(estimate["principal_moments_cov"])
    return Throw(number, moments[:2], covariance[:2, :2], estimate["status"] != "ok")


def _numbers(listed: list[Any]) -> Float[np.ndarray, "..."]:
    """Numbers of a summary, where `null` is not a number."""
    return np.array(listed, dtype=float)


def segment_table(results: Sequence[SegmentResult], settings: Settings) -> Table:
    """A row per segment and estimator: moments and acceleration, their deviations, drag, status and why."""
    table = Table(title="Fitted inertia of every segment", title_justify="left")
    for heading in ("segment", "estimator", "J1/J3", "J2/J3", "drag 1/rad", "m/s^2", "status", "reason"):
        table.add_column(heading)
    for result in results:
        if result.summary is None:
            table.add_row(str(result.number), *5 * ("-",), "failed", result.failure or "")
            continue
        for name in settings.estimators:
            table.add_row(str(result.number), name, *_cells(result.summary["estimators"][name]))
    return table


def _cells(estimate: dict[str, Any]) -> tuple[str, ...]:
    moments, std = _numbers(estimate["principal_moments"]), _numbers(estimate["principal_moments_std"])
    drag, linear, strength = (
        estimate["drag_per_rad"],
        estimate.get("linear_drag_per_s"),
        strength_of(estimate),
    )
    first, second = (
        f"{value:.4f} ± {spread:.4f}" if np.isfinite(value) else "-"
        for value, spread in zip(moments[:2], std[:2], strict=True)
    )
    return (
        first,
        second,
        (f"{drag:.4f}" if linear is None else f"{linear:.4f} 1/s")
        if drag is not None or linear is not None
        else "-",
        "-" if strength is None else f"{strength.value:.2f} ± {strength.std:.2f}",
        estimate["status"],
        "; ".join(estimate["reasons"]),
    )


def pool(results: Sequence[SegmentResult], settings: Settings) -> dict[str, PooledMoments | None]:
    """Pooled ratios per estimator over its ``ok`` segments, None without any."""
    summaries = [result.summary for result in results if result.summary is not None]
    return {
        name: pooled_moments([summary["estimators"][name] for summary in summaries], len(results))
        for name in settings.estimators
    }


def pool_accelerations(
    results: Sequence[SegmentResult], settings: Settings
) -> dict[str, PooledAcceleration | None]:
    """Pooled acceleration per estimator over all segments, None without any."""
    summaries = [result.summary for result in results if result.summary is not None]
    return {
        name: pooled_acceleration([summary["estimators"][name] for summary in summaries])
        for name in settings.estimators
    }


class SegmentMedians(NamedTuple):
    """Medians of J1/J3 and J2/J3 over the ``ok`` segments.

    How many those are, and of how many; NaN where none is.
    """

    smallest_ratio: float
    middle_ratio: float
    good: int
    total: int


def segment_medians(results: Sequence[SegmentResult], settings: Settings) -> dict[str, SegmentMedians]:
    """Median inertia ratios of the segments that are ``ok``, per estimator."""
    medians = {}
    for name in settings.estimators:
        estimates = [r.summary["estimators"][name] for r in results if r.summary is not None]
        good = np.array([e["principal_moments"][:2] for e in estimates if e["status"] == "ok"]).reshape(-1, 2)
        middle = np.median(good, axis=0) if len(good) else np.full(2, np.nan)
        medians[name] = SegmentMedians(float(middle[0]), float(middle[1]), len(good), len(results))
    return medians
