"""Figures of the inertia, and the summary of a run on one page."""

from collections.abc import Sequence
from textwrap import wrap
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from spinfilters.evaluation.epoch_spans import (
    ObservationUse,
    initialisation_end,
    observation_use,
    shared_begin,
    title_sentences,
)
from spinfilters.evaluation.estimated_motion import (
    BodyRates,
    body_history,
    count_flips,
    estimated_rates,
    knows_intermediate_axis,
)
from spinfilters.evaluation.estimator_evaluation import Evaluation, not_failed, without_calibration
from spinfilters.models.body import BodyHistory
from spinfilters.models.status import Verdict
from spinfilters.plots.style import (
    AXIS_COLOURS,
    BLACK,
    GREY,
    INITIALISATION,
    MOST_DRAWN,
    PRINCIPAL_NAMES,
    SIGMAS,
    EstimatorLine,
    estimator_lines,
    extremes,
    fill_band,
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
    """Both ratios with +-3 sigma for every estimator, truth (any scale and order) dashed; next to them what estimators differ by.

    Parameters
    ----------
    evaluations : sequence of Evaluation
        Of the estimators, in the order of the table.
    true_moments : ndarray of float, shape (3,) or None
        In any scale and order; None where they are unknown.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    several = len(evaluations) > 1
    figure = Figure(figsize=(14.0 if several else 10.0, 6.4), layout="constrained")
    columns = figure.subplots(2, 1 + several, sharex=True, squeeze=False)
    panels = columns[:, 0]
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
        axes.set_title(f"ratio {RATIO_LABELS[index]}", loc="left", fontsize="medium")
        axes.set_ylabel(f"{RATIO_LABELS[index]}  [-]")
        tidy(axes)
    for index in range(2 if several else 0):
        _ratio_differences(columns[index, 1], histories, lines, index)
        mark_start(columns[index, 1], time[0], end_of_initialisation)
    for axes in columns[-1]:
        axes.set_xlabel("time [s]")
    first = evaluations[0]
    at_end = f"{' : '.join(first.moment_texts)} : 1  ({first.name.upper()} at the end, 1 σ)"
    figure.suptitle(f"Principal moments of inertia: {at_end}", fontsize="large")
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


def _ratio_differences(
    axes: Axes, histories: Sequence[BodyHistory], lines: Sequence[EstimatorLine], index: int
) -> None:
    """What all estimators but the last differ by from the last, whose deviations are the band: curves that coincide show here."""
    last, name = histories[-1], lines[-1].name.upper()
    half = SIGMAS * last.principal_moments_std[:, index]
    lines[-1].fill(axes, last.time, np.zeros_like(half), half)
    reach = [finite_quantile(half, 0.5)]
    for bodies, line in zip(histories[:-1], lines, strict=False):
        time, rows, own = np.intersect1d(bodies.time, last.time, return_indices=True)
        apart = bodies.principal_moments[rows, index] - last.principal_moments[own, index]
        line.draw(axes, time, apart)
        reach.append(finite_quantile(np.abs(apart), 0.9))
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    limit = 1.3 * max(reach)
    axes.set_ylim(*((-limit, limit) if limit > 0 else (-1.0, 1.0)))
    axes.set_title(f"ratio {RATIO_LABELS[index]}, less {name}", loc="left", fontsize="medium")
    axes.set_ylabel("difference [-]")
    tidy(axes)


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


FOOTER_WIDTH, HEADLINE_WIDTH = 160, 105
"""Characters of a line below the panels, and of the bold one above them."""
LONGEST_NAME = 10
"""Characters of an estimator's name that leave the panels with bars their full width."""


def summary_figure(
    evaluations: Sequence[Evaluation],
    reference: BodyRates | None = None,
    true_moments: Float[np.ndarray, "3"] | None = None,
    conditions: Sequence[str] = (),
) -> Figure:
    """Summary of a run in four panels.

    Rates of the first estimator, inertia of all, their errors or uncertainties over time, and what they used.

    Parameters
    ----------
    evaluations : sequence of Evaluation
        Of the estimators, in the order of the table.
    reference : BodyRates or None
        True or measured rates in the estimate's axes g.
    true_moments : ndarray of float, shape (3,) or None
        Any scale and order.
    conditions : sequence of str
        Sentences on the map, the noise and the seed.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(13.0, 8.2), layout="constrained")
    grid = figure.add_gridspec(2, 3, width_ratios=(1.6, 1.6, 1.3))
    rates, inertia = figure.add_subplot(grid[0, :2]), figure.add_subplot(grid[0, 2])
    lines = estimator_lines([evaluation.name for evaluation in evaluations])
    _rates_panel(rates, evaluations[0], reference)
    _inertia_panel(inertia, evaluations, lines, true_moments)
    left, right = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    _attitude_panel(left, evaluations, lines)
    _other_panel(right, evaluations, lines)
    cell = grid[1, 2].subgridspec(2, 1)
    _use_panel(figure.add_subplot(cell[0]), evaluations, lines)
    _runtime_panel(figure.add_subplot(cell[1]), evaluations, lines)
    for axes in (rates, left, right):
        mark_start(axes, evaluations[0].history.time[0], initialisation_end(evaluations))
        axes.set_xlabel("time [s]")
    _name_initialisation(rates, evaluations)
    figure.supxlabel("\n".join(_footer(evaluations, conditions)), fontsize="medium", x=0.01, ha="left")
    title = headline(evaluations)
    if len(title) > HEADLINE_WIDTH:
        title = title.replace(", moments", ",\nmoments")
    figure.suptitle(title, fontsize="large", fontweight="bold")
    return figure


def headline(evaluations: Sequence[Evaluation]) -> str:
    """Sentence on how the body spins, by the first estimator not failed.

    Parameters
    ----------
    evaluations : sequence of Evaluation
        Of the estimators, in the order of the table.

    Returns
    -------
    str
        The sentence.
    """
    standing = not_failed(evaluations)
    if not standing:
        return "Every estimator failed: the motion of the body is unknown"
    evaluation = standing[0]
    rates, body = estimated_rates(evaluation.history), evaluation.body
    speed = np.linalg.norm(rates.rate, axis=1) * 30.0 / np.pi
    if not np.isfinite([*speed, *body.principal_moments]).all():
        return f"The estimate of {evaluation.name.upper()} is not finite"
    moments = " : ".join(evaluation.moment_texts)
    duration = rates.time[-1] - rates.time[0]
    doubt = (
        "" if evaluation.history.status.verdict is Verdict.OK else f" ({evaluation.name.upper()}, degraded)"
    )
    return f"Spins at {np.median(speed):.3g} rpm, {_flips(evaluation)}{duration:.3g} s, moments of inertia {moments} : 1{doubt}"


def _flips(evaluation: Evaluation) -> str:
    """Number of flips in words, empty without a known axis."""
    body = evaluation.body
    if not knows_intermediate_axis(body):
        return "seen for "
    count = count_flips(estimated_rates(evaluation.history).in_axes(body.principal_axes_g).rate)
    return f"{count or 'no'} flip{'s' * (count > 1)} about the intermediate axis in "


def _rates_panel(axes: Axes, evaluation: Evaluation, reference: BodyRates | None) -> None:
    principal = evaluation.body.principal_axes_g
    rates = estimated_rates(evaluation.history).in_axes(principal)
    assert rates.std is not None
    true = None if reference is None else reference.in_axes(principal)
    for k, (name, colour) in enumerate(zip(PRINCIPAL_NAMES, AXIS_COLOURS, strict=True)):
        value, band = np.rad2deg(rates.rate[:, k]), SIGMAS * np.rad2deg(rates.std[:, k])
        fill_band(axes, rates.time, value, band, colour)
        rows = extremes(value)
        axes.plot(rates.time[rows], value[rows], color=colour, linewidth=1.8, label=f"{name} axis")
        if true is not None:
            plot_truth(axes, true.time, np.rad2deg(true.rate[:, k]))
    if reference is not None:
        axes.plot([], [], color=BLACK, linestyle=(0, (2, 1.5)), linewidth=1.3, label=reference.label)
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    axes.set(ylabel="rate [deg/s]")
    axes.set_title(
        f"rate about the principal axes ({evaluation.name.upper()})", loc="left", fontsize="medium"
    )
    tidy(axes)
    axes.legend(ncols=4, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.99), fontsize="small")


def _inertia_panel(
    axes: Axes, evaluations: Sequence[Evaluation], lines: list[EstimatorLine], true: np.ndarray | None
) -> None:
    count = len(evaluations)
    for k, (evaluation, line) in enumerate(zip(evaluations, lines, strict=True)):
        body = evaluation.body
        axes.errorbar(
            np.arange(2) + 0.18 * (k - (count - 1) / 2),
            body.principal_moments[:2],
            SIGMAS * body.principal_moments_std[:2],
            fmt="o",
            color=line.color,
            capsize=4,
            label=evaluation.name.upper(),
        )
    if true is not None:
        ratios = np.sort(true)[:2] / np.max(true)
        axes.hlines(
            ratios, [-0.3, 0.7], [0.3, 1.3], color=BLACK, linestyle="--", linewidth=1.3, label="truth"
        )
    axes.set_xticks([0, 1], RATIO_LABELS)
    axes.set_xlim(-0.5, 1.5)
    axes.set_ylabel("ratio [-]")
    axes.set_title(f"inertia at the end, ±{SIGMAS:g} σ", loc="left", fontsize="medium")
    tidy(axes)
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.09)}
    axes.legend(
        frameon=False, fontsize="small", ncols=2 if count > 3 else count + 1, columnspacing=1.0, **below
    )


class _Magnitude(NamedTuple):
    """Lengths of the standard deviation, and of the error where there is a truth."""

    std: Float[np.ndarray, " n"]
    error: Float[np.ndarray, " k"] | None


def _attitude_panel(axes: Axes, evaluations: Sequence[Evaluation], lines: list[EstimatorLine]) -> None:
    curves = []
    for evaluation in evaluations:
        std = np.rad2deg(np.linalg.norm(evaluation.trajectory.std_attitude, axis=1))
        error = None if evaluation.errors is None else np.rad2deg(_length(evaluation.errors.attitude))
        curves.append(_Magnitude(std, error))
    _magnitudes(axes, evaluations, lines, curves, "attitude", "deg")


def _other_panel(axes: Axes, evaluations: Sequence[Evaluation], lines: list[EstimatorLine]) -> None:
    """Position, or the rate where no position is seen."""
    sees = all(evaluation.history.layout.translates for evaluation in evaluations)
    curves = []
    for evaluation in evaluations:
        trajectory, errors = evaluation.trajectory, evaluation.errors
        std = 1e3 * trajectory.std_position if sees else np.rad2deg(trajectory.std_rate)
        error = None
        if errors is not None:
            error = _length(np.rad2deg(errors.rate) if errors.position is None else 1e3 * errors.position)
        curves.append(_Magnitude(_length(std), error))
    shown = ("centre of mass", "mm") if sees else ("rate in i", "deg/s")
    _magnitudes(axes, evaluations, lines, curves, *shown)


def _magnitudes(
    axes: Axes,
    evaluations: Sequence[Evaluation],
    lines: list[EstimatorLine],
    curves: list[_Magnitude],
    quantity: str,
    unit: str,
) -> None:
    """Length of the error with one standard deviation in black; without a truth the standard deviation alone."""
    for evaluation, line, (std, error) in zip(evaluations, lines, curves, strict=True):
        if error is None or evaluation.errors is None:
            line.draw(axes, evaluation.history.time, std)
            continue
        line.draw(axes, evaluation.errors.time, error)
        time, rows = evaluation.history.time, extremes(std)
        axes.plot(time[rows], std[rows], color=BLACK, linewidth=0.9, linestyle=line.dashes)
    known = curves[0][1] is not None
    handles = [*(line.handle for line in lines), *start_handle(initialisation_end(evaluations))]
    shown = [std if error is None else error for std, error in curves]
    top = max(finite_quantile(each, 0.98) for each in shown)
    # single peaks stay below the legend, unless a filter's first epochs are far above all others
    peak = min(max(finite_quantile(each, 1.0) for each in shown), 1.5 * top)
    below_legend = 0.96 - 0.065 * -(-len(handles) // 2)
    axes.set_ylim(0.0, max(1.6 * top, peak / max(below_legend, 0.3)) if top > 0 else 1.0)
    title = "length of the error (black: 1 σ)" if known else "uncertainty, 1 σ"
    axes.set_title(f"{quantity}: {title}", loc="left", fontsize="medium")
    axes.set_ylabel(f"{quantity} [{unit}]")
    axes.legend(handles=handles, frameon=False, fontsize="small", ncols=2, loc="upper right")
    tidy(axes)


def _runtime_panel(axes: Axes, evaluations: Sequence[Evaluation], lines: list[EstimatorLine]) -> None:
    runtimes = [evaluation.milliseconds_per_frame or 0.0 for evaluation in evaluations]
    names = [evaluation.name.upper() for evaluation in evaluations]
    bars = axes.barh(names, runtimes, color=[line.color for line in lines], height=0.5)
    axes.bar_label(bars, [f"{runtime:.3g} ms" for runtime in runtimes], padding=4)
    axes.set_xlim(0.0, 1.4 * max(*runtimes, 1e-9))
    axes.invert_yaxis()
    axes.set_xlabel("[ms]")
    _title_bars(axes, "processor time per epoch, median", names)
    tidy(axes)


def _use_panel(axes: Axes, evaluations: Sequence[Evaluation], lines: list[EstimatorLine]) -> None:
    """Panel of the used observations, over the epochs common to all."""
    begin, names = shared_begin(evaluations), [evaluation.name.upper() for evaluation in evaluations]
    uses = [observation_use(evaluation.history, begin) for evaluation in evaluations]
    used = [0.0 if use is None else use.used_per_epoch for use in uses]
    there = [0.0 if use is None else use.available_per_epoch or 0.0 for use in uses]
    ends = [max(pair) for pair in zip(used, there, strict=True)]
    measured = axes.barh(names, ends, color=GREY, alpha=0.3, height=0.5)
    axes.barh(names, used, color=[line.color for line in lines], height=0.5)
    size, room = ("small", 2.5) if _are_long(names) else ("medium", 2.2)
    axes.bar_label(measured, [_use_label(use) for use in uses], padding=4, fontsize=size)
    axes.set_xlim(0.0, room * max(*ends, 1e-9))
    axes.invert_yaxis()
    axes.set_xlabel("[1/epoch]")
    _title_bars(axes, "observations used (grey: measured)", names)
    tidy(axes)


def _title_bars(axes: Axes, title: str, names: Sequence[str]) -> None:
    """Title of a panel with a bar for each name; where long names leave it little width, above them, too."""
    axes.set_title(title, loc="right" if _are_long(names) else "left", fontsize="medium")


def _are_long(names: Sequence[str]) -> bool:
    return max(map(len, names)) > LONGEST_NAME


def _use_label(use: ObservationUse | None) -> str:
    if use is None:
        return "none"
    if use.share is None or use.available_per_epoch is None:
        return f"{use.used_per_epoch:.3g}"
    return f"{use.used_per_epoch:.3g} of {use.available_per_epoch:.3g} ({100 * use.share:.3g} %)"


def _name_initialisation(axes: Axes, evaluations: Sequence[Evaluation]) -> None:
    """Inside the shade, at its foot."""
    first, end = evaluations[0].history.time[0], initialisation_end(evaluations)
    if end is not None:
        place = {"transform": axes.get_xaxis_transform(), "ha": "center", "va": "bottom"}
        axes.text((first + end) / 2, 0.01, INITIALISATION, fontsize="small", color=GREY, **place)


def _footer(evaluations: Sequence[Evaluation], conditions: Sequence[str]) -> list[str]:
    """Footer on data and estimators; a dollar sign would begin a formula."""
    sentences = [*title_sentences(evaluations), " ".join(conditions)]
    return [line.replace("$", r"\$") for words in sentences for line in wrap(words, FOOTER_WIDTH)]


def _length(vectors: np.ndarray) -> Float[np.ndarray, " n"]:
    return np.linalg.norm(vectors, axis=1)
