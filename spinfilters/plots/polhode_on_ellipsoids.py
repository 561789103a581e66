"""Polhode of an estimated motion on both ellipsoids of its inertia."""

import numpy as np
from jaxtyping import Float
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D

from spinfilters.dynamics.polhode import polhode
from spinfilters.evaluation.body import BodyEstimate
from spinfilters.evaluation.estimated_motion import BodyRates
from spinfilters.plots.space import draw_ellipsoid, draw_wires, equal_scales, space_figure
from spinfilters.plots.style import (
    BLACK,
    BLUE,
    INITIALISATION,
    PRINCIPAL_NAMES,
    PURPLE,
    RED,
    legend_below,
    note_figure,
)

_MOST_DOTS = 2000  # more lie upon one another


def estimated_polhode_figure(rates: BodyRates, body: BodyEstimate, initialisation: int = 0) -> Figure:
    """Estimated rates in principal axes with ellipsoids and polhode.

    Axes g; of the last rate; a note where that is not finite.

    Parameters
    ----------
    initialisation: how many of the first epochs a smoother made for a filter; hollow.
    """
    path = np.rad2deg(rates.in_axes(body.principal_axes_g).rate)
    if not np.isfinite(path[-1]).all():
        return note_figure(
            f"{rates.label.upper()}: no polhode, the rate or the inertia at the end is not finite"
        )
    curve = polhode(body.principal_moments, path[-1])
    figure, axes = space_figure(8.6, 6.8)
    draw_ellipsoid(axes, curve.energy_semi_axes, BLUE)
    draw_wires(axes, curve.momentum_semi_axes, RED)
    for branch in curve.curves:
        axes.plot(*branch.T, color=BLACK, linewidth=1.6, zorder=3)
    dots = _draw_rates(axes, rates.time, path, initialisation)
    figure.colorbar(dots, ax=axes, shrink=0.6, pad=0.12, label="estimated rate at time [s]")
    extent = np.maximum(curve.energy_semi_axes, curve.momentum_semi_axes)
    equal_scales(axes, np.stack([-extent, extent]), zoom=1.0)
    axes.view_init(elev=22, azim=-52)
    _label_axes(axes)
    axes.set_title(f"{rates.label.upper()}: rate goes {curve.kind.value}\n{_moments(body)}")
    legend_below(
        figure,
        [
            Patch(color=BLUE, alpha=0.35, label="constant energy"),
            Line2D([], [], color=RED, linewidth=0.7, label="constant momentum"),
            Line2D([], [], color=BLACK, linewidth=1.6, label="polhode of the last rate (both branches)"),
            *([_hollow()] if initialisation else []),
        ],
    )
    return figure


def _label_axes(axes: Axes3D) -> None:
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), PRINCIPAL_NAMES, strict=True):
        axis.set_label_text(f"{name} axis [deg/s]")
        axis.labelpad = 8.0


def _draw_rates(
    axes: Axes3D, time: Float[np.ndarray, " n"], path: Float[np.ndarray, "n 3"], initialisation: int
) -> PathCollection:
    """Finite rates (deg/s) as dots coloured by time, hollow during the initialisation."""
    held = np.isfinite(path).all(axis=1)
    begin = time[initialisation] if initialisation < len(time) else np.inf
    step = max(1, int(np.count_nonzero(held)) // _MOST_DOTS)
    path, time = path[held][::step], time[held][::step]
    before, own = path[time < begin], path[time >= begin]
    axes.scatter(*before.T, s=16, facecolors="none", edgecolors=PURPLE, depthshade=False, zorder=4)
    return axes.scatter(*own.T, c=time[time >= begin], cmap="cividis", s=18, depthshade=False, zorder=5)


def _hollow() -> Line2D:
    return Line2D(
        [], [], linestyle="none", marker="o", color=PURPLE, markerfacecolor="none", label=INITIALISATION
    )


def _moments(body: BodyEstimate) -> str:
    minor, middle, _ = body.principal_moments
    return f"moments of inertia {minor:.3f} : {middle:.3f} : 1"
