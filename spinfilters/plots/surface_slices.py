"""Figure of two surfaces that should coincide: thin slices across each axis."""

from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.plots.style import BLUE, RED, dot_handles, legend_below, tidy

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
