"""Figures of an estimate against a reference: values, differences, predictions, and surfaces that should coincide.

Values are as in Tweddle (2013), Figures 6-16 and 6-18, differences as in 6-17, 6-19 and 6-21. Predictions, and a race of several
inertias, follow from the last state.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from spinfilters.core.attitude_conversions import continuous_quaternions
from spinfilters.evaluation.prediction_errors import PredictionErrors, PropagatedInertia
from spinfilters.evaluation.reference_comparison import AttitudeCourse, Course, ReferenceComparison
from spinfilters.plots.style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    RED,
    SIGMAS,
    EstimatorLine,
    dot_handles,
    estimator_lines,
    extremes,
    half_width,
    legend_below,
    plot_truth,
    tidy,
    truth_handle,
)

DEGREES: Final = 180.0 / np.pi
_ENERGY_UNITS: Final = {
    "rotation": (1.0, r"over $J_{max}$  [rad$^2$/s$^2$]"),
    "translation": (1e6, "over mass  [uJ/kg]"),
}
_GAP = 3.0  # median intervals between rows from which on a curve is cut


def reference_values_figure(found: ReferenceComparison) -> Figure:
    """Estimate and reference over time: position, velocity, rate about the reference's axes, energies, attitude."""
    rows = [
        (label, course, scale, names)
        for label, course, scale, names in (
            ("position [m]", found.position, 1.0, _axes("in i")),
            ("velocity [mm/s]", found.velocity, 1e3, _axes("in i")),
            ("rate [deg/s]", found.rate_after, DEGREES, _axes("of the reference's body")),
        )
        if course is not None
    ]
    with_attitude = found.attitude_after is not None
    count = len(rows) + 1 + with_attitude
    figure = Figure(figsize=(11.0, 1.3 + 2.1 * count), layout="constrained")
    grid = figure.add_gridspec(count, 12)
    for k, (label, course, scale, names) in enumerate(rows):
        for axis in range(3):
            axes = figure.add_subplot(grid[k, 4 * axis : 4 * axis + 4])
            draw_course(axes, course.time, scale * course.reference[:, axis], RED, dots=True)
            draw_course(axes, course.time, scale * course.estimate[:, axis], BLUE)
            axes.set_title(f"{label.split(' [')[0]}, {names[axis]}", loc="left", fontsize="medium")
            if axis == 0:
                axes.set_ylabel(label)
            tidy(axes)
    width = 12 // len(found.energies)
    for k, (name, (own, theirs)) in enumerate(found.energies.items()):
        axes = figure.add_subplot(grid[len(rows), width * k : width * (k + 1)])
        scale, label = _ENERGY_UNITS[name]
        draw_course(axes, theirs.time, scale * theirs.energy, RED, dots=True)
        draw_course(axes, own.time, scale * own.energy, BLUE)
        axes.set_title(f"kinetic energy of the {name}", loc="left", fontsize="medium")
        axes.set_ylabel(label)
        tidy(axes)
    if found.attitude_after is not None:
        _quaternions(figure.add_subplot(grid[count - 1, :]), found.attitude_after)
    figure.axes[-1].set_xlabel("time [s]")
    figure.suptitle(f"{found.name.upper()} and the reference, in the same axes", fontsize="large")
    handles = [
        Line2D([], [], color=BLUE, label=found.name.upper()),
        Line2D([], [], color=RED, linestyle="none", marker=".", label="reference"),
    ]
    legend_below(figure, handles)
    return figure


