"""Inertia ratios of many throws against each other and a reference."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch, Polygon
from matplotlib.ticker import MaxNLocator
from scipy.special import chdtri

from spinfilters.models.body import BodyEstimate
from spinfilters.plots.style import BLACK, BLUE, GREY, RED, legend_below, tidy

ELLIPSE_PROBABILITY: Final[float] = 0.95
"""Of the drawn error ellipses; the strips show the same probability for one number (1.96 sigma)."""


@dataclass(frozen=True)
class Throw:
    """Inertia ratios of one throw.

    Attributes
    ----------
    number : int
        Of its segment.
    ratios : ndarray of float, shape (2,)
        Jmin / Jmax and Jmid / Jmax.
    covariance : ndarray of float, shape (2, 2)
        Of these.
    degraded : bool
        Whether the estimate should not be trusted.
    """

    number: int
    ratios: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    degraded: bool = False

    @classmethod
    def from_body(cls, number: int, body: BodyEstimate, degraded: bool = False) -> "Throw":
        """Throw of the body estimated at its end.

        Parameters
        ----------
        number : int
            Of its segment.
        body : BodyEstimate
            After the last epoch.
        degraded : bool
            Whether the estimate should not be trusted.

        Returns
        -------
        Throw
            Its ratios with their covariance.
        """
        return cls(number, body.principal_moments[:2], body.principal_moments_cov[:2, :2], degraded)


def throws_figure(throws: Sequence[Throw], reference: Float[np.ndarray, "2"] | None = None) -> Figure:
    """Ratios of every throw against one another with 95% ellipses, and each ratio by throw.

    Parameters
    ----------
    throws : sequence of Throw
        One for each segment.
    reference : ndarray of float, shape (2,) or None
        Jmin / Jmax and Jmid / Jmax as known otherwise, drawn as a cross and lines.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(13.0, 6.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15))
    plane = figure.add_subplot(grid[:, 0])
    _plane(plane, throws, reference)
    strips = [figure.add_subplot(grid[row, 1]) for row in range(2)]
    for index, (axes, name) in enumerate(
        zip(strips, ("$J_{min}/J_{max}$", "$J_{mid}/J_{max}$"), strict=True)
    ):
        _strip(axes, throws, reference, index)
        axes.set_ylabel(f"{name}  [-]")
    strips[0].tick_params(labelbottom=False)
    strips[1].set_xlabel("segment of the recording")
    sound = [throw for throw in throws if not throw.degraded]
    figure.suptitle(f"Inertia of {len(throws)} throws{_spread(sound)}", fontsize="large")
    legend_below(figure, _handles(reference is not None, len(sound) < len(throws)))
    return figure


def _plane(axes: Axes, throws: Sequence[Throw], reference: np.ndarray | None) -> None:
    scale = float(np.sqrt(chdtri(2, 1.0 - ELLIPSE_PROBABILITY)))
    low, high = _limits(throws, reference)
    for throw in throws:
        colour = GREY if throw.degraded else BLUE
        values, vectors = np.linalg.eigh(throw.covariance)
        width, height = 2 * scale * np.sqrt(np.maximum(values, 0.0))
        angle = float(np.rad2deg(np.arctan2(vectors[1, 0], vectors[0, 0])))
        centre = tuple(np.clip(throw.ratios, low, high).tolist())
        axes.add_patch(
            Ellipse(centre, width, height, angle=angle, facecolor="none", edgecolor=colour, alpha=0.45)
        )
        axes.plot(
            *centre, "o", color=colour, markerfacecolor="none" if throw.degraded else colour, markersize=5
        )
        if throw.degraded:
            towards = np.where(np.array(centre) > (low + high) / 2, (-14, -12), (5, 4))
            offset = (float(towards[0]), float(towards[1]))
            axes.annotate(str(throw.number), centre, xytext=offset, textcoords="offset points", color=GREY)
    if reference is not None:
        axes.plot(*reference, "x", color=RED, markersize=12, markeredgewidth=2.5, zorder=5)
    _no_body(axes)
    axes.set(xlabel="$J_{min}/J_{max}$  [-]", ylabel="$J_{mid}/J_{max}$  [-]")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    tidy(axes)


def _no_body(axes: Axes) -> None:
    """Shade where the triangle inequality or the order of the moments fails."""
    for corners in ([(0, 0), (1, 0), (0, 1)], [(0, 0), (2, 2), (2, 0)], [(0, 1), (2, 1), (2, 2), (0, 2)]):
        axes.add_patch(Polygon(corners, facecolor=BLACK, alpha=0.08, linewidth=0, zorder=0))


def _limits(throws: Sequence[Throw], reference: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Limits that show sound throws and the reference, and the ellipse of a throw of usual size."""
    shown = [throw for throw in throws if not throw.degraded] or list(throws)
    points = [throw.ratios for throw in shown]
    points = np.array(points if reference is None else [*points, reference])
    low, high = points.min(axis=0), points.max(axis=0)
    # an ellipse reaches `scale` deviations along each axis; the median, so that one vague throw does not hide the others
    scale = float(np.sqrt(chdtri(2, 1.0 - ELLIPSE_PROBABILITY)))
    deviations = np.array([np.sqrt(np.diagonal(throw.covariance)) for throw in shown])
    reach = 1.1 * scale * np.median(np.nan_to_num(deviations, nan=0.0, posinf=0.0), axis=0)
    margin = np.maximum.reduce([0.5 * (high - low), reach, np.full(2, 0.01)])
    return np.maximum(low - margin, 0.0), np.minimum(high + margin, 1.02)


def _strip(axes: Axes, throws: Sequence[Throw], reference: np.ndarray | None, index: int) -> None:
    low, high = _limits(throws, reference)
    for throw in throws:
        colour = GREY if throw.degraded else BLUE
        axes.errorbar(
            throw.number,
            np.clip(throw.ratios[index], low[index], high[index]),
            1.96 * np.sqrt(throw.covariance[index, index]),
            fmt="o",
            color=colour,
            markerfacecolor="none" if throw.degraded else colour,
            markersize=4.5,
            capsize=2.5,
            linewidth=1.0,
        )
    if reference is not None:
        axes.axhline(reference[index], color=RED, linewidth=1.5, zorder=1)
    axes.set_ylim(low[index], high[index])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    tidy(axes)


def _spread(throws: Sequence[Throw]) -> str:
    """Median and scatter of the sound throws, in words."""
    if len(throws) < 2:
        return ""
    ratios = np.array([throw.ratios for throw in throws])
    median, scatter = np.median(ratios, axis=0), np.std(ratios, axis=0, ddof=1)
    return f": {median[0]:.3f} ± {scatter[0]:.3f} and {median[1]:.3f} ± {scatter[1]:.3f} (median, scatter)"


def _handles(has_reference: bool, has_degraded: bool) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], linestyle="none", marker="o", color=BLUE, label="throw, 95% of its covariance")
    ]
    if has_degraded:
        hollow = Line2D([], [], linestyle="none", marker="o", color=GREY, markerfacecolor="none")
        hollow.set_label("degraded, with its segment (on the border: outside)")
        handles.append(hollow)
    if has_reference:
        handles.append(
            Line2D([], [], linestyle="none", marker="x", color=RED, markersize=9, label="reference")
        )
    return [*handles, Patch(color=BLACK, alpha=0.1, label="no rigid body, or moments out of order")]
