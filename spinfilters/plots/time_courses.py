"""Figures over time: body rates, errors with bands, consistency, predictions, and kinetic energies.

A free body keeps its energies of rotation and of translation, so that a trend is a torque, a force or a wrong inertia.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from spinfilters.core.attitude_conversions import inverse, rotate
from spinfilters.core.errors import NUMERICAL_ERRORS
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.epoch_spans import initialisation_end, shared_begin
from spinfilters.evaluation.estimated_motion import (
    BodyRates,
    EnergyCourse,
    Trajectory,
    estimated_rates,
    quadratic_energy,
)
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.truth import Truth
from spinfilters.plots.style import (
    BLACK,
    GREEN,
    GREY,
    PRINCIPAL_NAMES,
    SIGMAS,
    EstimatorLine,
    estimator_lines,
    finite_quantile,
    half_width,
    legend_below,
    mark_start,
    plot_truth,
    random_handle,
    start_handle,
    tidy,
    truth_handle,
)

PRINCIPAL_AXES = tuple(f"about the {name} axis" for name in PRINCIPAL_NAMES)
"""Names of the axes of rates that were turned into principal axes (`BodyRates.in_axes`)."""
G_AXES = ("about x of g", "about y of g", "about z of g")
_MOST_MARKS = 400  # of a gyro: more would be a solid bar


def rates_figure(
    estimates: Sequence[BodyRates],
    reference: BodyRates | None = None,
    axis_names: Sequence[str] = G_AXES,
    end_of_initialisation: float | None = None,
) -> Figure:
    """Rates about three body axes, one panel each.

    All in the same axes. `end_of_initialisation` (s) ends the initialisation.

    Parameters
    ----------
    estimates : sequence of BodyRates
        One for each estimator.
    reference : BodyRates or None
        True or measured rates; None without any.
    axis_names : sequence of str
        Of the three panels.
    end_of_initialisation : float or None
        Its end, s; None without one.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    several = len(estimates) > 1
    figure = Figure(figsize=(14.0 if several else 10.0, 7.6), layout="constrained")
    columns = figure.subplots(3, 1 + several, sharex=True, squeeze=False)
    panels = columns[:, 0]
    lines = estimator_lines([estimate.label for estimate in estimates])
    for axis in range(3 if several else 0):
        _rate_differences(columns[axis, 1], estimates, lines, axis, axis_names[axis])
        mark_start(columns[axis, 1], estimates[0].time[0], end_of_initialisation)
    for axis, axes in enumerate(panels):
        if reference is not None:
            _reference(axes, reference, axis)
        for estimate, line in zip(estimates, lines, strict=True):
            _estimate(axes, estimate, axis, line)
        mark_start(axes, estimates[0].time[0], end_of_initialisation)
        axes.axhline(0.0, color=BLACK, linewidth=0.5)
        axes.set_title(axis_names[axis], loc="left", fontsize="medium")
        axes.set_ylabel("rate [deg/s]")
        tidy(axes)
    for axes in columns[-1]:
        axes.set_xlabel("time [s]")
    figure.suptitle(f"Body rates: {_speed(estimates[0])}", fontsize="large")
    handles = [line.handle for line in lines]
    known = []
    if reference is not None:
        known.append(
            Line2D([], [], linestyle="none", marker="o", markersize=3.2, color=BLACK, label=reference.label)
        )
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ")
    legend_below(figure, [*handles, band, *known, *start_handle(end_of_initialisation)])
    return figure


def _rate_differences(
    axes: Axes, estimates: Sequence[BodyRates], lines: Sequence[EstimatorLine], axis: int, name: str
) -> None:
    """What all estimates but the last differ by from the last, whose deviations are the band: curves that coincide show here."""
    last = estimates[-1]
    if last.std is not None:
        half = SIGMAS * np.rad2deg(last.std[:, axis])
        lines[-1].fill(axes, last.time, np.zeros_like(half), half)
    for estimate, line in zip(estimates[:-1], lines, strict=False):
        time, rows, own = np.intersect1d(estimate.time, last.time, return_indices=True)
        line.draw(axes, time, np.rad2deg(estimate.rate[rows, axis] - last.rate[own, axis]))
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    axes.set_title(f"{name}, less {last.label.upper()}", loc="left", fontsize="medium")
    axes.set_ylabel("difference [deg/s]")
    tidy(axes)


def _estimate(axes: Axes, rates: BodyRates, axis: int, line: EstimatorLine) -> None:
    value = np.rad2deg(rates.rate[:, axis])
    if rates.std is not None:
        line.fill(axes, rates.time, value, SIGMAS * np.rad2deg(rates.std[:, axis]))
    line.draw(axes, rates.time, value)


