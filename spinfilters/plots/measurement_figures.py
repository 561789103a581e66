"""Figures of measurements: residuals of a camera calibration, and a lidar scan."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D

from spinfilters.core.linear_algebra import evenly_spaced
from spinfilters.lidar.scan import Scan
from spinfilters.plots.scene import equal_scales
from spinfilters.plots.style import BLUE, GREEN, GREY, ORANGE, RED, legend_below, tidy
from spinfilters.vision.calibration_checkout import Checkout, ParameterChange
from spinfilters.vision.tracked_pairs import TrackedPair

ROWS = 12
STEREO_COLOUR, MOVED_COLOUR = "#00D060", "cyan"
"""Of matches, on grey images; as in the source."""
"""Lines across the rectified images."""


def calibration_figure(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    disparity: Float[np.ndarray, "h w"],
    view_errors: Float[np.ndarray, "v 2"],
) -> Figure:
    """Four panels: rectified left and right image, disparity (px), rms of each view (px).

    Parameters
    ----------
    left : ndarray of uint8, shape (h, w)
        Rectified image, grey values.
    right : ndarray of uint8, shape (h, w)
        Rectified image, grey values.
    disparity : ndarray of float, shape (h, w)
        px, not finite where there is none.
    view_errors : ndarray of float, shape (v, 2)
        Root mean square error of each view, px.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    panels = figure.subplots(2, 2).ravel()
    for axes, image, name in zip(panels, (left, right), ("left", "right"), strict=False):
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
        for row in np.linspace(0, len(image) - 1, ROWS + 2)[1:-1]:
            axes.axhline(row, color=ORANGE, linewidth=0.7)
        axes.set_title(
            f"rectified {name} image: the same points on the same lines", loc="left", fontsize="medium"
        )
        axes.set_axis_off()
    shown = panels[2].imshow(disparity, cmap="viridis", interpolation="nearest")
    figure.colorbar(shown, ax=panels[2], label="px", shrink=0.8)
    panels[2].set_title("disparity", loc="left", fontsize="medium")
    panels[2].set_axis_off()
    place = np.arange(len(view_errors))
    for side, (shift, color, name) in enumerate(((-0.2, BLUE, "left"), (0.2, RED, "right"))):
        panels[3].bar(place + shift, view_errors[:, side], 0.4, color=color, label=name)
    panels[3].set_title("error of each view", loc="left", fontsize="medium")
    panels[3].set_xlabel("view")
    panels[3].set_ylabel("rms [px]")
    panels[3].legend()
    tidy(panels[3])
    return figure


def checkout_figure(
    found: Checkout,
    left_image: UInt8[np.ndarray, "h w"],
    right_image: UInt8[np.ndarray, "h w"],
    disparity: Float[np.ndarray, "h w"],
) -> Figure:
    """Screens of a checkout: values in their ranges, lines between corners, and the disparity of a pair.

    Parameters
    ----------
    found : Checkout
        Results and corners.
    left_image, right_image : ndarray of uint8, shape (h, w)
        Rectified images of the view that the corners are of.
    disparity : ndarray of float, shape (h, w)
        px, not finite where there is none.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(13.0, 9.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.15, 1.0), width_ratios=(1.2, 1.0))
    values, depth = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    lines = figure.add_subplot(grid[1, :])
    values.set_axis_off()
    values.set_title("calibration values", loc="left", fontsize="medium")
    for row, result in enumerate(found.results):
        place = 0.96 - 0.86 * row / len(found.results)
        colour = GREEN if result.passed else ORANGE
        values.plot([0.02], [place], "o", color=colour, markersize=9, transform=values.transAxes)
        text = f"{result.name}: {result.value}   ({result.allowed})"
        values.text(0.06, place, text, va="center", fontsize="small", transform=values.transAxes)
    shown = depth.imshow(disparity, cmap="gray", interpolation="nearest")
    figure.colorbar(shown, ax=depth, label="px", shrink=0.8)
    depth.set_title("disparity: light is near", loc="left", fontsize="medium")
    depth.set_axis_off()
    pair, width = np.hstack([left_image, right_image]), left_image.shape[1]
    lines.imshow(pair, cmap="gray", vmin=0, vmax=255)
    for row in np.linspace(0, len(pair) - 1, 5)[1:-1]:
        lines.axhline(row, color=GREEN, linewidth=1.0)
    for left, right, level in zip(found.left, found.right, found.level, strict=True):
        colour = BLUE if level else ORANGE
        lines.plot([left[0], right[0] + width], [left[1], right[1]], color=colour, linewidth=0.8)
    lines.set_title(
        f"lines between corners (blue: horizontal), board at {100 * found.distance:.1f} cm",
        loc="left",
        fontsize="medium",
    )
    lines.set_axis_off()
    verdict = "passed" if found.passed else "failed: calibrate again"
    figure.suptitle(f"Checkout of the stored calibration: {verdict}", fontsize="large")
    return figure


def calibration_changes_figure(changes: Sequence[ParameterChange]) -> Figure:
    """Differences of two calibrations with three standard deviations, a panel a unit.

    Parameters
    ----------
    changes : sequence of ParameterChange
        Of one rig.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    units = list(dict.fromkeys(change.unit for change in changes))
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    panels = figure.subplots(1, len(units), squeeze=False)[0]
    for axes, unit in zip(panels, units, strict=True):
        own = [change for change in changes if change.unit == unit]
        places = np.arange(len(own))[::-1]
        bands = [0.0 if change.std is None else 3 * change.std for change in own]
        values = [change.difference for change in own]
        axes.errorbar(values, places, xerr=bands, fmt="o", color=BLUE, capsize=3)
        axes.axvline(0.0, color=GREY, linewidth=0.8)
        axes.set_yticks(places, [change.name for change in own])
        axes.set_xlabel(f"change [{unit}]")
        axes.set_title(f"in {unit}", loc="left", fontsize="medium")
        tidy(axes)
    figure.suptitle("What differs between two calibrations, ±3 σ", fontsize="large")
    return figure


