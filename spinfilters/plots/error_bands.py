"""Errors of one estimator within its stated bands; without a truth, the estimates."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from spinfilters.evaluation.estimated_motion import Trajectory
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.plots.style import (
    SIGMAS,
    EstimatorLine,
    estimator_lines,
    half_width,
    legend_below,
    mark_start,
    random_handle,
    start_handle,
    tidy,
)

DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class _Row:
    """One row of panels, x, y and z.

    Values and standard deviations in the unit of the label.
    """

    label: str
    axis_names: tuple[str, str, str]
    values: Float[np.ndarray, "n 3"]
    std: Float[np.ndarray, "n 3"]
    about_zero: bool
    random: Float[np.ndarray, "n 3"] | None = None
    """Part of the standard deviations that is chance; None where that is all."""


def error_bands_figure(evaluation: Evaluation) -> Figure:
    """Position, attitude, velocity and rate errors (rows) by axis (columns) with +-3 sigma.

    Without a truth the estimates themselves, with the attitude's uncertainty about zero.
    """
    rows = _rows(evaluation)
    time = evaluation.history.time if evaluation.errors is None else evaluation.errors.time
    end_of_initialisation = evaluation.history.initialisation_end
    figure = Figure(figsize=(11.0, 1.0 + 1.95 * len(rows)), layout="constrained")
    panels = figure.subplots(len(rows), 3, sharex=True, squeeze=False)
    line = replace(estimator_lines([evaluation.name])[0], width=1.3)
    for row, row_panels in zip(rows, panels, strict=True):
        for axis, axes in enumerate(row_panels):
            _panel(axes, time, row, axis, line)
            mark_start(axes, time[0], end_of_initialisation)
        row_panels[0].set_ylabel(row.label)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    what = "estimate" if evaluation.errors is None else "error"
    figure.suptitle(
        f"{evaluation.name.upper()}: {what} and its ±{SIGMAS:g} σ{_inside(rows, _own(evaluation, time))}",
        fontsize="large",
    )
    band = Patch(color=line.color, alpha=0.2, label=f"±{SIGMAS:g} σ of the estimator")
    parts = [] if rows[0].random is None else [random_handle()]
    legend_below(figure, [line.handle, band, *parts, *start_handle(end_of_initialisation)])
    return figure


def _rows(evaluation: Evaluation) -> list[_Row]:
    """Rows of panels, with the random part of the deviations where the calibration adds."""
    build = _estimate_rows if evaluation.errors is None else _error_rows
    rows, chance = build(evaluation, evaluation.trajectory), evaluation.random_trajectory
    if chance is None:
        return rows
    return [replace(row, random=part.std) for row, part in zip(rows, build(evaluation, chance), strict=True)]


def _panel(axes: Axes, time: np.ndarray, row: _Row, axis: int, line: EstimatorLine) -> None:
    value, band = row.values[:, axis], SIGMAS * row.std[:, axis]
    centre = np.zeros_like(value) if row.about_zero else value
    line.fill(axes, time, centre, band)
    if row.random is not None:
        line.edge(axes, time, centre, SIGMAS * row.random[:, axis])
    if value.any():
        line.draw(axes, time, value)
    if row.about_zero:
        axes.axhline(0.0, color="black", linewidth=0.5)
        width = half_width(value[:, np.newaxis], band[:, np.newaxis])
        axes.set_ylim(-width, width)
    axes.set_title(row.axis_names[axis], fontsize="medium", loc="left")
    tidy(axes)


def _own(evaluation: Evaluation, time: np.ndarray) -> Bool[np.ndarray, " n"]:
    """Mask of times (s) that belong to the estimator's own epochs."""
    begin = evaluation.own_begin
    return np.zeros(len(time), dtype=bool) if begin is None else time >= begin


def _inside(rows: list[_Row], own: Bool[np.ndarray, " n"]) -> str:
    """Share of the estimator's own errors within the bands, in words; empty where none is known."""
    pairs = [(np.abs(row.values), SIGMAS * row.std) for row in rows if row.about_zero and row.values.any()]
    if len(pairs) < len(rows) or not own.any():
        return ""
    held = [own[:, np.newaxis] & np.isfinite(band) for _, band in pairs]
    if not all(chosen.any() for chosen in held):
        return ""
    share = np.mean(
        [np.mean((value <= band)[chosen]) for (value, band), chosen in zip(pairs, held, strict=True)]
    )
    return f", {100 * share:.1f} % inside in its own {np.count_nonzero(own)} epochs (99.7 % expected)"


def _error_rows(evaluation: Evaluation, trajectory: Trajectory) -> list[_Row]:
    errors = evaluation.errors
    assert errors is not None
    i_axes, g_axes = _names("i"), _names("g")
    kept = errors.rows
    quantities = [
        ("position [mm]", i_axes, errors.position, trajectory.std_position, 1e3),
        ("attitude [deg]", g_axes, errors.attitude, trajectory.std_attitude, DEGREES),
        ("velocity [mm/s]", i_axes, errors.velocity, trajectory.std_velocity, 1e3),
        ("rate [deg/s]", i_axes, errors.rate, trajectory.std_rate, DEGREES),
    ]
    return [
        _Row(label, names, scale * values, scale * std[kept], True)
        for label, names, values, std, scale in quantities
        if values is not None
    ]


def _estimate_rows(_: Evaluation, trajectory: Trajectory) -> list[_Row]:
    i_axes, nothing = _names("i"), np.zeros((len(trajectory.time), 3))
    attitude = _Row("attitude ± [deg]", _names("g"), nothing, DEGREES * trajectory.std_attitude, True)
    rate = _Row("rate [deg/s]", i_axes, DEGREES * trajectory.rate_i, DEGREES * trajectory.std_rate, False)
    if not trajectory.sees_position:
        return [attitude, rate]
    position = _Row("position [m]", i_axes, trajectory.position, trajectory.std_position, False)
    velocity = _Row(
        "velocity [mm/s]", i_axes, 1e3 * trajectory.velocity, 1e3 * trajectory.std_velocity, False
    )
    return [position, attitude, velocity, rate]


def _names(frame: str) -> tuple[str, str, str]:
    return (f"x axis of {frame}", f"y axis of {frame}", f"z axis of {frame}")
