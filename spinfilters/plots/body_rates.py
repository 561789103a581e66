"""Body rates of every estimator against the truth or the gyro."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from spinfilters.evaluation.estimated_motion import BodyRates
from spinfilters.plots.style import (
    BLACK,
    GREY,
    PRINCIPAL_NAMES,
    SIGMAS,
    EstimatorLine,
    estimator_lines,
    legend_below,
    mark_start,
    start_handle,
    tidy,
)

PRINCIPAL_AXES = tuple(f"about the {name} axis" for name in PRINCIPAL_NAMES)
"""Names of the axes of rates that were turned into principal axes (`BodyRates.in_axes`)."""
G_AXES = ("about x of g", "about y of g", "about z of g")
_MOST_MARKS = 400  # of a gyro: more would be a solid bar


def rates_figure(
    estimates: Sequence[BodyRates],
    reference: BodyRates | None = None,
    axis_names: Sequence[str] = G_AXES,
    end_of_initialisation: float | None = None,
) -> Figure:
    """Rates about three body axes, one panel each.

    All in the same axes. `end_of_initialisation` (s) ends the initialisation.
    """
    figure = Figure(figsize=(10.0, 7.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    lines = estimator_lines([estimate.label for estimate in estimates])
    for axis, axes in enumerate(panels):
        if reference is not None:
            _reference(axes, reference, axis)
        for estimate, line in zip(estimates, lines, strict=True):
            _estimate(axes, estimate, axis, line)
        mark_start(axes, estimates[0].time[0], end_of_initialisation)
        axes.axhline(0.0, color=BLACK, linewidth=0.5)
        axes.set_title(axis_names[axis], loc="left", fontsize="medium")
        axes.set_ylabel("rate [deg/s]")
        tidy(axes)
    panels[-1].set_xlabel("time [s]")
    figure.suptitle(f"Body rates: {_speed(estimates[0])}", fontsize="large")
    handles = [line.handle for line in lines]
    known = [] if reference is None else [_reference_handle(reference)]
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ")
    legend_below(figure, [*handles, band, *known, *start_handle(end_of_initialisation)])
    return figure


def _estimate(axes: Axes, rates: BodyRates, axis: int, line: EstimatorLine) -> None:
    value = np.rad2deg(rates.rate[:, axis])
    if rates.std is not None:
        line.fill(axes, rates.time, value, SIGMAS * np.rad2deg(rates.std[:, axis]))
    line.draw(axes, rates.time, value)


def _reference(axes: Axes, rates: BodyRates, axis: int) -> None:
    step = max(1, len(rates.time) // _MOST_MARKS)
    value = np.rad2deg(rates.rate[:, axis])
    axes.plot(
        rates.time[::step], value[::step], linestyle="none", marker="o", markersize=3.2, color=BLACK, zorder=1
    )


def _reference_handle(rates: BodyRates) -> Line2D:
    return Line2D([], [], linestyle="none", marker="o", markersize=3.2, color=BLACK, label=rates.label)


def _speed(rates: BodyRates) -> str:
    speed = np.linalg.norm(rates.rate, axis=1) * 30.0 / np.pi
    speed = speed[np.isfinite(speed)]
    if not speed.size:
        return "not finite"
    return f"{np.median(speed):.3g} rpm, between {speed.min():.3g} and {speed.max():.3g} rpm"
