"""Accuracy of the mean attitude over the number of scans, with the number needed."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.plots.style import BLUE, GREY, RED


def scan_accuracy_figure(stds: Float[np.ndarray, " n"], asked: float, needed: int, title: str) -> Figure:
    """Attitude deviation of the first scans, deg, and its trend to twice as many.

    Parameters
    ----------
    stds: of the first 1, 2, ... n scans, rad.   asked: standard deviation, rad.   needed: scans that it takes.
    """
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes, count = figure.add_subplot(), np.arange(1, len(stds) + 1)
    axes.loglog(count, np.rad2deg(stds), color=BLUE, marker=".", label="these scans, the first n")
    more = np.geomspace(1, max(needed, len(stds), 2), 100)
    line = stds[-1] * np.sqrt(len(stds) / more)
    axes.loglog(more, np.rad2deg(line), color=GREY, linestyle="--", label="scans like these on average")
    axes.axhline(np.rad2deg(asked), color=RED, linewidth=0.8)
    axes.plot(
        [needed], [np.rad2deg(asked)], "o", color=RED, label=f"{np.rad2deg(asked):g} deg: {needed} scans"
    )
    axes.set(xlabel="number of scans", ylabel="attitude, standard deviation (deg)", title=title)
    axes.legend()
    return figure
