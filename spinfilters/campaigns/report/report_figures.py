"""Pictures of a campaign's report."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from spinfilters.campaigns.report.statistics import CellSummary
from spinfilters.campaigns.schema import ERRORS
from spinfilters.campaigns.stated_errors import LARGEST
from spinfilters.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    SKY,
    EstimatorLine,
    estimator_lines,
    legend_below,
    tidy,
)

MOST_PANELS: Final = 9
MOST_CELLS: Final = 40
PARTS: Final = {
    ("ok", "right"): (GREEN, "ok, right"),
    ("ok", "wrong"): (RED, "ok, wrong"),
    ("degraded", "right"): (SKY, "degraded, right"),
    ("degraded", "wrong"): (ORANGE, "degraded, wrong"),
}
LABELS: Final = dict(zip(ERRORS, ("position", "attitude", "velocity", "rate"), strict=True))


def _panels(cells: Sequence[CellSummary], names: Sequence[str]) -> dict[str, list[CellSummary]]:
    """Cells with a NEES by the levels of factors, `MOST_PANELS` at most."""
    groups: dict[str, list[CellSummary]] = {}
    for cell in cells:
        if len(cell.over_time.mean):
            groups.setdefault(label_of(cell, names), []).append(cell)
    return dict(list(groups.items())[:MOST_PANELS])


def _draw_nees(axes: Axes, group: Sequence[CellSummary], lines: Mapping[str, EstimatorLine]) -> float:
    """Draw a panel's band and lines; how high it should reach."""
    over = max(group, key=lambda cell: len(cell.over_time.mean)).over_time
    axes.fill_between(over.time_s, over.low, over.high, color=GREEN, alpha=0.25, linewidth=0)
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    for cell in group:
        lines[cell.levels["estimator"]].draw(axes, cell.over_time.time_s, cell.over_time.mean)
    axes.set_xlabel("time [s]")
    tidy(axes)
    return max(float(np.quantile(cell.over_time.mean, 0.9)) * 1.3 for cell in group)


def nees_figure(cells: Sequence[CellSummary], varied: Sequence[str]) -> Figure | None:
    """Mean NEES over time with its band.

    A panel per combination of levels, a line per estimator; None without any NEES.
    """
    shown = _panels(cells, [name for name in varied if name != "estimator"])
    if not shown:
        return None
    across = min(3, len(shown))
    down = -(-len(shown) // across)
    figure = Figure(figsize=(4.2 * across + 0.8, 2.9 * down + 0.7), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False, sharex=False, sharey=True).ravel()
    names = list(dict.fromkeys(cell.levels["estimator"] for group in shown.values() for cell in group))
    lines = {line.name: line for line in estimator_lines(names)}
    highest = 2.0
    for axes, (label, group) in zip(panels, shown.items(), strict=False):
        highest = max(highest, _draw_nees(axes, group, lines))
        widest = min(group, key=lambda cell: len(cell.over_time.mean))
        axes.set_title(f"{label or 'all'}, {widest.runs} runs", fontsize="small")
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    panels[0].set_ylim(0.0, min(highest, 10.0))
    panels[0].set_ylabel("NEES / dof, mean over runs [-]")
    band = Patch(color=GREEN, alpha=0.25, label="95 % band of a consistent estimator")
    legend_below(figure, [*(line.handle for line in lines.values()), band])
    return figure


def bound_figure(cells: Sequence[CellSummary], varied: Sequence[str]) -> Figure | None:
    """Error over the Cramer-Rao bound with its interval.

    A row per cell; None where no cell has a bound.
    """
    shown = [cell for cell in cells if any(cell.over_bound[name].count for name in ERRORS)][:MOST_CELLS]
    if not shown:
        return None
    figure = Figure(figsize=(11.0, 1.2 + 0.26 * len(shown)), layout="constrained")
    panels = figure.subplots(1, len(ERRORS), sharey=True, squeeze=False).ravel()
    places = np.arange(len(shown))[::-1]
    for axes, name in zip(panels, ERRORS, strict=True):
        found = [cell.over_bound[name] for cell in shown]
        value = np.array([each.value for each in found])
        width = np.array([[each.value - each.low, each.high - each.value] for each in found]).T
        axes.axvline(1.0, color=GREY, linewidth=0.8)
        axes.errorbar(
            value, places, xerr=np.nan_to_num(np.abs(width)), fmt="o", color=BLUE, markersize=4, linewidth=1.2
        )
        axes.set_title(LABELS[name], fontsize="small")
        axes.set_xlabel("rms error / bound [-]")
        if np.nanmax(value, initial=1.0) > 10:
            axes.set_xscale("log")
        tidy(axes)
    panels[0].set_yticks(places, [label_of(cell, varied) or "all" for cell in shown], fontsize="x-small")
    panels[0].set_ylim(-0.7, len(shown) - 0.3)
    return figure


def verdict_figure(cells: Sequence[CellSummary], varied: Sequence[str]) -> Figure:
    """Shares of verdicts and of correct estimates, one bar per cell."""
    shown = cells[:MOST_CELLS]
    figure = Figure(figsize=(9.0, 1.3 + 0.26 * len(shown)), layout="constrained")
    axes = figure.subplots()
    places, left = np.arange(len(shown))[::-1], np.zeros(len(shown))
    for key, (colour, label) in PARTS.items():
        share = np.array([cell.verdicts.get(key, 0) / cell.runs for cell in shown])
        axes.barh(places, share, left=left, color=colour, label=label, height=0.75)
        left += share
    axes.barh(places, 1.0 - left, left=left, color="0.75", label="failed, or no result", height=0.75)
    axes.set_yticks(places, [label_of(cell, varied) or "all" for cell in shown], fontsize="x-small")
    axes.set(
        xlim=(0, 1),
        ylim=(-0.7, len(shown) - 0.3),
        xlabel=f"share of runs [-]; right: within {LARGEST:g} deviations",
    )
    tidy(axes)
    figure.legend(loc="outside lower center", ncols=5, fontsize="small", frameon=False)
    return figure


def label_of(cell: CellSummary, varied: Sequence[str]) -> str:
    """Label of a cell by its levels that vary."""
    words = ", ".join(
        cell.levels[name] if "." not in name else f"{name} {cell.levels[name]}" for name in varied
    )
    return words.replace("$", r"\$")  # no formula
