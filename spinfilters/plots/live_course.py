"""Figure of a live run: rates, latencies, and sources of the answers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter

from spinfilters.plots.style import (
    AXIS_COLOURS,
    BLACK,
    GREEN,
    GREY,
    ORANGE,
    RED,
    SIGMAS,
    extremes,
    fill_band,
    legend_below,
    note_figure,
    tidy,
)

_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class LiveCourse:
    """Answers of a run.

    Attributes
    ----------
    time : ndarray of float, shape (n,)
        Times of the epochs, s.
    rate, rate_std : ndarray of float, shape (n, 3)
        Along the axes of g, rad/s.
    latency : ndarray of float, shape (n,)
        From arrival to answer, s.
    smoothed : ndarray of bool, shape (n,)
        Whether the filter stood on a smoothed past.
    ok : ndarray of bool, shape (n,)
        Whether the verdict was ``ok``.
    deadline : float
        Latency that is allowed, s.
    stride : int
        Answers of which the slowest represents all.
    """

    time: Float[np.ndarray, " n"]
    rate: Float[np.ndarray, "n 3"]
    rate_std: Float[np.ndarray, "n 3"]
    latency: Float[np.ndarray, " n"]
    smoothed: Bool[np.ndarray, " n"]
    ok: Bool[np.ndarray, " n"]
    deadline: float
    stride: int = 1


def live_figure(course: LiveCourse) -> Figure:
    """Three panels over time: rates with their bands, latencies with the deadline, source and verdict.

    Parameters
    ----------
    course : LiveCourse
        Answers of a live run.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    if not len(course.time):
        return note_figure("no epoch was answered")
    figure = Figure(figsize=(10.0, 7.2), layout="constrained")
    rates, latencies, states = figure.subplots(3, 1, sharex=True, height_ratios=(5, 4, 1))
    _rates(rates, course)
    _latencies(latencies, course)
    _states(states, course)
    answers = "answer" if len(course.time) == 1 else "answers"
    late = int((course.latency > course.deadline).sum())
    shown = "" if course.stride == 1 else f", the slowest of every {course.stride} is shown"
    figure.suptitle(
        f"Live: {len(course.time)} {answers}{shown}, {late} after {1e3 * course.deadline:g} ms",
        fontsize="large",
    )
    lines = [Line2D([], [], color=AXIS_COLOURS[k], label=f"about {_AXES[k]} of g") for k in range(3)]
    band = Patch(color=GREY, alpha=0.3, label=f"±{SIGMAS:g} σ")
    strips = [
        Patch(color=GREEN, label="continues a hand-over of the smoother"),
        Patch(color=GREY, label="the filter's own past"),
        Patch(color=ORANGE, label="not ok"),
    ]
    legend_below(figure, [*lines, band, *strips])
    return figure


def _rates(axes: Axes, course: LiveCourse) -> None:
    values, half = np.rad2deg(course.rate), SIGMAS * np.rad2deg(course.rate_std)
    for k, color in enumerate(AXIS_COLOURS):
        fill_band(axes, course.time, values[:, k], half[:, k], color)
        rows = extremes(values[:, k])
        axes.plot(course.time[rows], values[rows, k], color=color, linewidth=1.2)
    axes.set_title("body rates, as they were answered", loc="left", fontsize="medium")
    axes.set_ylabel("rate [deg/s]")
    tidy(axes)


def _latencies(axes: Axes, course: LiveCourse) -> None:
    latency, late = 1e3 * course.latency, course.latency > course.deadline
    dots = {"linestyle": "none", "marker": ".", "markersize": 3.0}
    axes.semilogy(course.time[~late], latency[~late], color=BLACK, **dots)
    axes.semilogy(course.time[late], latency[late], color=RED, **{**dots, "markersize": 6.0})
    axes.axhline(1e3 * course.deadline, color=RED, linewidth=1.0, linestyle="--")
    axes.annotate(
        "deadline", (1.0, 1e3 * course.deadline), xycoords=("axes fraction", "data"), ha="right", va="bottom",
        color=RED, fontsize="small",
    )  # fmt: skip
    axes.set_title("from arrival to answer", loc="left", fontsize="medium")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_ylabel("latency [ms]")
    tidy(axes)


def _states(axes: Axes, course: LiveCourse) -> None:
    """Strips: every answer holds until the next."""
    ends = np.append(course.time, course.time[-1] + np.median(np.diff(course.time, prepend=course.time[0])))
    for low, where, color in (
        (1.0, course.smoothed, GREEN),
        (1.0, ~course.smoothed, GREY),
        (0.0, ~course.ok, ORANGE),
    ):
        changes = np.flatnonzero(np.diff(where, prepend=False, append=False)).reshape(-1, 2)
        spans = [(float(ends[first]), float(ends[last] - ends[first])) for first, last in changes.tolist()]
        axes.broken_barh(spans, (low, 0.8), color=color, linewidth=0)
    axes.set_yticks((0.4, 1.4), ("verdict", "source"))
    axes.set_ylim(-0.1, 1.9)
    axes.set_xlabel("time [s]")
    tidy(axes)
