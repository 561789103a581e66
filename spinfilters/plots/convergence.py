"""Convergence of a smoother's estimates over its solves.

After Tweddle (2013), Figures 6-33 to 6-41: iterations (epochs taken in) and time span the plane, scales are logarithmic.
Motions are shown by the length of their error, with its standard deviation in the same scale of colours: equal colours are an
honest covariance, and colours that do not change any more along a row are an estimate that has settled.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from spinfilters.models.body import BodyHistory
from spinfilters.plots.style import (
    AXIS_COLOURS,
    BLACK,
    GREY,
    PRINCIPAL_NAMES,
    RED,
    legend_below,
    tidy,
    truth_handle,
)

COLOURS = "viridis"
_SHARES = (
    0.03,
    0.995,
)  # of all values: what the scale of colours spans; the first pose is exact by definition
_SETTLED_SHARE = 0.25  # of the solves: what comes before does not widen the panels of constants


@dataclass(frozen=True)
class ConvergingQuantity:
    """Error and standard deviation of a quantity, by solve and epoch.

    Attributes
    ----------
    label, unit : str
        Of both.
    distance : ndarray of float, shape (f, f)
        Length of the error, or of what differs from the last solve; solves by epochs.
    std : ndarray of float, shape (f, f)
        Standard deviation of that length: the root of the sum of the axes' variances.
    """

    label: str
    unit: str
    distance: Float[np.ndarray, "f f"]
    std: Float[np.ndarray, "f f"]


@dataclass(frozen=True)
class Convergence:
    """Content of the convergence figure.

    Attributes
    ----------
    time : ndarray of float, shape (f,)
        Times of the epochs, s.
    quantities : sequence of ConvergingQuantity
        A row of panels each.
    bodies : BodyHistory
        After every solve.
    trusted : ndarray of bool, shape (f,)
        Which solves the smoother vouched for.
    known : bool
        Whether distances are from the truth, or from the last solve.
    true_ratios : ndarray of float, shape (2,) or None
        k1, k2.
    true_center : ndarray of float, shape (3,) or None
        In g, m; None where it is not known.
    """

    time: Float[np.ndarray, " f"]
    quantities: Sequence[ConvergingQuantity]
    bodies: BodyHistory
    trusted: Bool[np.ndarray, " f"]
    known: bool
    true_ratios: Float[np.ndarray, "2"] | None = None
    true_center: Float[np.ndarray, "3"] | None = None


def convergence_figure(found: Convergence) -> Figure:
    """Convergence as surfaces and curves over the solves.

    Rows: quantities, error and standard deviation; last the body's constants.

    Parameters
    ----------
    found : Convergence
        Distances and deviations after every solve.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    rows = len(found.quantities) + 1
    figure = Figure(figsize=(13.5, 2.6 * rows + 0.8), layout="constrained")
    panels = figure.subplots(rows, 3, squeeze=False)
    for (error, std, course), quantity in zip(panels[:-1], found.quantities, strict=True):
        _surfaces(error, std, found, quantity)
        _course(course, found, quantity)
    _constants(panels[-1], found)
    for axes in panels.flat:
        _doubtful(axes, found)
    figure.align_ylabels(list(panels[:, 0]))
    for axes in panels[-1]:
        axes.set_xlabel("after epoch")
    what = "error" if found.known else "distance from the last solve's estimate"
    figure.suptitle(
        f"Convergence of the smoother: {what} and σ of every epoch, solved again after every epoch",
        fontsize="large",
    )
    _legend(figure, found)
    return figure


def _doubtful(axes: Axes, found: Convergence) -> None:
    """Hatch the solves that the smoother did not vouch for."""
    edges = np.flatnonzero(np.diff(found.trusted, prepend=True, append=True))
    for first, end in edges.reshape(-1, 2):
        axes.axvspan(first + 0.5, end + 0.5, facecolor="none", edgecolor=GREY, hatch="///", linewidth=0.0)


def _legend(figure: Figure, found: Convergence) -> None:
    what = "|error|" if found.known else "distance"
    handles = [
        Line2D([], [], color=BLACK, label=f"{what}, rms"),
        Line2D([], [], color=RED, linestyle="--", label="σ, rms"),
        Patch(color=GREY, alpha=0.3, label="±1 σ"),
        Patch(facecolor="none", edgecolor=GREY, hatch="///", label="not determined yet"),
    ]
    legend_below(figure, [*handles, *([truth_handle()] if found.true_ratios is not None else [])])


def _surfaces(error: Axes, std: Axes, found: Convergence, quantity: ConvergingQuantity) -> None:
    """Both on one scale."""
    every = np.concatenate([quantity.distance, quantity.std])
    span = _span(every)
    what = "|error|" if found.known else "distance"
    for axes, surface, name in ((error, quantity.distance, what), (std, quantity.std, "σ")):
        mesh = _mesh(axes, found.time, surface, *span)
        axes.set_title(f"{quantity.label}: {name}", loc="left", fontsize="medium")
        ticks = LogLocator(subs=(1.0, 2.0, 5.0))
        bar = axes.figure.colorbar(
            mesh, ax=axes, extend="both", pad=0.02, aspect=14, ticks=ticks, format="{x:g}"
        )
        bar.minorticks_off()
        bar.ax.set_title(f"[{quantity.unit}]", fontsize="small")
    error.set_ylabel("time of the epoch [s]")


