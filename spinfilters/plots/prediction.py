"""Prediction of motion and uncertainty after the last epoch."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from spinfilters.evaluation.estimated_motion import BodyRates, Trajectory
from spinfilters.plots.body_rates import PRINCIPAL_AXES
from spinfilters.plots.style import BLACK, GREY, EstimatorLine, estimator_lines, legend_below, tidy

PAST = 0.25
"""Of the time ahead: as much of what was estimated before is shown."""


@dataclass(frozen=True)
class PredictionCurves:
    """One estimator's last epochs and its prediction.

    The last of them stands at the head of both `ahead`s.

    Attributes
    ----------
    before, ahead: motion.   rates_before, rates_ahead: body rates about principal axes; their label is the estimator's name.
    """

    before: Trajectory
    ahead: Trajectory
    rates_before: BodyRates
    rates_ahead: BodyRates


def prediction_figure(predicted_motions: Sequence[PredictionCurves]) -> Figure:
    """Standard deviations over the time ahead (left), and the rates themselves with 1 sigma (right)."""
    figure = Figure(figsize=(12.0, 7.2), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.25))
    left, right = (figure.add_subfigure(grid[column]) for column in range(2))
    lines = estimator_lines([each.rates_ahead.label for each in predicted_motions])
    panels = [*_growth(left, predicted_motions, lines), *_rates(right, predicted_motions, lines)]
    end = max(each.ahead.time[-1] - each.ahead.time[0] for each in predicted_motions)
    for axes in panels:
        axes.axvline(0.0, color=BLACK, linewidth=0.8)
        axes.set_xlim(-PAST * end, end)
        tidy(axes)
    names = ", ".join(line.name.upper() for line in lines)
    figure.suptitle(f"Predicted {end:.4g} s ahead of the last epoch by {names}", fontsize="large")
    band = Patch(color=GREY, alpha=0.3, label="±1 σ of the rate")
    now = Line2D([], [], color=BLACK, linewidth=0.8, label="last epoch")
    legend_below(figure, [*(line.handle for line in lines), band, now])
    return figure


def _growth(
    place: FigureBase, predicted_motions: Sequence[PredictionCurves], lines: Sequence[EstimatorLine]
) -> list[Axes]:
    """Standard deviations of position, attitude and body rate, positions where observed."""
    rows = [("attitude", "deg", np.rad2deg(1.0)), ("body rate", "deg/s", np.rad2deg(1.0))]
    if predicted_motions[0].ahead.sees_position:
        rows.insert(0, ("position", "mm", 1e3))
    panels = list(place.subplots(len(rows), 1, sharex=True))
    for axes, (name, unit, scale) in zip(panels, rows, strict=True):
        for each, line in zip(predicted_motions, lines, strict=True):
            before, ahead = _std(name, each)
            line.draw(axes, _ahead(each, each.before.time), scale * before)
            line.draw(axes, _ahead(each, each.ahead.time), scale * ahead)
        axes.set_title(f"σ of the {name}, all three axes together", loc="left", fontsize="medium")
        axes.set_ylabel(f"σ [{unit}]")
        axes.set_ylim(bottom=0.0)
    panels[-1].set_xlabel("time ahead [s]")
    return panels


def _std(name: str, each: PredictionCurves) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " n"]]:
    """Roots of the sums of the axes' variances, before and ahead."""
    before, ahead = _DEVIATIONS[name](each)
    assert before is not None
    assert ahead is not None
    return np.linalg.norm(before, axis=1), np.linalg.norm(ahead, axis=1)


_DEVIATIONS: Final[
    Mapping[str, Callable[[PredictionCurves], tuple[np.ndarray | None, np.ndarray | None]]]
] = {
    "position": lambda each: (each.before.std_position, each.ahead.std_position),
    "attitude": lambda each: (each.before.std_attitude, each.ahead.std_attitude),
    "body rate": lambda each: (each.rates_before.std, each.rates_ahead.std),
}
"""Deviations of the three axes by the quantity, before and ahead."""


def _rates(
    place: FigureBase, predicted_motions: Sequence[PredictionCurves], lines: Sequence[EstimatorLine]
) -> list[Axes]:
    panels = list(place.subplots(3, 1, sharex=True))
    for axis, axes in enumerate(panels):
        for each, line in zip(predicted_motions, lines, strict=True):
            for rates in (each.rates_before, each.rates_ahead):
                value, time = np.rad2deg(rates.rate[:, axis]), _ahead(each, rates.time)
                if rates.std is not None:
                    line.fill(axes, time, value, np.rad2deg(rates.std[:, axis]))
                line.draw(axes, time, value)
        axes.set_title(f"body rate {PRINCIPAL_AXES[axis]}", loc="left", fontsize="medium")
        axes.set_ylabel("rate [deg/s]")
    panels[-1].set_xlabel("time ahead [s]")
    return panels


def _ahead(each: PredictionCurves, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return time - each.ahead.time[0]
