"""Figures of measurements: residuals of a camera calibration, and a lidar scan."""

from typing import Final

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from spinfilters.lidar.scan import Scan
from spinfilters.plots.scene import equal_scales
from spinfilters.plots.style import BLUE, GREY, ORANGE, RED, tidy

ROWS = 12
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
    kept = np.linspace(0, len(rows) - 1, min(len(rows), MOST_POINTS)).astype(int)
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
