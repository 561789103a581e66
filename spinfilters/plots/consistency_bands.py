"""NEES and NIS over time with the bands in which a consistent estimator keeps them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.span import initialisation_end, shared_begin
from spinfilters.plots.style import (
    GREEN,
    GREY,
    EstimatorLine,
    estimator_lines,
    legend_below,
    mark_start,
    start_handle,
    tidy,
)

_MOST_MARKS = 120  # of one estimator: more would be a solid bar
_MOST_IN_A_LINE = 3  # means, behind the words of a title


def consistency_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """NIS per degree of freedom, and above it NEES where the true state is known."""
    end_of_initialisation = initialisation_end(evaluations)
    with_truth = any(evaluation.nees is not None for evaluation in evaluations)
    figure = Figure(figsize=(10.0, 6.6 if with_truth else 3.8), layout="constrained")
    panels = figure.subplots(1 + with_truth, 1, sharex=True, squeeze=False)[:, 0]
    lines = estimator_lines([evaluation.name for evaluation in evaluations])
    if with_truth:
        _nees_panel(panels[0], evaluations, lines)
    _nis_panel(panels[-1], evaluations, lines)
    for axes in panels:
        mark_start(axes, evaluations[0].history.time[0], end_of_initialisation)
        tidy(axes)
    panels[-1].set_xlabel("time [s]")
    handles = [line.handle for line in lines]
    band = Patch(color=GREEN, alpha=0.25, label="95% of a consistent estimator")
    legend_below(figure, [*handles, band, *start_handle(end_of_initialisation)])
    return figure


def _nees_panel(axes: Axes, evaluations: Sequence[Evaluation], lines: list[EstimatorLine]) -> None:
    dof, means, begin = 1, [], shared_begin(evaluations)
    for evaluation, line in zip(evaluations, lines, strict=True):
        if evaluation.nees is not None:
            dof = evaluation.nees.dof
            held = np.isfinite(evaluation.nees.total)
            total = np.where(held, evaluation.nees.total, np.nan)
            line.draw(axes, evaluation.nees.time, total / dof)
            late = held & (evaluation.nees.time >= begin)
            means += [f"{evaluation.name.upper()} {np.mean(total[late]) / dof:.2f}"] if late.any() else []
    low, high = chi_square_band(dof, 1)
    axes.axhspan(float(low) / dof, float(high) / dof, color=GREEN, alpha=0.2, linewidth=0, zorder=0)
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("NEES / dof  [-]")
    behind = "" if initialisation_end(evaluations) is None else " behind the initialisation"
    head = f"error of the whole state, {dof} dof; mean{behind}:"
    separator = " " if len(means) <= _MOST_IN_A_LINE else "\n"
    title = f"{head}{separator}{', '.join(means) or 'not finite'}"
    axes.set_title(title, loc="left", fontsize="medium")


def _nis_panel(axes: Axes, evaluations: Sequence[Evaluation], lines: list[EstimatorLine]) -> None:
    ratios, window = [], 1
    for index, (evaluation, line) in enumerate(zip(evaluations, lines, strict=True)):
        if evaluation.nis_ratio is None:
            continue
        time, nis, dof, window = _windows(evaluation.history)
        if index == 0:
            low, high = chi_square_band(dof, 1)
            axes.fill_between(time, low / dof, high / dof, color=GREEN, alpha=0.2, linewidth=0)
        size = 2.0 * line.width
        axes.plot(time, nis / dof, color=line.color, linewidth=0.8, marker="o", markersize=size)
        ratios.append(f"{evaluation.name.upper()} {evaluation.nis_ratio:.3f}")
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    axes.set_ylabel("NIS / dof  [-]")
    each = "epoch by epoch" if window == 1 else f"in groups of {window} epochs"
    title = f"innovations {each}; all together: {', '.join(ratios) or 'none'}"
    axes.set_title(title, loc="left", fontsize="medium")


def _windows(
    history: EstimateHistory,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"], Int[np.ndarray, " k"], int]:
    """Mean time, summed NIS and dof of groups of epochs.

    Innovations are white, a sum is chi-square too.
    """
    used = np.flatnonzero(history.dof > 0)
    window = -(-len(used) // _MOST_MARKS)
    starts = np.arange(0, len(used), window)
    count = np.diff(np.append(starts, len(used)))
    time, nis, dof = (np.add.reduceat(a[used], starts) for a in (history.time, history.nis, history.dof))
    return time / count, nis, dof, window
