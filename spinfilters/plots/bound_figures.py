"""Figures of observability and Cramer-Rao bounds."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from observability.analysis_report import Report
from observability.bounds.quantities import BLOCK_NAMES, EACH_MOMENT, MOMENTS, PLACE, Quantity
from observability.certificate import Certificate
from observability.study import BoundStudy, Curve
from spinfilters.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, tidy

COLOURS: Final = dict(
    zip(
        (*BLOCK_NAMES.values(), PLACE, MOMENTS, EACH_MOMENT),
        (BLUE, RED, GREEN, PURPLE, ORANGE, SKY, GREY),
        strict=True,
    )
)
"""Of every quantity, whichever others are there."""
TITLE_WIDTH: Final = 110
"""Letters of a line of a title."""
BRIGHT: Final = 0.6
"""Share of the colour scale from which dark ink is read more easily."""


def observability_figure(found: Report, title: str) -> Figure:
    """Ranks by order with the verdict, beside the Cramer-Rao bound of every quantity over time, s."""
    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    panels = figure.subplot_mosaic([["names", "names"], ["ranks", "bounds"]], height_ratios=(0.14, 1.0))
    names, ranks, bounds = (panels[name] for name in ("names", "ranks", "bounds"))
    names.set_axis_off()
    _rank_panel(ranks, found.certificate)
    _bound_panel(bounds, found)
    handles, labels = bounds.get_legend_handles_labels()
    names.legend(handles, labels, loc="center", ncols=3, frameon=False, fontsize="small")
    figure.suptitle("\n".join(_wrapped([title], TITLE_WIDTH)), fontsize="large")
    figure.supxlabel("\n".join(_wrapped(found.rank_sentences)), fontsize="small", x=0.02, ha="left")
    return figure


def study_figure(study: BoundStudy, title: str) -> Figure:
    """Bound against duration, frame rate, landmarks, and as a map over the direction of the rate."""
    panels = len(study.curves) + 1
    figure = Figure(figsize=(11.0, 8.4 if panels > 2 else 4.4), layout="constrained")
    axes = figure.subplots(2 if panels > 2 else 1, 2).ravel()
    for each, curve in zip(axes, study.curves, strict=False):
        _curve_panel(each, curve)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    _motion_panel(figure, axes[len(study.curves)], study)
    for unused in axes[panels:]:
        unused.set_axis_off()
    figure.suptitle("\n".join(_wrapped([title], TITLE_WIDTH)), fontsize="large")
    return figure


def _bound_panel(axes: Axes, found: Report) -> None:
    """Bounds over time; gauge-fixed first values do not stretch the scale."""
    for quantity, values in found.quantities.items():
        axes.semilogy(found.reference.time, values, **(_style(quantity) | _prior_note(found, quantity)))
    learnt = [values[1:].min(initial=values[-1]) for values in found.quantities.values()]
    axes.set(xlabel="time [s]", ylabel="Cramer-Rao bound, standard deviation", ylim=(min(learnt) / 3, None))
    tidy(axes)


def _style(quantity: Quantity) -> dict[str, str]:
    """Line style; dashes where two quantities may coincide."""
    name, unit = quantity
    return {
        "color": COLOURS[quantity],
        "linestyle": "--" if quantity == PLACE else "-",
        "label": name if unit == "1" else f"{name} [{unit}]",
    }


def _prior_note(found: Report, quantity: Quantity) -> dict[str, str]:
    """A label that says where a curve shows the prior."""
    each, label = found.verdicts[quantity], _style(quantity)["label"]
    count = len(each.prior_directions)
    if not count:
        return {"label": label}
    part = "prior only" if count == each.dimension else f"prior only in {count} of {each.dimension}"
    return {"label": f"{label} ({part})"}


def _rank_panel(axes: Axes, certificate: Certificate) -> None:
    shown = certificate.ranks[: certificate.order + 3]
    axes.set_axisbelow(True)
    axes.bar(range(len(shown)), shown, color=BLUE, width=0.7)
    axes.axhline(certificate.dimension, color=BLACK, linewidth=1.0, linestyle="--")
    axes.annotate(
        f"{certificate.dimension} unknowns",
        (len(shown) - 0.6, certificate.dimension),
        (0, 4),
        textcoords="offset points",
        ha="right",
    )
    for order, rank in enumerate(shown):
        axes.annotate(str(rank), (order, rank), (0, 2), textcoords="offset points", ha="center")
    axes.set(
        xlabel="highest derivative of the outputs",
        ylabel="exact rank",
        ylim=(0, 1.15 * certificate.dimension),
    )
    axes.set_xticks(range(len(shown)))
    tidy(axes)


def _wrapped(lines: list[str], width: int = 150) -> list[str]:
    wrapped = []
    for line in lines:
        while len(line) > width:
            cut = line.rfind(" ", 0, width)
            wrapped.append(line[:cut])
            line = line[cut + 1 :]
        wrapped.append(line)
    return wrapped


def _curve_panel(axes: Axes, curve: Curve) -> None:
    for quantity, values in curve.std.items():
        axes.loglog(curve.choices, values, marker="o", markersize=3.5, **_style(quantity))
    axes.set(xlabel=curve.label, ylabel="bound after the last frame")
    axes.set_xticks(curve.choices, [f"{choice:g}" for choice in curve.choices], minor=False)
    axes.minorticks_off()
    tidy(axes)


def _motion_panel(figure: Figure, axes: Axes, study: BoundStudy) -> None:
    values = np.clip(study.moments, 1e-12, None)
    norm = LogNorm(values.min(), max(values.max(), 1.001 * values.min()))
    edges = np.arange(len(study.tilts) + 1) - 0.5
    picture = axes.pcolormesh(edges, edges, values, norm=norm, cmap="cividis")
    axes.set_xticks(range(len(study.turns)), [f"{angle:g}" for angle in study.turns], fontsize="small")
    axes.set_yticks(range(len(study.tilts)), [f"{angle:g}" for angle in study.tilts], fontsize="small")
    axes.set(
        xlabel="turned from the intermediate (0) to the major axis (90) [deg]",
        ylabel="tilted from the minor axis [deg]",
    )
    axes.set_title("inertia ratios by the direction of the rate", loc="left", fontsize="medium")
    axes.tick_params(color=GREY)
    for (row, column), value in np.ndenumerate(values):
        ink = BLACK if norm(value) > BRIGHT else "white"
        axes.text(column, row, f"{value:.1g}", ha="center", va="center", fontsize="x-small", color=ink)
    figure.colorbar(picture, ax=axes, label="bound, standard deviation")