def reference_differences_figure(found: ReferenceComparison) -> Figure:
    """Estimate minus reference: places, closest angle and rate, before and after the correction of the axes."""
    places = [
        (label, course, scale)
        for label, course, scale in (
            ("position [mm]", found.position, 1e3),
            ("velocity [mm/s]", found.velocity, 1e3),
        )
        if course is not None
    ]
    turns = found.attitude_before is not None and found.attitude_after is not None
    count = len(places) + 1 + turns
    figure = Figure(figsize=(11.0, 1.3 + 2.1 * count), layout="constrained")
    grid = figure.add_gridspec(count, 12)
    for k, (label, course, scale) in enumerate(places):
        for axis, name in enumerate(_axes("in i")):
            axes = figure.add_subplot(grid[k, 4 * axis : 4 * axis + 4])
            _difference(axes, course, axis, scale, BLUE)
            _finish(axes, f"{label.split(' [')[0]}, {name}", label if axis == 0 else "")
    for axis, name in enumerate(_axes("of the reference's body")):
        axes = figure.add_subplot(grid[len(places), 4 * axis : 4 * axis + 4])
        _difference(axes, found.rate_before, axis, DEGREES, ORANGE)
        _difference(axes, found.rate_after, axis, DEGREES, BLUE)
        _finish(axes, f"rate, {name}", "rate [deg/s]" if axis == 0 else "")
    if found.attitude_before is not None and found.attitude_after is not None:
        axes = figure.add_subplot(grid[count - 1, :])
        draw_course(axes, found.attitude_before.time, DEGREES * found.attitude_before.angle, ORANGE)
        draw_course(axes, found.attitude_after.time, DEGREES * found.attitude_after.angle, BLUE)
        axes.set_ylim(bottom=0.0)
        axes.set_title("closest angle between both attitudes", loc="left", fontsize="medium")
        axes.set_ylabel("angle [deg]")
        tidy(axes)
    figure.axes[-1].set_xlabel("time [s]")
    figure.suptitle(f"{found.name.upper()} minus reference", fontsize="large")
    handles = [
        Line2D([], [], color=ORANGE, label="axes only flipped"),
        Line2D([], [], color=BLUE, label="axes corrected by the fitted rotation"),
    ]
    legend_below(figure, handles)
    return figure


def place_courses_figure(found: ReferenceComparison, difference: bool) -> Figure:
    """Position and velocity of estimate and reference by axis, or their differences (Tweddle 2013, Figures 6-16 and 6-17)."""
    courses = {"position [mm]": found.position, "velocity [mm/s]": found.velocity}
    rows = {label: course for label, course in courses.items() if course is not None}
    figure = Figure(figsize=(11.0, 1.0 + 2.2 * max(len(rows), 1)), layout="constrained")
    grid = figure.subplots(max(len(rows), 1), 3, sharex=True, squeeze=False)
    for (label, course), panels in zip(rows.items(), grid, strict=False):
        for axis, axes in enumerate(panels):
            _course_panel(axes, course, axis, 1e3, difference)
            axes.set_title(f"{label.split()[0]} along {'xyz'[axis]} of i", loc="left", fontsize="medium")
        panels[0].set_ylabel(label)
    _finish_courses(figure, found, difference)
    return figure


