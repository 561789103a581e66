"""Figures of the observability analyser: bounds of quantities, and conditioning against noise."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from observability.analysis_report import Report
from observability.bound_study import BoundStudy, Curve
from observability.certificate import Certificate
from observability.conditioning import (
    BEST_CONDITION,
    TIME_STEPS,
    CovarianceConditioning,
    best_time_step,
    condition_number,
    conditions_over,
    double_integrator_covariance,
)
from observability.cramer_rao import BLOCK_NAMES, EACH_MOMENT, MOMENTS, PLACE, Quantity
from observability.further_sensors import OTHER_AXES, FurtherSensors
from spinfilters.io.sensor_format import kind_called
from spinfilters.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, tidy

COLOURS: Final = dict(
    zip(
        (*BLOCK_NAMES.values(), PLACE, MOMENTS, EACH_MOMENT),
        (BLUE, RED, GREEN, PURPLE, BLACK, ORANGE, SKY, GREY),
        strict=True,
    )
)
"""Of every quantity, whichever others are there."""
TITLE_WIDTH: Final = 110
"""Letters of a line of a title."""
BRIGHT: Final = 0.6
"""Share of the colour scale from which dark ink is read more easily."""


def observability_figure(found: Report, title: str) -> Figure:
    """Ranks by order with the verdict, next to the Cramer-Rao bound of every quantity over time, s.

    Parameters
    ----------
    found : Report
        Result of the analysis.
    title : str
        Of the figure.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
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


def further_sensors_figure(found: FurtherSensors) -> Figure:
    """Bounds of each quantity with every further sensor, shaded by their gain over the set without it.

    Parameters
    ----------
    found : FurtherSensors
        The set, and each further sensor beside it.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    names, quantities = [each.kind for each in found.sensors], found.quantities
    gains = np.array([[each.gains.get(name, 1.0) for name in quantities] for each in found.sensors])
    gains = np.vstack([np.ones(len(quantities)), gains.reshape(-1, len(quantities))])
    figure = Figure(figsize=(11.0, 2.2 + 0.5 * len(gains)), layout="constrained")
    axes = figure.subplots()
    norm = LogNorm(1.0, max(2.0, float(gains.max())))
    mesh = axes.imshow(np.clip(gains, 1.0, None), aspect="auto", norm=norm, cmap="Blues")
    for row, each in enumerate((None, *found.sensors)):
        sensors = found.stated if each is None else each.after
        for column, name in enumerate(quantities):
            new = 0 if each is None else each.becomes_determined.get(name, 0)
            ink = GREEN if new else "white" if norm(gains[row, column]) > BRIGHT else BLACK
            words = found.cell(sensors, each, name)
            axes.text(column, row, words, ha="center", va="center", fontsize="small", color=ink)
    labels = [name if unit == "1" else f"{name} [{unit}]" for name, unit in quantities]
    axes.set_xticks(range(len(labels)), ["\n".join(wrap(label, 16)) for label in labels], fontsize="small")
    axes.set_yticks(range(len(gains)), ["none", *names])
    axes.set_ylabel("further sensor")
    beside = ", ".join(map(kind_called, found.stated.case.sensors))
    axes.set_title(
        f"Bound beside {beside}; green: determined with the sensor only", loc="left", fontsize="medium"
    )
    bar = figure.colorbar(mesh, ax=axes, label="gain: bound without over with the sensor")
    for place in (bar.ax.yaxis.set_major_formatter, bar.ax.yaxis.set_minor_formatter):
        place(FuncFormatter(lambda value, _: f"{value:.3g}"))
    if found.in_other_axes:
        figure.supxlabel(OTHER_AXES, fontsize="small", x=0.02, ha="left")
    return figure


def study_figure(study: BoundStudy, title: str) -> Figure:
    """Bound against duration, frame rate, landmarks, and as a map over the direction of the rate.

    Parameters
    ----------
    study : BoundStudy
        Bounds over the conditions.
    title : str
        Of the figure.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
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
        (0, 16),  # above the numbers of the bars that reach the line
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


LONGEST_STEP = 10.0
"""Of the full state, whose motion is integrated, s."""
UNITS_TOP: Final = 2e10
"""Of the panel of several units: its legend stands above the curves."""
BEST_IN_WORDS: Final = r"best at $\sqrt{3}/\alpha$: $7 + 4\sqrt{3}$ = 13.93"
ALPHAS: Final = (0.1, 1.0, 10.0)
ELLIPSES: Final = ((0.6, BLUE), (float(np.sqrt(3)), GREEN), (3.0, RED))
"""Time steps in s: shorter than the best one, best, longer."""


