"""Figure of a race: attitudes and rates of several inertias apart from the true motion, or from the first of them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.evaluation.inertia_race import PropagatedInertia
from spinfilters.plots.style import estimator_lines, legend_below, plot_truth, tidy, truth_handle


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
