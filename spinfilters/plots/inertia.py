"""Ratios of the principal moments over time.

How the inertia is learnt, and how sure each estimator is.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from spinfilters.evaluation.body import BodyHistory
from spinfilters.evaluation.deviation_parts import without_calibration
from spinfilters.evaluation.estimated_motion import body_history
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.span import initialisation_end
from spinfilters.plots.style import (
    GREY,
    MOST_DRAWN,
    SIGMAS,
    EstimatorLine,
    estimator_lines,
    finite_quantile,
    legend_below,
    mark_start,
    plot_truth,
    random_handle,
    start_handle,
    tidy,
    truth_handle,
)

RATIO_LABELS = ("$J_{min}\\,/\\,J_{max}$", "$J_{mid}\\,/\\,J_{max}$")


def inertia_figure(
    evaluations: Sequence[Evaluation],
    true_moments: Float[np.ndarray, "3"] | None = None,
) -> Figure:
    """Both ratios with +-3 sigma for every estimator, truth (any scale and order) dashed."""
    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    lines = estimator_lines([evaluation.name for evaluation in evaluations])
    drawn = [evaluation.history.thinned(MOST_DRAWN) for evaluation in evaluations]
    histories = [body_history(history) for history in drawn]
    random = [None if h.calibration is None else body_history(without_calibration(h)) for h in drawn]
    time, end_of_initialisation = histories[0].time, initialisation_end(evaluations)
    for index, axes in enumerate(panels):
        for bodies, chance, line in zip(histories, random, lines, strict=True):
            _ratio(axes, bodies, index, line)
            _random_part(axes, chance, index, line)
        if true_moments is not None:
            value = np.sort(true_moments)[index] / np.max(true_moments)
            plot_truth(axes, time[[0, -1]], np.array([value, value]))
        mark_start(axes, time[0], end_of_initialisation)
        _limits(axes, histories, index)
        axes.set_ylabel(f"{RATIO_LABELS[index]}  [-]")
        tidy(axes)
    panels[-1].set_xlabel("time [s]")
    figure.suptitle(f"Principal moments of inertia: {_ending(evaluations[0])}", fontsize="large")
    handles = [line.handle for line in lines]
    truth = [] if true_moments is None else [truth_handle()]
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ")
    parts = [random_handle()] if any(each is not None for each in random) else []
    legend_below(figure, [*handles, band, *parts, *truth, *start_handle(end_of_initialisation)])
    return figure


def _random_part(axes: Axes, bodies: BodyHistory | None, index: int, line: EstimatorLine) -> None:
    """Edges of the band without the calibration's share, where it has one."""
    if bodies is not None:
        half = SIGMAS * bodies.principal_moments_std[:, index]
        line.edge(axes, bodies.time, bodies.principal_moments[:, index], half)


def _ratio(axes: Axes, bodies: BodyHistory, index: int, line: EstimatorLine) -> None:
    value, band = bodies.principal_moments[:, index], SIGMAS * bodies.principal_moments_std[:, index]
    line.fill(axes, bodies.time, value, band)
    line.draw(axes, bodies.time, value)


def _limits(axes: Axes, histories: Sequence[BodyHistory], index: int) -> None:
    """Limits with 90 % of the bands, within 0 and 1."""
    low = min(_quantile(b, index, -SIGMAS, 0.1, 1.0) for b in histories)
    high = max(_quantile(b, index, SIGMAS, 0.9, 0.0) for b in histories)
    drawn = np.concatenate([np.zeros(0), *(np.asarray(line.get_ydata(), dtype=float) for line in axes.lines)])
    low, high = min(low, finite_quantile(drawn, 0.0, low)), max(high, finite_quantile(drawn, 1.0, high))
    if not low < high:
        low, high = 0.0, 1.0
    margin = 0.1 * (high - low)
    axes.set_ylim(max(low - margin, 0.0), min(high + margin, 1.02))


def _quantile(bodies: BodyHistory, index: int, sigmas: float, share: float, otherwise: float) -> float:
    edge = bodies.principal_moments[:, index] + sigmas * bodies.principal_moments_std[:, index]
    return finite_quantile(edge, share, otherwise)


def _ending(evaluation: Evaluation) -> str:
    moments = " : ".join(evaluation.moment_texts)
    return f"{moments} : 1  ({evaluation.name.upper()} at the end, 1 σ)"
