"""Figures of what follows from the last state: errors of predictions, and a race of several inertias."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from spinfilters.evaluation.prediction_errors import PredictionErrors, PropagatedInertia
from spinfilters.plots.style import (
    BLACK,
    GREY,
    SIGMAS,
    EstimatorLine,
    estimator_lines,
    half_width,
    legend_below,
    plot_truth,
    tidy,
    truth_handle,
)

_PANELS: Final[Mapping[str, tuple[str, float, str]]] = {
    "position": ("position [mm]", 1e3, "i"),
    "attitude": ("attitude [deg]", np.rad2deg(1.0), "g"),
    "velocity": ("velocity [mm/s]", 1e3, "i"),
    "rate": ("rate [deg/s]", np.rad2deg(1.0), "i"),
}
"""Label, scale and axes of every quantity."""


def prediction_errors_figure(predicted: Mapping[str, PredictionErrors]) -> Figure:
    """Errors of every axis with their bands of 3 sigma, and below them the NEES with its band of 95 %.

    Parameters
    ----------
    predicted : mapping of str to PredictionErrors
        By the name of the estimator, at least one.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    names = [name for name in _PANELS if any(name in errors.courses for errors in predicted.values())]
    lines = estimator_lines(list(predicted))
    has_nees = any(errors.nees is not None for errors in predicted.values())
    count = len(names) + has_nees
    figure = Figure(figsize=(11.0, 1.0 + 1.95 * count), layout="constrained")
    grid = figure.add_gridspec(count, 3)
    for row, name in enumerate(names):
        label, scale, frame = _PANELS[name]
        for axis in range(3):
            axes = figure.add_subplot(grid[row, axis])
            _error_panel(axes, name, axis, scale, predicted, lines)
            axes.set_title(f"{name}, {'xyz'[axis]} axis of {frame}", loc="left", fontsize="medium")
            if axis == 0:
                axes.set_ylabel(label)
    if has_nees:
        _nees_panel(figure.add_subplot(grid[count - 1, :]), predicted, lines)
    for axes in figure.axes[-1 if has_nees else -3 :]:
        axes.set_xlabel("time ahead [s]")
    judges = " and ".join(dict.fromkeys(errors.judge for errors in predicted.values()))
    figure.suptitle(f"Prediction minus {judges}, ±{SIGMAS:g} σ as predicted", fontsize="large")
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ")
    limit = (
        [Line2D([], [], color=BLACK, linestyle=":", label="95 % of one prediction's NEES")]
        if has_nees
        else []
    )
    legend_below(figure, [*(line.handle for line in lines), band, *limit])
    return figure


def _error_panel(
    axes: Axes,
    name: str,
    axis: int,
    scale: float,
    predicted: Mapping[str, PredictionErrors],
    lines: Sequence[EstimatorLine],
) -> None:
    values, bands = [np.zeros(1)], [np.zeros(1)]
    for errors, line in zip(predicted.values(), lines, strict=True):
        if name not in errors.courses:
            continue
        course = errors.courses[name]
        value, band = scale * course.error[:, axis], SIGMAS * scale * course.std[:, axis]
        line.fill(axes, errors.ahead, np.zeros_like(value), band)
        line.draw(axes, errors.ahead, value)
        values.append(value)
        bands.append(band)
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    width = half_width(np.concatenate(values)[:, None], np.concatenate(bands)[:, None])
    axes.set_ylim(-width, width)
    tidy(axes)


def _nees_panel(
    axes: Axes, predicted: Mapping[str, PredictionErrors], lines: Sequence[EstimatorLine]
) -> None:
    limits = []
    for errors, line in zip(predicted.values(), lines, strict=True):
        ratio = errors.ratio
        if ratio is not None:
            line.draw(axes, errors.ahead, ratio)
            limits += errors.band
    for limit in dict.fromkeys(limits):
        axes.axhline(limit, color=BLACK, linestyle=":", linewidth=1.0)
    axes.set_title("NEES of the whole error, 1 expected", loc="left", fontsize="medium")
    axes.set_ylabel("NEES per dof")
    axes.set_ylim(bottom=0.0)
    tidy(axes)


def inertia_race_figure(
    time: Float[np.ndarray, " k"], found: Sequence[PropagatedInertia], reference: PropagatedInertia
) -> Figure:
    """Body rates of every inertia (left), closest angle to the reference and difference of the rates (right).

    Parameters
    ----------
    time : ndarray of float, shape (k,)
        Since the common state, s.
    found : sequence of PropagatedInertia
        Motions of the inertias.
    reference : PropagatedInertia
        With which they are compared.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(6, 2)
    lines = estimator_lines([each.name for each in found])
    rates = [figure.add_subplot(grid[2 * axis : 2 * axis + 2, 0]) for axis in range(3)]
    for axis, axes in enumerate(rates):
        for each, line in zip(found, lines, strict=True):
            line.draw(axes, time, np.rad2deg(each.rate[:, axis]))
        plot_truth(axes, time, np.rad2deg(reference.rate[:, axis]))
        axes.set_title(f"body rate about {'xyz'[axis]} of g", loc="left", fontsize="medium")
        axes.set_ylabel("rate [deg/s]")
        tidy(axes)
    upper, lower = figure.add_subplot(grid[:3, 1]), figure.add_subplot(grid[3:, 1])
    for each, line in zip(found, lines, strict=True):
        line.draw(upper, time, np.rad2deg(each.angle_from(reference.attitude)))
        line.draw(lower, time, np.rad2deg(each.rate_from(reference.rate)))
    for axes, title, label in (
        (upper, "closest angle", "angle [deg]"),
        (lower, "difference of the body rates", "rate [deg/s]"),
    ):
        axes.set_title(f"{title} from {_words(reference)}", loc="left", fontsize="medium")
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
        tidy(axes)
    for axes in (rates[-1], lower):
        axes.set_xlabel("time from the common state [s]")
    figure.suptitle("One state, several inertias, no torques", fontsize="large")
    legend_below(figure, [*(line.handle for line in lines), truth_handle(_words(reference))])
    return figure


def _words(reference: PropagatedInertia) -> str:
    return "the true motion" if reference.name == "truth" else reference.name
