"""Figures of a calibration.

A rectified pair with its rows, its disparity, and the error of every view.
"""

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure

from spinfilters.plots.style import BLUE, ORANGE, RED, tidy

ROWS = 12
"""Lines across the rectified images."""


def calibration_figure(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    disparity: Float[np.ndarray, "h w"],
    view_errors: Float[np.ndarray, "v 2"],
) -> Figure:
    """Four panels: rectified left and right image, disparity (px), rms of each view (px)."""
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
