"""A lidar's point cloud in angles and in space.

Coloured by range or by label (Decoust 2008, Figures 2.12 to 2.18).
"""

from typing import Final

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from spinfilters.lidar.scan import Scan
from spinfilters.plots.space import equal_scales

MOST_POINTS: Final = 40_000
"""Points of a picture: more are drawn upon one another."""
_COLOURS: Final = "viridis"


def scan_figure(scan: Scan, title: str) -> Figure:
    """Returns as azimuth and elevation, deg, and in space, m.

    Colour: the intensity, or the range where all are alike.
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