def _span(values: np.ndarray) -> tuple[float, float]:
    """Limits of a logarithmic scale for nearly all values, a decade at least."""
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = np.quantile(positive, _SHARES).tolist() if positive.size else (0.1, 1.0)
    middle = np.sqrt(low * high)
    return min(low, middle / np.sqrt(10)), max(high, middle * np.sqrt(10))


def _mesh(axes: Axes, time: np.ndarray, surface: np.ndarray, low: float, high: float) -> QuadMesh:
    middles = (time[1:] + time[:-1]) / 2
    ends = [1.5 * time[:1] - 0.5 * time[1:2], middles, 1.5 * time[-1:] - 0.5 * time[-2:-1]]
    epochs = np.arange(len(time) + 1) + 0.5
    shown = np.ma.masked_invalid(np.maximum(surface.T, low))  # what is exact has no logarithm
    mesh = axes.pcolormesh(epochs, np.concatenate(ends), shown, norm=LogNorm(low, high), cmap=COLOURS)
    mesh.set_rasterized(True)
    axes.spines[["top", "right"]].set_visible(False)
    return mesh


def _course(axes: Axes, found: Convergence, quantity: ConvergingQuantity) -> None:
    """Root mean squares over the epochs of a solve."""
    for surface, color, dashes in ((quantity.distance, BLACK, "-"), (quantity.std, RED, "--")):
        held = np.isfinite(surface)
        mean = np.where(held, surface, 0.0) ** 2
        values = np.sqrt(mean.sum(axis=1) / np.maximum(held.sum(axis=1), 1))
        good = values > 0
        axes.semilogy(1 + np.flatnonzero(good), values[good], color=color, linestyle=dashes)
    axes.set_ylim(bottom=0.5 * _span(quantity.std)[0])
    axes.set_title(f"{quantity.label}: all epochs so far", loc="left", fontsize="medium")
    axes.set_ylabel(f"[{quantity.unit}]")
    tidy(axes)


def _constants(panels: Sequence[Axes], found: Convergence) -> None:
    bodies = found.bodies
    ratios, centre, turns = panels
    _lines(ratios, bodies.log_ratios, bodies.log_ratios_std, found.true_ratios, ("k1", "k2"))
    ratios.set_title("inertia: k1 = ln(Jmax/Jmid), k2 = ln(Jmid/Jmin)", loc="left", fontsize="medium")
    ratios.set_ylabel("[-]")
    if bodies.center_of_mass_g is not None and bodies.center_of_mass_std is not None:
        true = None if found.true_center is None else 1e3 * found.true_center
        values = 1e3 * bodies.center_of_mass_g, 1e3 * bodies.center_of_mass_std
        _lines(centre, *values, true, ("x", "y", "z"))
    centre.set_title("centre of mass in g", loc="left", fontsize="medium")
    centre.set_ylabel("[mm]")
    _axes_std(turns, bodies)


def _axes_std(axes: Axes, bodies: BodyHistory) -> None:
    std = np.rad2deg(np.sqrt(np.einsum("nii->ni", bodies.principal_axes_cov)))
    for values, color, name in zip(std.T, AXIS_COLOURS, PRINCIPAL_NAMES, strict=True):
        axes.semilogy(1 + np.arange(len(std)), values, color=color, label=f"about the {name} axis")
    axes.set_title("σ of the principal axes", loc="left", fontsize="medium")
    axes.set_ylabel("[deg]")
    axes.legend(frameon=False, fontsize="small")
    tidy(axes)


def _lines(
    axes: Axes, values: np.ndarray, std: np.ndarray, true: np.ndarray | None, names: Sequence[str]
) -> None:
    """Curves of components with standard deviations over the solves.

    The axes are as high as what comes after the first solves needs.
    """
    solves = 1 + np.arange(len(values))
    for k, name in enumerate(names):
        low, high = values[:, k] - std[:, k], values[:, k] + std[:, k]
        axes.fill_between(solves, low, high, color=AXIS_COLOURS[k], alpha=0.17, linewidth=0)
        axes.plot(solves, values[:, k], color=AXIS_COLOURS[k], label=name, linewidth=1.4)
        if true is not None:
            axes.axhline(true[k], color=BLACK, linestyle=(0, (2, 1.5)), linewidth=1.1)
    late = slice(int(_SETTLED_SHARE * len(values)), None)
    edges = np.stack([values[late] - std[late], values[late] + std[late]])
    told = [*edges[np.isfinite(edges)], *([] if true is None else true)]
    if told:
        margin = 0.15 * (max(told) - min(told))
        axes.set_ylim(min(told) - margin, max(told) + margin)
    axes.legend(frameon=False, fontsize="small", loc="upper right", ncols=len(names))
    tidy(axes)