def conditioning_figure(
    rate: Float[np.ndarray, " 3"], time_step: float | None = None, alpha: float = 1.0
) -> Figure:
    """Condition number against time step, and one-sigma ellipses.

    Other units of velocity, and the full state at a body rate, rad/s.

    Parameters
    ----------
    rate : ndarray of float, shape (3,)
        Of the body, rad/s.
    time_step, alpha
        A time step, s, to mark, and a unit of velocity, 1/s.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(11.0, 8.4), layout="constrained")
    over_time, ellipses, units, whole = figure.subplots(2, 2).ravel()
    _condition_panel(over_time, (1.0,))
    over_time.set_title("double integrator (as Figure 4-6)", loc="left", fontsize="medium")
    _ellipse_panel(ellipses)
    _condition_panel(units, ALPHAS)
    units.set_ylim(top=UNITS_TOP)
    units.set_title(r"velocity in units of $\alpha$ (as Figure 4-8)", loc="left", fontsize="medium")
    _full_state_panel(whole, rate)
    if time_step is not None:
        _mark_asked((over_time, units, whole), time_step, alpha)
    return figure


def covariance_figure(found: Sequence[CovarianceConditioning]) -> Figure:
    """Condition number of every estimator's covariance over its epochs.

    Panels: in SI, in fixed units, in units of its own deviations.

    Parameters
    ----------
    found : sequence of CovarianceConditioning
        One for each estimator.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(11.0, 0.8 + 3.2 * len(found)), layout="constrained")
    panels = figure.subplots(len(found), 1, squeeze=False, sharex=True)[:, 0]
    for axes, each in zip(panels, found, strict=True):
        kinds = (
            (each.plain, BLUE, "-", "SI units"),
            (each.fixed, GREEN, "--", "one unit per block"),
            (each.jacobi, RED, ":", "every component's own deviation"),
        )
        for values, color, dash, label in kinds:
            axes.semilogy(
                each.time, np.where(np.isfinite(values), values, np.nan), dash, color=color, label=label
            )
        axes.set(ylabel="condition number")
        axes.set_title(f"covariance of {each.name}", loc="left", fontsize="medium")
        tidy(axes)
    panels[-1].set_xlabel("time [s]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _mark_asked(panels: Sequence[Axes], time_step: float, alpha: float) -> None:
    over_time, units, whole = panels
    for axes in (over_time, units, whole):
        label = f"asked: {time_step:.3g} s"
        axes.axvline(time_step, color=BLACK, linewidth=0.9, linestyle=":", zorder=1, label=label)
    curve = [condition_number(double_integrator_covariance(float(dt), alpha)) for dt in TIME_STEPS]
    units.loglog(
        TIME_STEPS, curve, color=BLACK, linewidth=1.2, linestyle="--", label=rf"asked: {alpha:.3g} s$^{{-1}}$"
    )
    value = condition_number(double_integrator_covariance(time_step, alpha))
    units.plot(time_step, value, "D", color=BLACK, markersize=6, label=f"at {time_step:.3g} s: {value:.4g}")
    for axes in panels:
        _legend(axes)


def _legend(axes: Axes) -> None:
    """Legend that hides the lines behind it."""
    axes.legend(edgecolor="none", framealpha=1.0, fontsize="small")


def _condition_panel(axes: Axes, alphas: Sequence[float]) -> None:
    for alpha, color in zip(
        alphas, (GREEN, BLUE, RED)[-len(alphas) :] if len(alphas) > 1 else (BLUE,), strict=True
    ):
        values = [condition_number(double_integrator_covariance(float(dt), alpha)) for dt in TIME_STEPS]
        axes.loglog(TIME_STEPS, values, color=color, label=rf"$\alpha$ = {alpha:g} s$^{{-1}}$")
        axes.plot(best_time_step(alpha), BEST_CONDITION, "o", color=color, markersize=5)
    axes.axhline(BEST_CONDITION, color=BLACK, linewidth=0.8, linestyle="--", label=BEST_IN_WORDS)
    axes.set(xlabel="time step [s]", ylabel="condition number", ylim=(5, 2e7))
    _legend(axes)
    tidy(axes)


def _ellipse_panel(axes: Axes) -> None:
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    for dt, color in ELLIPSES:
        ellipse = np.linalg.cholesky(double_integrator_covariance(dt)) @ circle
        axes.plot(*ellipse, color=color, label=f"{dt:.3g} s")
    axes.plot([-2, 2], [-2, 2], color=GREY, linewidth=0.8, linestyle="--", label="45 degrees")
    axes.set(xlabel="position", ylabel="velocity")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("one sigma after a time step (as Figure 4-7)", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)


def _full_state_panel(axes: Axes, rate: Float[np.ndarray, " 3"]) -> None:
    steps = TIME_STEPS[TIME_STEPS <= LONGEST_STEP]
    for turning, color, width in ((np.zeros(3), BLUE, 3.0), (rate, RED, 1.4)):
        plain, jacobi = conditions_over(steps, turning)
        speed = float(np.linalg.norm(turning))
        for values, dash, units in ((plain, "-", "SI units"), (jacobi, "--", "Jacobi scaling")):
            label = f"{units}, {speed:.2g} rad/s"
            axes.loglog(steps, values, color=color, linewidth=width, linestyle=dash, label=label)
    axes.set(xlabel="time step [s]", ylabel="condition number")
    axes.set_title("pose and velocities together", loc="left", fontsize="medium")
    _legend(axes)
    tidy(axes)
