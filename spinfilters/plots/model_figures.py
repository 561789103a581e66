"""Figure of a user's own system: ranks by order, what is observable, bounds over time, gains of sensors and manoeuvres."""

from itertools import zip_longest
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from observability.bound_section import StatedBound
from observability.model_analysis import ModelAnalysis
from spinfilters.plots.style import BLUE, GREEN, GREY, RED, tidy

MOST_PANELS: Final = 12
"""Unknowns whose bound is drawn."""
COLUMNS: Final = 4
LARGEST_GAIN: Final = 1e3
"""At the end of the colour scale."""
MOST_NAMES: Final = 24
"""Unknowns that are listed."""


def model_figure(found: ModelAnalysis, stated: StatedBound | None = None) -> Figure:
    """Ranks and observable unknowns of a model, with its bounds over time, s, and gains where they are stated.

    Parameters
    ----------
    found : ModelAnalysis
        The exact part.
    stated : StatedBound, optional
        The bound.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    names = list(stated.last.names)[:MOST_PANELS] if stated is not None else []
    rows = -(-len(names) // COLUMNS)
    listed = min(len(found.model.unknowns), MOST_NAMES)
    top = max(2.4, 0.24 * listed + 1.0)
    gains = 0.35 * len(stated.gains) + 1.8 if stated is not None else 0.0
    heights = [top, *[2.6] * rows, *([gains] if gains else [])]
    figure = Figure(figsize=(11.0, sum(heights) + 0.6), layout="constrained")
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    ranks, unknowns = parts[0].subplots(1, 2)
    _rank_panel(ranks, found)
    _unknown_panel(unknowns, found)
    if stated is not None:
        for part, first in zip(parts[1:-1], range(0, len(names), COLUMNS), strict=True):
            row = part.subplots(1, COLUMNS)
            for axes, name in zip_longest(row, names[first : first + COLUMNS]):
                if name is None:
                    axes.set_axis_off()
                else:
                    _bound_panel(axes, stated, name)
            row[0].set_ylabel("standard deviation", fontsize="small")
        _gain_panel(parts[-1].subplots(), stated)
    figure.suptitle(found.model.name, fontsize="large")
    return figure


def _rank_panel(axes: Axes, found: ModelAnalysis) -> None:
    ranks = found.exact.ranks
    axes.plot(range(len(ranks)), ranks, "o-", color=BLUE, label="rank")
    axes.axhline(found.dimension, color=GREY, linestyle="--", label="unknowns")
    axes.set(
        xlabel="samples" if found.model.discrete else "order of derivatives", ylim=(0, found.dimension + 0.5)
    )
    for each in (axes.xaxis, axes.yaxis):
        each.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="lower right", frameon=False)
    tidy(axes)


def _unknown_panel(axes: Axes, found: ModelAnalysis) -> None:
    """A mark for each unknown: observable, or not."""
    seen = list(found.observable.items())
    shown = seen[:MOST_NAMES]
    for words, colour, marker, wanted in (
        ("observable", GREEN, "o", True),
        ("not observable", RED, "x", False),
    ):
        rows = [k for k, (_, each) in enumerate(shown) if each is wanted]
        axes.plot([0.0] * len(rows), rows, marker, color=colour, label=words)
    for k, (name, each) in enumerate(shown):
        words = axes.text(0.1, k, name if each else f"{name}: not observable", va="center", fontsize="small")
        words.set_in_layout(False)
    rest = f", {len(seen) - len(shown)} more are in the text" if len(seen) > len(shown) else ""
    axes.set(xlim=(-0.2, 3), ylim=(max(len(shown), 1) - 0.5, -0.5), title=f"unknowns{rest}")
    axes.set_axis_off()


def _bound_panel(axes: Axes, stated: StatedBound, name: str) -> None:
    """Bound of one unknown through all flights, end to end, with its prior."""
    passed, lowest = 0.0, np.inf
    for flight, each in stated.bounds.items():
        time = each.experiment.times - each.experiment.times[0] + passed
        std = each.std[:, each.names.index(name)]
        axes.semilogy(time, np.where(np.isfinite(std), std, np.nan), color=BLUE)
        lowest = min(lowest, std[1:].min())  # known initial values lie far below
        if passed:
            axes.axvline(passed, color=GREY, linewidth=0.6)
        if flight:
            axes.annotate(flight, (time[0], 0.02), xycoords=("data", "axes fraction"), fontsize="x-small")
        passed = float(time[-1])
    prior = stated.last.priors.get(name)
    if prior is not None:
        axes.axhline(prior, color=GREY, linestyle="--", linewidth=0.9, label="prior")
        axes.legend(loc="best", frameon=False, fontsize="x-small")
    axes.set(xlim=(-0.02 * passed, 1.02 * passed), ylim=(lowest / 1.5 if np.isfinite(lowest) else None, None))
    if not np.isfinite(stated.last.final[name]):
        axes.text(
            0.5, 0.5, "not determined", transform=axes.transAxes, ha="center", color=RED, fontsize="small"
        )
    axes.set_title(name, fontsize="small")
    axes.set_xlabel("samples" if stated.last.experiment.model.discrete else "time [s]", fontsize="small")
    axes.tick_params(which="both", labelsize="small")
    axes.yaxis.set_minor_formatter(NullFormatter())
    if np.ptp(np.log10(axes.get_ylim())) < 1.2:  # with no whole power of ten
        axes.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:.2g}"))
        axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.2g}"))
    tidy(axes)


def _gain_panel(axes: Axes, stated: StatedBound) -> None:
    """Standard deviations without over with each sensor or manoeuvre."""
    table = np.array([list(row.values()) for row in stated.gains.values()])
    shown = np.clip(np.where(np.isfinite(table), table, LARGEST_GAIN), 1.0, LARGEST_GAIN)
    mesh = axes.imshow(shown, aspect="auto", norm=LogNorm(1.0, LARGEST_GAIN), cmap="Blues")
    for row, values in enumerate(table):
        for column, gain in enumerate(values):
            words = f"{gain:.3g}" if 0 < gain < np.inf else "alone" if gain else "lost"
            colour = RED if gain < 1 / 1.05 else "white" if shown[row, column] > 30 else "black"
            axes.text(column, row, words, ha="center", va="center", fontsize="x-small", color=colour)
    axes.set_xticks(range(table.shape[1]), stated.last.names, fontsize="small", rotation=30)
    axes.set_yticks(range(table.shape[0]), list(stated.gains), fontsize="small")
    axes.set_title("gain: standard deviation without over with the sensor or manoeuvre", fontsize="small")
    axes.figure.colorbar(mesh, ax=axes, fraction=0.03)
