"""How a smoother's estimates settle, axis by axis, with the time of every solve.

Surfaces, constants, courses and run time after Tweddle (2013), Figures 6-33 to 6-43. A solve takes in one more epoch and estimates
all epochs before it again; what it says stands in a column of a surface. A line marks the solve that closed the first loop.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image

from spinfilters.plots.style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    GREY,
    RED,
    finite_quantile,
    legend_below,
    picture_bytes,
    plot_truth,
    tidy,
    truth_handle,
)

SHARES: Final = (0.02, 0.98)
"""Share of the values below and above which a scale of colours ends: the first solves know nothing."""
LATE: Final = 0.25
"""Share of the solves that do not set the limits of a panel of constants."""
MOST_FRAMES, FRAME_MS, FRAME_DPI = 40, 150, 72
"""Of an animation."""


@dataclass(frozen=True)
class SettlingQuantity:
    """What every solve said of a quantity with three axes, by solve and epoch.

    Attributes
    ----------
    label, unit, std_unit : str
        Of values and of standard deviations.
    names : tuple of str
        Of the axes.
    values, std : ndarray of float, shape (f, f, 3)
        Solves by epochs by axes; not a number where a solve said nothing of an epoch.
    truth : ndarray of float, shape (f, 3) or None
        By epoch.
    """

    label: str
    unit: str
    std_unit: str
    names: tuple[str, str, str]
    values: Float[np.ndarray, "f f 3"]
    std: Float[np.ndarray, "f f 3"]
    truth: Float[np.ndarray, "f 3"] | None = None


@dataclass(frozen=True)
class SettlingConstant:
    """What every solve said of k constants of the body.

    Attributes
    ----------
    label, unit : str
        Of values and standard deviations.
    names : tuple of str
        Of the constants.
    values, std : ndarray of float, shape (f, k)
        By solve.
    truth : ndarray of float, shape (k,) or None
        Where it is known.
    """

    label: str
    unit: str
    names: tuple[str, ...]
    values: Float[np.ndarray, "f k"]
    std: Float[np.ndarray, "f k"]
    truth: Float[np.ndarray, " k"] | None = None


@dataclass(frozen=True)
class SolveCosts:
    """What every solve cost.

    Attributes
    ----------
    seconds : ndarray of float, shape (f,)
        Of a solve with the covariances of all its epochs, without the building of functions.
    landmarks, factors : ndarray of float, shape (f,)
        In the problem that it solved: landmarks, and residuals of observations, of the motion and of priors.
    """

    seconds: Float[np.ndarray, " f"]
    landmarks: Float[np.ndarray, " f"]
    factors: Float[np.ndarray, " f"]


def surfaces_figure(
    time: Float[np.ndarray, " f"], quantity: SettlingQuantity, closure: int | None = None
) -> Figure:
    """Standard deviations (above) and values (below) of a quantity, a column an axis.

    Parameters
    ----------
    time : ndarray of float, shape (f,)
        Times of the epochs, s.
    quantity : SettlingQuantity
        Drawn over the solves (across) and the time of the epochs (up).
    closure : int or None
        Number of the solve that closed the first loop, from 1; None for none.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(13.5, 6.6), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    low, high = _limits(quantity.std)
    for axis, name in enumerate(quantity.names):
        std = np.maximum(quantity.std[..., axis], low)
        norm = LogNorm(low, max(high, 1.01 * low))
        _surface(
            panels[0, axis], time, std, norm, f"σ of the {quantity.label}, {name[-1]}", quantity.std_unit
        )
        span = Normalize(*_limits(quantity.values[..., axis], positive=False))
        values, title = quantity.values[..., axis], f"{quantity.label}, {name}"
        _surface(panels[1, axis], time, values, span, title, quantity.unit)
    for axes in panels.flat:
        _mark(axes, closure)
    for axes in panels[1]:
        axes.set_xlabel("after epoch")
    for axes in panels[:, 0]:
        axes.set_ylabel("time of the epoch [s]")
    figure.suptitle(
        f"Convergence of the {quantity.label} of every epoch: standard deviation and value", fontsize="large"
    )
    if closure is not None:
        legend_below(figure, [_closure_handle()])
    return figure