def disparities_figure(
    image: UInt8[np.ndarray, "h w"],
    maps: Mapping[str, Float[np.ndarray, "h w"]],
    unit: str = "px",
) -> Figure:
    """An image beside disparity or depth maps of it.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w)
        Left image of the rectified pair.
    maps : mapping of str to ndarray of float, shape (h, w)
        By title; not finite where nothing was found.
    unit : str
        Of the maps.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(5.2 * (1 + len(maps)), 4.6), layout="constrained")
    first, *others = figure.subplots(1, 1 + len(maps))
    first.imshow(image, cmap="gray", vmin=0, vmax=255)
    first.set_title("left image", loc="left", fontsize="medium")
    first.set_axis_off()
    every = np.concatenate([each[np.isfinite(each)] for each in maps.values()])
    low, high = np.quantile(every, [0.01, 0.99]).tolist() if every.size else (0.0, 1.0)
    for axes, (title, values) in zip(others, maps.items(), strict=True):
        shown = axes.imshow(values, cmap="viridis", vmin=low, vmax=high, interpolation="nearest")
        axes.set_title(
            f"{title}: {100 * np.isfinite(values).mean():.0f} % filled", loc="left", fontsize="medium"
        )
        axes.set_axis_off()
        figure.colorbar(shown, ax=axes, label=unit, shrink=0.7)
    return figure


def matches_figure(pairs: Sequence[TrackedPair]) -> Figure:
    """Stereo matches (green) and where features were one pair before (cyan), a row a pair.

    Parameters
    ----------
    pairs : sequence of TrackedPair
        In the order of time.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    height, width = pairs[0].left.shape
    figure = Figure(
        figsize=(11.0, len(pairs) * (11.0 * height / (2 * width) + 0.4) + 0.4), layout="constrained"
    )
    for axes, pair in zip(figure.subplots(len(pairs), 1, squeeze=False)[:, 0], pairs, strict=True):
        axes.imshow(np.hstack([pair.left, pair.right]), cmap="gray", vmin=0, vmax=255)
        for left, row, right in pair.values:
            axes.plot([left, right + width], [row, row], color=STEREO_COLOUR, linewidth=0.5)
        for now_u, now_v, then_u, then_v in pair.before:
            axes.plot([now_u, then_u], [now_v, then_v], color=MOVED_COLOUR, linewidth=1.2)
        text = f"{pair.time:.2f} s: {len(pair.values)} stereo matches, {len(pair.before)} followed"
        axes.set_title(text, loc="left", fontsize="medium")
        axes.set_axis_off()
        axes.set(xlim=(0, 2 * width), ylim=(height, 0))
    handles = [
        Line2D([], [], color=STEREO_COLOUR, label="left to right"),
        Line2D([], [], color=MOVED_COLOUR, label="since the pair before"),
    ]
    legend_below(figure, handles)
    return figure


MOST_POINTS: Final = 40_000
"""Points of a picture: more are drawn upon one another."""
_COLOURS: Final = "viridis"


def scan_figure(scan: Scan, title: str) -> Figure:
    """Returns as azimuth and elevation, deg, and in space, m.

    Colour: the intensity, or the range where all are alike.

    Parameters
    ----------
    scan : Scan
        Returns of one scan.
    title : str
        Of the figure.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(11, 5), layout="constrained")
    flat, space = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    assert isinstance(space, Axes3D)
    rows = np.flatnonzero(scan.is_return)
    kept = evenly_spaced(len(rows), MOST_POINTS)
    points, rows = scan.points[kept], rows[kept]
    varied = np.ptp(scan.intensity[rows]) > 1e-6
    colour, words = (scan.intensity[rows], "intensity") if varied else (scan.distance[rows], "range (m)")
    size = float(np.clip(6000 / len(rows), 0.3, 12.0))
    angles = np.rad2deg([scan.azimuth[rows], scan.elevation[rows]])
    drawn = flat.scatter(angles[0], angles[1], c=colour, s=size, cmap=_COLOURS, linewidths=0)
    flat.set(xlabel="azimuth (deg)", ylabel="elevation (deg)", aspect="equal")
    flat.set_title(f"{np.count_nonzero(scan.is_return)} of {len(scan)} rays returned", fontsize="medium")
    figure.colorbar(drawn, ax=flat, label=words, shrink=0.8)
    x, y, z = points.T
    space.scatter(x, z, y, c=colour, s=size, cmap=_COLOURS, linewidths=0)  # pyright: ignore[reportArgumentType]
    equal_scales(space, points[:, [0, 2, 1]])
    space.set(xlabel="x (m)", ylabel="z (m)", zlabel="y (m)")
    space.locator_params(axis="x", nbins=3)  # seen from its end
    space.ticklabel_format(useOffset=False)
    space.view_init(elev=20, azim=-150)
    figure.suptitle(title)
    return figure


def scan_accuracy_figure(stds: Float[np.ndarray, " n"], asked: float, needed: int, title: str) -> Figure:
    """Attitude deviation of the first scans, deg, and its trend to twice as many.

    Parameters
    ----------
    title : str
        Of the figure.
    stds : ndarray of float, shape (n,)
        Of the first 1, 2, ... n scans, rad.
    asked : float
        Standard deviation, rad.
    needed : int
        Scans that it takes.

    Returns
    -------
    Figure
        Not yet saved or shown.
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