def turn_courses_figure(found: ReferenceComparison, corrected: bool, difference: bool) -> Figure:
    """Body rates and attitude of estimate and reference, or their differences (Tweddle 2013, Figures 6-18 to 6-21).

    Parameters
    ----------
    found : ReferenceComparison
        What is drawn.
    corrected : bool
        Whether the axes are corrected by the fitted rotation, or only flipped.
    difference : bool
        Whether estimate minus reference is drawn, and the closest angle.
    """
    rate = found.rate_after if corrected else found.rate_before
    attitude = found.attitude_after if corrected else found.attitude_before
    rows = 1 + (attitude is not None)
    figure = Figure(figsize=(11.0, 1.0 + 2.2 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, 3)
    if attitude is not None and not difference:
        _quaternions(figure.add_subplot(grid[0, :]), attitude)
    row = 0 if difference else rows - 1
    for axis in range(3):
        axes = figure.add_subplot(grid[row, axis])
        _course_panel(axes, rate, axis, DEGREES, difference)
        axes.set_title(f"rate about {'xyz'[axis]} of the body", loc="left", fontsize="medium")
        if axis == 0:
            axes.set_ylabel("rate [deg/s]")
    if attitude is not None and difference:
        axes = figure.add_subplot(grid[1, :])
        draw_course(axes, attitude.time, DEGREES * attitude.angle, BLUE)
        axes.set_ylim(bottom=0.0)
        axes.set_title("closest angle between both attitudes", loc="left", fontsize="medium")
        axes.set_ylabel("angle [deg]")
        tidy(axes)
    _finish_courses(figure, found, difference)
    return figure


def _course_panel(axes: Axes, course: Course, axis: int, scale: float, difference: bool) -> None:
    if difference:
        _difference(axes, course, axis, scale, BLUE)
        axes.axhline(0.0, color=BLACK, linewidth=0.5)
    else:
        draw_course(axes, course.time, scale * course.reference[:, axis], RED, dots=True)
        draw_course(axes, course.time, scale * course.estimate[:, axis], BLUE)
    tidy(axes)


def _finish_courses(figure: Figure, found: ReferenceComparison, difference: bool) -> None:
    for axes in figure.axes[-3:]:
        axes.set_xlabel("time [s]")
    words = "minus the reference" if difference else "and the reference"
    figure.suptitle(f"{found.name.upper()} {words}", fontsize="large")
    handles = [Line2D([], [], color=BLUE, label="difference" if difference else found.name.upper())]
    if not difference:
        handles.append(Line2D([], [], color=RED, linestyle="none", marker=".", label="reference"))
    legend_below(figure, handles)


def draw_course(
    axes: Axes, time: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"], color: str, dots: bool = False
) -> None:
    """A curve that is cut where rows are missing."""
    if len(time) < 2:
        return
    dt = np.diff(time)
    after = np.flatnonzero(dt > _GAP * np.median(dt)) + 1
    time, values = np.insert(time, after, np.nan), np.insert(values, after, np.nan)
    if not after.size:
        rows = extremes(values)
        time, values = time[rows], values[rows]
    if dots:
        axes.plot(time, values, color=color, linestyle="none", marker=".", markersize=2.5)
    else:
        axes.plot(time, values, color=color, linewidth=1.1)


def _quaternions(axes: Axes, course: AttitudeCourse) -> None:
    together = continuous_quaternions(course.estimate)
    theirs = course.reference * np.sign(np.sum(together * course.reference, axis=1, keepdims=True))
    for k, (name, color) in enumerate(zip(("qx", "qy", "qz", "qw"), (*AXIS_COLOURS, BLACK), strict=True)):
        draw_course(axes, course.time, theirs[:, k], GREY, dots=True)
        draw_course(axes, course.time, together[:, k], color)
        axes.plot([], [], color=color, label=name)
    axes.set_title("attitude since the first row (reference grey)", loc="left", fontsize="medium")
    axes.set_ylabel("quaternion")
    axes.legend(frameon=False, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 0.98), fontsize="small")
    tidy(axes)


def _difference(axes: Axes, course: Course, axis: int, scale: float, color: str) -> None:
    draw_course(axes, course.time, scale * course.difference[:, axis], color)


def _finish(axes: Axes, name: str, label: str) -> None:
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    axes.set_title(name, loc="left", fontsize="medium")
    axes.set_ylabel(label)
    tidy(axes)


def _axes(of: str) -> Sequence[str]:
    return tuple(f"{axis} axis {of}" for axis in "xyz")


_PANELS: Final[Mapping[str, tuple[str, float, str]]] = {
    "position": ("position [mm]", 1e3, "i"),
    "attitude": ("attitude [deg]", np.rad2deg(1.0), "g"),
    "velocity": ("velocity [mm/s]", 1e3, "i"),
    "rate": ("rate [deg/s]", np.rad2deg(1.0), "i"),
}
"""Label, scale and axes of every quantity."""