def constants_figure(constants: Sequence[SettlingConstant], closure: int | None = None) -> Figure:
    """Standard deviations (left) and values with one deviation (right) of constants over the solves.

    Parameters
    ----------
    constants : sequence of SettlingConstant
        A row each.
    closure : int or None
        Number of the solve that closed the first loop, from 1; None for none.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(10.5, 3.0 * len(constants) + 0.9), layout="constrained")
    panels = figure.subplots(len(constants), 2, sharex=True, squeeze=False)
    for (std, values), constant in zip(panels, constants, strict=True):
        solves = 1 + np.arange(len(constant.values))
        for k, name in enumerate(constant.names):
            colour = AXIS_COLOURS[k]
            std.semilogy(solves, constant.std[:, k], color=colour, label=name)
            edges = constant.values[:, k] - constant.std[:, k], constant.values[:, k] + constant.std[:, k]
            values.fill_between(solves, *edges, color=colour, alpha=0.17, linewidth=0)
            values.plot(solves, constant.values[:, k], color=colour, linewidth=1.4)
            if constant.truth is not None:
                values.axhline(constant.truth[k], color=BLACK, linestyle=(0, (2, 1.5)), linewidth=1.1)
        values.set_ylim(*_late_limits(constant))
        std.set_title(f"σ of the {constant.label}", loc="left", fontsize="medium")
        values.set_title(constant.label.split(",")[0], loc="left", fontsize="medium")
        std.legend(frameon=False, fontsize="small", ncols=len(constant.names), loc="upper right")
        for axes in (std, values):
            axes.set_ylabel(f"[{constant.unit}]")
            _mark(axes, closure)
            tidy(axes)
    for axes in panels[-1]:
        axes.set_xlabel("after epoch")
    figure.suptitle("How the constants of the body converge", fontsize="large")
    handles = [Patch(color=GREY, alpha=0.3, label="±1 σ")]
    handles += [truth_handle()] if any(each.truth is not None for each in constants) else []
    legend_below(figure, [*handles, *([_closure_handle()] if closure is not None else [])])
    return figure


def course_figure(
    time: Float[np.ndarray, " f"], quantity: SettlingQuantity, axis: int, solves: Sequence[int]
) -> Figure:
    """Course of one axis of a quantity as chosen solves saw it, a panel a solve.

    Parameters
    ----------
    time : ndarray of float, shape (f,)
        Times of the epochs, s.
    quantity : SettlingQuantity
        Of which deviations have the unit of the values.
    axis : int
        0, 1 or 2.
    solves : sequence of int
        Numbers of the solves, from 1.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    columns = min(3, len(solves))
    rows = -(-len(solves) // columns)
    figure = Figure(figsize=(4.2 * columns, 2.6 * rows + 0.8), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, solve in zip(panels.flat, solves, strict=False):
        _course(axes, time, quantity, axis, solve)
    for axes in panels.flat[len(solves) :]:
        axes.set_axis_off()
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    for axes in panels[:, 0]:
        axes.set_ylabel(f"[{quantity.unit}]")
    figure.suptitle(f"{quantity.label}, {quantity.names[axis]}, as epochs come", fontsize="large")
    handles = [Line2D([], [], color=BLUE, label="estimate"), Patch(color=BLUE, alpha=0.2, label="±1 σ")]
    legend_below(figure, [*handles, *([truth_handle()] if quantity.truth is not None else [])])
    return figure


def course_animation(time: Float[np.ndarray, " f"], quantity: SettlingQuantity, axis: int) -> bytes:
    """The course of one axis solve after solve, as a GIF that repeats.

    Parameters
    ----------
    time : ndarray of float, shape (f,)
        Times of the epochs, s.
    quantity : SettlingQuantity
        As for `course_figure`.
    axis : int
        0, 1 or 2.

    Returns
    -------
    bytes
        Content of the file; at most 40 solves are shown, the last among them.
    """
    frames = list(_frames(time, quantity, axis))
    stream = BytesIO()
    frames[0].save(stream, "GIF", save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0)
    return stream.getvalue()


def costs_figure(costs: SolveCosts) -> Figure:
    """Run time, landmarks and factors of every solve, and the time over the factors.

    Parameters
    ----------
    costs : SolveCosts
        By solve.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 3)
    _costs_by_epoch(panels[:, :2].ravel(), costs)
    _costs_by_size(panels[:, 2], costs)
    figure.suptitle("What every solve costs, with the covariances of all its epochs", fontsize="large")
    legend_below(figure, [_line_handle()])
    return figure


def costs_by_epoch_figure(costs: SolveCosts) -> Figure:
    """Run time of all and of each solve, landmarks and factors over the epochs (Tweddle 2013, Figure 6-42).

    Parameters
    ----------
    costs : SolveCosts
        By solve.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(8.4, 6.0), layout="constrained")
    _costs_by_epoch(figure.subplots(2, 2).ravel(), costs)
    return figure


def costs_by_size_figure(costs: SolveCosts) -> Figure:
    """Time of a solve over its factors and over its epochs (Tweddle 2013, Figure 6-43).

    Parameters
    ----------
    costs : SolveCosts
        By solve.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    _costs_by_size(figure.subplots(1, 2), costs)
    legend_below(figure, [_line_handle()])
    return figure


def _costs_by_epoch(panels: Iterable[Axes], costs: SolveCosts) -> None:
    solves = 1 + np.arange(len(costs.seconds))
    drawn = (
        ("time of all solves so far", "[s]", np.nancumsum(costs.seconds)),
        ("time of each solve", "[ms]", 1e3 * costs.seconds),
        ("landmarks", "[-]", costs.landmarks),
        ("factors", "[-]", costs.factors),
    )
    for axes, (title, unit, values) in zip(panels, drawn, strict=True):
        axes.plot(solves, values, color=BLUE)
        axes.set_title(title, loc="left", fontsize="medium")
        axes.set(xlabel="epochs", ylabel=unit)
        axes.set_ylim(bottom=0.0)
        tidy(axes)


def _costs_by_size(panels: Iterable[Axes], costs: SolveCosts) -> None:
    solves = 1.0 + np.arange(len(costs.seconds))
    for axes, (size, values) in zip(panels, (("factors", costs.factors), ("epochs", solves)), strict=True):
        axes.plot(values, 1e3 * costs.seconds, ".", color=BLUE, markersize=4)
        good = np.isfinite(values) & np.isfinite(costs.seconds)
        if good.sum() > 1:
            line = np.polyfit(values[good], 1e3 * costs.seconds[good], 1)
            ends = np.array([values[good].min(), values[good].max()])
            axes.plot(ends, np.polyval(line, ends), color=RED, linestyle="--", linewidth=1.2)
        axes.set_title(f"time of a solve over its {size}", loc="left", fontsize="medium")
        axes.set(xlabel=size, ylabel="[ms]")
        axes.set_ylim(bottom=0.0)
        tidy(axes)


def _line_handle() -> Line2D:
    return Line2D([], [], color=RED, linestyle="--", label="straight line fitted")


def _surface(
    axes: Axes, time: np.ndarray, surface: np.ndarray, norm: Normalize, title: str, unit: str
) -> None:
    """One surface: solves across, epochs up."""
    half = np.diff(time) / 2
    ends = np.concatenate([time[:1] - half[:1], time[:-1] + half, time[-1:] + half[-1:]])
    solves = np.arange(len(time) + 1) + 0.5
    mesh = axes.pcolormesh(solves, ends, np.ma.masked_invalid(surface.T), norm=norm, cmap="viridis")
    mesh.set_rasterized(True)
    bar = axes.figure.colorbar(mesh, ax=axes, extend="both", pad=0.02, aspect=16)
    bar.ax.set_title(f"[{unit}]", fontsize="small")
    axes.set_title(title, loc="left", fontsize="medium")
    axes.spines[["top", "right"]].set_visible(False)


def _limits(values: np.ndarray, positive: bool = True) -> tuple[float, float]:
    """Ends of a scale of colours for nearly all values."""
    used = np.where(values > 0, values, np.nan) if positive else values
    low, high = (finite_quantile(used, share, otherwise=1.0) for share in SHARES)
    return (low, high) if high > low else (low, low + max(abs(low), 1.0) * 1e-3)


def _late_limits(constant: SettlingConstant) -> tuple[float, float]:
    late = slice(int(LATE * len(constant.values)), None)
    edges = [constant.values[late] - constant.std[late], constant.values[late] + constant.std[late]]
    told = np.concatenate([np.ravel(edges), [] if constant.truth is None else constant.truth])
    low, high = finite_quantile(told, 0.02), finite_quantile(told, 0.98, 1.0)
    margin = 0.2 * (high - low) or 1.0
    return low - margin, high + margin


def _mark(axes: Axes, closure: int | None) -> None:
    if closure is not None:
        axes.axvline(closure, color=RED, linestyle=":", linewidth=1.3)


def _closure_handle() -> Line2D:
    return Line2D([], [], color=RED, linestyle=":", linewidth=1.3, label="first loop closed")


def _course(axes: Axes, time: np.ndarray, quantity: SettlingQuantity, axis: int, solve: int) -> None:
    """What a solve said of one axis, with one deviation."""
    values, std = quantity.values[solve - 1, :, axis], quantity.std[solve - 1, :, axis]
    axes.fill_between(time, values - std, values + std, color=BLUE, alpha=0.2, linewidth=0)
    axes.plot(time, values, color=BLUE, linewidth=1.3)
    if quantity.truth is not None:
        plot_truth(axes, time, quantity.truth[:, axis])
    known = quantity.values[-1, :, axis] if quantity.truth is None else quantity.truth[:, axis]
    low, high = finite_quantile(known, 0.0, -1.0), finite_quantile(known, 1.0, 1.0)
    margin = 0.4 * (high - low) or 1.0
    axes.set(xlim=(time[0], time[-1]), ylim=(low - margin, high + margin))
    axes.set_title(f"after epoch {solve}", loc="left", fontsize="medium")
    tidy(axes)


def _frames(time: np.ndarray, quantity: SettlingQuantity, axis: int) -> Iterator[Image.Image]:
    """Pictures of chosen solves, in order."""
    figure = Figure(figsize=(6.0, 3.4), layout="constrained")
    axes = figure.subplots()
    count = len(time)
    for solve in np.unique(np.linspace(1, count, min(count, MOST_FRAMES)).round().astype(int)):
        for artist in (*axes.collections, *axes.lines):
            artist.remove()
        _course(axes, time, quantity, axis, int(solve))
        axes.set(xlabel="time [s]", ylabel=f"{quantity.label}, {quantity.names[axis]} [{quantity.unit}]")
        picture = Image.open(BytesIO(picture_bytes(figure, "png", dpi=FRAME_DPI)))
        figure.set_layout_engine("none")  # scales, labels and so the layout are those of the first frame
        yield picture.convert("RGB").quantize(64)