def _reference(axes: Axes, rates: BodyRates, axis: int) -> None:
    step = max(1, len(rates.time) // _MOST_MARKS)
    value = np.rad2deg(rates.rate[:, axis])
    axes.plot(
        rates.time[::step], value[::step], linestyle="none", marker="o", markersize=3.2, color=BLACK, zorder=1
    )


def _speed(rates: BodyRates) -> str:
    speed = np.linalg.norm(rates.rate, axis=1) * 30.0 / np.pi
    speed = speed[np.isfinite(speed)]
    if not speed.size:
        return "not finite"
    return f"{np.median(speed):.3g} rpm, between {speed.min():.3g} and {speed.max():.3g} rpm"


DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class _Row:
    """One row of panels, x, y and z.

    Values and standard deviations in the unit of the label.
    """

    label: str
    axis_names: tuple[str, str, str]
    values: Float[np.ndarray, "n 3"]
    std: Float[np.ndarray, "n 3"]
    about_zero: bool
    random: Float[np.ndarray, "n 3"] | None = None
    """Part of the standard deviations that is chance; None where that is all."""


def error_bands_figure(evaluation: Evaluation) -> Figure:
    """Position, attitude, velocity and rate errors (rows) by axis (columns) with +-3 sigma.

    Without a truth the estimates themselves, with the attitude's uncertainty about zero.

    Parameters
    ----------
    evaluation : Evaluation
        Of an estimator compared with a truth.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    rows = _rows(evaluation)
    time = evaluation.history.time if evaluation.errors is None else evaluation.errors.time
    end_of_initialisation = evaluation.history.initialisation_end
    figure = Figure(figsize=(11.0, 1.0 + 1.95 * len(rows)), layout="constrained")
    panels = figure.subplots(len(rows), 3, sharex=True, squeeze=False)
    line = replace(estimator_lines([evaluation.name])[0], width=1.3)
    for row, row_panels in zip(rows, panels, strict=True):
        for axis, axes in enumerate(row_panels):
            _panel(axes, time, row, axis, line)
            mark_start(axes, time[0], end_of_initialisation)
        row_panels[0].set_ylabel(row.label)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    what = "estimate" if evaluation.errors is None else "error"
    figure.suptitle(
        f"{evaluation.name.upper()}: {what} and its ±{SIGMAS:g} σ{_share_within_bands(rows, _is_own_epoch(evaluation, time))}",
        fontsize="large",
    )
    band = Patch(color=line.color, alpha=0.2, label=f"±{SIGMAS:g} σ of the estimator")
    parts = [] if rows[0].random is None else [random_handle()]
    legend_below(figure, [line.handle, band, *parts, *start_handle(end_of_initialisation)])
    return figure


def _rows(evaluation: Evaluation) -> list[_Row]:
    """Rows of panels, with the random part of the deviations where the calibration adds."""
    build = _estimate_rows if evaluation.errors is None else _error_rows
    rows, chance = build(evaluation, evaluation.trajectory), evaluation.random_trajectory
    if chance is None:
        return rows
    return [replace(row, random=part.std) for row, part in zip(rows, build(evaluation, chance), strict=True)]


def _panel(axes: Axes, time: np.ndarray, row: _Row, axis: int, line: EstimatorLine) -> None:
    value, band = row.values[:, axis], SIGMAS * row.std[:, axis]
    centre = np.zeros_like(value) if row.about_zero else value
    line.fill(axes, time, centre, band)
    if row.random is not None:
        line.edge(axes, time, centre, SIGMAS * row.random[:, axis])
    if value.any():
        line.draw(axes, time, value)
    if row.about_zero:
        axes.axhline(0.0, color="black", linewidth=0.5)
        width = half_width(value[:, np.newaxis], band[:, np.newaxis])
        axes.set_ylim(-width, width)
    quantity = row.label.split(" [")[0].removesuffix(" ±")
    axes.set_title(f"{quantity}, {row.axis_names[axis]}", fontsize="medium", loc="left")
    tidy(axes)


def _is_own_epoch(evaluation: Evaluation, time: np.ndarray) -> Bool[np.ndarray, " n"]:
    """Mask of times (s) that belong to the estimator's own epochs."""
    begin = evaluation.own_begin
    return np.zeros(len(time), dtype=bool) if begin is None else time >= begin


def _share_within_bands(rows: list[_Row], own: Bool[np.ndarray, " n"]) -> str:
    """Share of the estimator's own errors within the bands, in words; empty where none is known."""
    pairs = [(np.abs(row.values), SIGMAS * row.std) for row in rows if row.about_zero and row.values.any()]
    if len(pairs) < len(rows) or not own.any():
        return ""
    held = [own[:, np.newaxis] & np.isfinite(band) for _, band in pairs]
    if not all(chosen.any() for chosen in held):
        return ""
    share = np.mean(
        [np.mean((value <= band)[chosen]) for (value, band), chosen in zip(pairs, held, strict=True)]
    )
    return f", {100 * share:.1f} % inside in its own {np.count_nonzero(own)} epochs (99.7 % expected)"


def _error_rows(evaluation: Evaluation, trajectory: Trajectory) -> list[_Row]:
    errors = evaluation.errors
    assert errors is not None
    i_axes, g_axes = _names("i"), _names("g")
    kept = errors.rows
    quantities = [
        ("position [mm]", i_axes, errors.position, trajectory.std_position, 1e3),
        ("attitude [deg]", g_axes, errors.attitude, trajectory.std_attitude, DEGREES),
        ("velocity [mm/s]", i_axes, errors.velocity, trajectory.std_velocity, 1e3),
        ("rate in i [deg/s]", i_axes, errors.rate, trajectory.std_rate, DEGREES),
    ]
    return [
        _Row(label, names, scale * values, scale * std[kept], True)
        for label, names, values, std, scale in quantities
        if values is not None
    ]


def _estimate_rows(_: Evaluation, trajectory: Trajectory) -> list[_Row]:
    i_axes, nothing = _names("i"), np.zeros((len(trajectory.time), 3))
    attitude = _Row("attitude ± [deg]", _names("g"), nothing, DEGREES * trajectory.std_attitude, True)
    rate = _Row(
        "rate in i [deg/s]", i_axes, DEGREES * trajectory.rate_i, DEGREES * trajectory.std_rate, False
    )
    if not trajectory.sees_position:
        return [attitude, rate]
    position = _Row("position [m]", i_axes, trajectory.position, trajectory.std_position, False)
    velocity = _Row(
        "velocity [mm/s]", i_axes, 1e3 * trajectory.velocity, 1e3 * trajectory.std_velocity, False
    )
    return [position, attitude, velocity, rate]


def _names(frame: str) -> tuple[str, str, str]:
    return (f"x axis of {frame}", f"y axis of {frame}", f"z axis of {frame}")


_MOST_MARKS_OF_NIS = 120  # of one estimator: more would be a solid bar
_MOST_IN_A_LINE = 3  # means, after the words of a title


def consistency_figure(evaluations: Sequence[Evaluation]) -> Figure:
    """NIS per degree of freedom, and above it NEES where the true state is known.

    Parameters
    ----------
    evaluations : sequence of Evaluation
        Of the estimators, in the order of the table.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
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
    place = "" if initialisation_end(evaluations) is None else " after the initialisation"
    head = f"error of the whole state, {dof} dof; mean{place}:"
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
    """Mean time, summed NIS and dof of groups of epochs: innovations are white, so that a sum is chi-square too."""
    used = np.flatnonzero(history.dof > 0)
    window = -(-len(used) // _MOST_MARKS_OF_NIS)
    starts = np.arange(0, len(used), window)
    count = np.diff(np.append(starts, len(used)))
    time, nis, dof = (np.add.reduceat(a[used], starts) for a in (history.time, history.nis, history.dof))
    return time / count, nis, dof, window


PAST = 0.25
"""Of the time ahead: as much of what was estimated before is shown."""


@dataclass(frozen=True)
class PredictionCurves:
    """One estimator's last epochs and its prediction.

    The last of them stands at the head of both `ahead`s.

    Attributes
    ----------
    before, ahead : Trajectory
        Motion.
    rates_before, rates_ahead : BodyRates
        Body rates about principal axes; their label is the estimator's name.
    """

    before: Trajectory
    ahead: Trajectory
    rates_before: BodyRates
    rates_ahead: BodyRates


def prediction_figure(predicted_motions: Sequence[PredictionCurves]) -> Figure:
    """Standard deviations over the time ahead (left), and the rates themselves with 1 sigma (right).

    Parameters
    ----------
    predicted_motions : sequence of PredictionCurves
        One for each estimator.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
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
            line.draw(axes, _times_ahead(each, each.before.time), scale * before)
            line.draw(axes, _times_ahead(each, each.ahead.time), scale * ahead)
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
                value, time = np.rad2deg(rates.rate[:, axis]), _times_ahead(each, rates.time)
                if rates.std is not None:
                    line.fill(axes, time, value, np.rad2deg(rates.std[:, axis]))
                line.draw(axes, time, value)
        axes.set_title(f"body rate {PRINCIPAL_AXES[axis]}", loc="left", fontsize="medium")
        axes.set_ylabel("rate [deg/s]")
    panels[-1].set_xlabel("time ahead [s]")
    return panels


def _times_ahead(each: PredictionCurves, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return time - each.ahead.time[0]


def energy_figure(evaluations: Sequence[Evaluation], truth: Truth) -> Figure:
    """Energy of the rotation per unit of the largest moment, and of the translation per mass, with bands, and the true ones.

    Parameters
    ----------
    evaluations : sequence of Evaluation
        Of the estimators, in the order of the table.
    truth : Truth
        Of the run; its rotational energy is drawn where it has moments and axes.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    translates = all(each.history.layout.translates for each in evaluations)
    figure = Figure(figsize=(10.0, 6.6 if translates else 3.8), layout="constrained")
    panels = figure.subplots(1 + translates, 1, sharex=True, squeeze=False)[:, 0]
    lines = estimator_lines([each.name for each in evaluations])
    courses = [rotational_energy(each) for each in evaluations]
    _draw_energies(panels[0], courses, lines, *_true_rotational_energy(truth))
    panels[0].set_ylabel(r"energy / $J_{max}$  [rad$^2$/s$^2$]")
    panels[0].set_title(f"rotation{_changes(evaluations, courses)}", loc="left", fontsize="medium")
    if translates:
        speed = np.sum(truth.velocity**2, axis=1) / 2
        _draw_energies(
            panels[1],
            [translational_energy(each) for each in evaluations],
            lines,
            truth.time,
            1e6 * speed,
            1e6,
        )
        panels[1].set_ylabel("energy / mass  [uJ/kg]")
        panels[1].set_title("translation", loc="left", fontsize="medium")
    end = initialisation_end(evaluations)
    for axes in panels:
        mark_start(axes, evaluations[0].history.time[0], end)
        tidy(axes)
    panels[-1].set_xlabel("time [s]")
    figure.suptitle("Kinetic energy", fontsize="large")
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ of rate and velocity")
    legend_below(figure, [*(line.handle for line in lines), band, truth_handle(), *start_handle(end)])
    return figure


def rotational_energy(evaluation: Evaluation) -> EnergyCourse:
    """w' J w / 2 of the estimated rates with the inertia at the end, over its largest moment, (rad/s)^2.

    Parameters
    ----------
    evaluation : Evaluation
        Of an estimator.
    """
    rates, body = estimated_rates(evaluation.history), evaluation.body
    covariance = np.zeros((len(rates.time), 3, 3)) if rates.covariance is None else rates.covariance
    axes = body.principal_axes_g
    J = axes.T @ np.diag(body.principal_moments / body.principal_moments.max()) @ axes
    return quadratic_energy(rates.time, rates.rate, covariance, J)


def translational_energy(evaluation: Evaluation) -> EnergyCourse:
    """v' v / 2 of the estimated velocity of the centre of mass, J/kg.

    Parameters
    ----------
    evaluation : Evaluation
        Of an estimator that sees positions.
    """
    trajectory = evaluation.trajectory
    covariance = np.einsum("ni,ij->nij", trajectory.std_velocity**2, np.eye(3))
    return quadratic_energy(trajectory.time, trajectory.velocity, covariance, np.eye(3))


def _true_rotational_energy(truth: Truth) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Times and energies; none without moments and axes."""
    moments, axes = truth.principal_moments, truth.principal_axes_g
    if moments is None or axes is None:
        return np.empty(0), np.empty(0)
    about = rotate(inverse(truth.q_ig), truth.rate_i) @ axes.T
    return truth.time, about**2 @ (moments / moments.max()) / 2


def _draw_energies(
    axes: Axes,
    courses: Sequence[EnergyCourse],
    lines: Sequence[EstimatorLine],
    time: Float[np.ndarray, " k"],
    true: Float[np.ndarray, " k"],
    scale: float = 1.0,
) -> None:
    for course, line in zip(courses, lines, strict=True):
        line.fill(axes, course.time, scale * course.energy, SIGMAS * scale * course.std)
        line.draw(axes, course.time, scale * course.energy)
    if len(true):
        plot_truth(axes, time, true)
    # the first epochs of a filter may know nothing: most of the bands decide the limits
    drawn = [*(scale * course.energy for course in courses), true]
    low, high = (
        extreme(finite_quantile(each, share, np.nan) for each in drawn if len(each))
        for extreme, share in ((min, 0.02), (max, 0.98))
    )
    half = max(SIGMAS * scale * finite_quantile(course.std, 0.8) for course in courses)
    if np.isfinite([low, high, half]).all() and high - low + half > 0:
        axes.set_ylim(low - 1.2 * half, high + 1.2 * half)


def _changes(evaluations: Sequence[Evaluation], courses: Sequence[EnergyCourse]) -> str:
    """How much the energy of every estimator changes, of a straight line through its own epochs."""
    words = []
    for evaluation, course in zip(evaluations, courses, strict=True):
        begin = float(course.time[min(evaluation.history.initialisation, len(course.time) - 1)])
        try:
            change, _ = course.change(begin, float(course.time[-1]))
        except NUMERICAL_ERRORS:  # too few epochs for a line
            continue
        if np.isfinite(change):
            words.append(f"{evaluation.name.upper()} {100 * change:+.2g} %")
    return f": changes by {', '.join(words)}" if words else ""