def prediction_errors_figure(predicted: Mapping[str, PredictionErrors]) -> Figure:
    """Errors of every axis with their bands of 3 sigma, and below them the NEES with its band of 95 %.

    Parameters
    ----------
    predicted : mapping of str to PredictionErrors
        By the name of the estimator, at least one.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    names = [name for name in _PANELS if any(name in errors.courses for errors in predicted.values())]
    lines = estimator_lines(list(predicted))
    has_nees = any(errors.nees is not None for errors in predicted.values())
    count = len(names) + has_nees
    figure = Figure(figsize=(11.0, 1.0 + 1.95 * count), layout="constrained")
    grid = figure.add_gridspec(count, 3)
    for row, name in enumerate(names):
        label, scale, frame = _PANELS[name]
        for axis in range(3):
            axes = figure.add_subplot(grid[row, axis])
            _error_panel(axes, name, axis, scale, predicted, lines)
            axes.set_title(f"{name}, {'xyz'[axis]} axis of {frame}", loc="left", fontsize="medium")
            if axis == 0:
                axes.set_ylabel(label)
    if has_nees:
        _nees_panel(figure.add_subplot(grid[count - 1, :]), predicted, lines)
    for axes in figure.axes[-1 if has_nees else -3 :]:
        axes.set_xlabel("time ahead [s]")
    judges = " and ".join(dict.fromkeys(errors.judge for errors in predicted.values()))
    figure.suptitle(f"Prediction minus {judges}, ±{SIGMAS:g} σ as predicted", fontsize="large")
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ")
    limit = (
        [Line2D([], [], color=BLACK, linestyle=":", label="95 % of one prediction's NEES")]
        if has_nees
        else []
    )
    legend_below(figure, [*(line.handle for line in lines), band, *limit])
    return figure


def _error_panel(
    axes: Axes,
    name: str,
    axis: int,
    scale: float,
    predicted: Mapping[str, PredictionErrors],
    lines: Sequence[EstimatorLine],
) -> None:
    values, bands = [np.zeros(1)], [np.zeros(1)]
    for errors, line in zip(predicted.values(), lines, strict=True):
        if name not in errors.courses:
            continue
        course = errors.courses[name]
        value, band = scale * course.error[:, axis], SIGMAS * scale * course.std[:, axis]
        line.fill(axes, errors.ahead, np.zeros_like(value), band)
        line.draw(axes, errors.ahead, value)
        values.append(value)
        bands.append(band)
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    width = half_width(np.concatenate(values)[:, None], np.concatenate(bands)[:, None])
    axes.set_ylim(-width, width)
    tidy(axes)


def _nees_panel(
    axes: Axes, predicted: Mapping[str, PredictionErrors], lines: Sequence[EstimatorLine]
) -> None:
    limits = []
    for errors, line in zip(predicted.values(), lines, strict=True):
        ratio = errors.ratio
        if ratio is not None:
            line.draw(axes, errors.ahead, ratio)
            limits += errors.band
    for limit in dict.fromkeys(limits):
        axes.axhline(limit, color=BLACK, linestyle=":", linewidth=1.0)
    axes.set_title("NEES of the whole error, 1 expected", loc="left", fontsize="medium")
    axes.set_ylabel("NEES per dof")
    axes.set_ylim(bottom=0.0)
    tidy(axes)


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


THICKNESS: Final = 0.04
"""Half of a slice's, over the largest extent of the shape."""


def slices_figure(
    known: Float[np.ndarray, "n 3"], moved: Float[np.ndarray, "m 3"], title: str = ""
) -> Figure:
    """Thin slices of a known shape and of a measured surface on it, through the middle, across each axis of the shape.

    Parameters
    ----------
    known, moved : ndarray of shape (n, 3) and (m, 3)
        Points of both in the axes of the shape, m.
    title : str
        Above all panels.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(12.0, 4.8), layout="constrained")
    middle = (known.max(axis=0) + known.min(axis=0)) / 2
    half = THICKNESS * float(np.ptp(known))
    for axis, axes in enumerate(figure.subplots(1, 3)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for points, colour, size in ((known, BLUE, 2.0), (moved, RED, 5.0)):
            near = np.abs(points[:, axis] - middle[axis]) < half
            axes.plot(
                1e3 * points[near, u], 1e3 * points[near, v], ".", color=colour, markersize=size, zorder=size
            )
        axes.set(xlabel=f"{'xyz'[u]} [mm]", ylabel=f"{'xyz'[v]} [mm]", aspect="equal")
        axes.set_title(f"slice across {'xyz'[axis]}", loc="left", fontsize="medium")
        tidy(axes)
    if title:
        figure.suptitle(title, fontsize="large")
    legend_below(figure, dot_handles({"known shape": BLUE, "dense model, aligned": RED}))
    return figure
