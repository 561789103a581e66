"""Figures of torque-free motion: polhodes, stability of three spins, tumbling or spinning."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from spinfilters.conventions import RPM
from spinfilters.dynamics.axis_stability import AxisStability, Stability
from spinfilters.dynamics.polhode import Polhode, PolhodeKind
from spinfilters.dynamics.spin_threshold import InspectionMission, spin_threshold
from spinfilters.dynamics.torque_free import TorqueFreeMotion
from spinfilters.plots.space import draw_ellipsoid, draw_wires, space_figure

BLUE: Final[str] = "#0072B2"
RED: Final[str] = "#D55E00"
GREEN: Final[str] = "#009E73"
BLACK: Final[str] = "#222222"
"""Colours of Okabe and Ito, which stay apart for colour-blind readers."""

AXIS_COLOURS: Final[tuple[str, str, str]] = (BLUE, RED, GREEN)


def polhode_figure(polhode: Polhode, rate: Float[np.ndarray, "3"]) -> Figure:
    """Momentum and energy ellipsoids, their polhode and the rate (rad/s), in body axes (as Figure 2-6)."""
    figure, axes = space_figure(7.0, 6.6)
    draw_ellipsoid(axes, polhode.energy_semi_axes, BLUE)
    draw_wires(axes, polhode.momentum_semi_axes, RED)
    for curve in polhode.curves:
        marker = "o" if polhode.kind is PolhodeKind.POINT else None
        axes.plot(*curve.T, color=BLACK, linewidth=2.2, marker=marker, markersize=5, zorder=3)
    axes.plot(*np.stack([np.zeros(3), rate]).T, color=GREEN, linewidth=2.0, zorder=4)
    axes.scatter(*rate, color=GREEN, s=45, depthshade=False, zorder=5)
    axes.set_title(f"Polhode: {polhode.kind.value}")
    _body_rate_axes(axes, np.maximum(polhode.energy_semi_axes, polhode.momentum_semi_axes))
    figure.legend(
        handles=[
            Patch(color=BLUE, alpha=0.35, label="constant energy"),
            Line2D([], [], color=RED, alpha=0.6, linewidth=0.7, label="constant momentum"),
            Line2D([], [], color=BLACK, linewidth=2.2, label="polhode (both)"),
            Line2D([], [], color=GREEN, marker="o", label="rate at t = 0"),
        ],
        loc="outside lower center",
        ncols=4,
        frameon=False,
    )
    return figure


def axis_stability_figure(
    motions: Sequence[TorqueFreeMotion], stabilities: Sequence[AxisStability]
) -> Figure:
    """Rates over time beside each axis, one panel per motion.

    A spin that starts beside the axis of its stability.
    """
    figure = Figure(figsize=(8.0, 2.3 * len(motions) + 0.7), layout="constrained")
    panels = figure.subplots(len(motions), 1, sharex=True, squeeze=False)[:, 0]
    for axes, motion, stability in zip(panels, motions, stabilities, strict=True):
        for component, (name, colour) in enumerate(zip("xyz", AXIS_COLOURS, strict=True)):
            label = f"$\\omega_{name}$"
            axes.plot(motion.time, motion.rate[:, component], color=colour, linewidth=1.6, label=label)
        axes.set_ylabel("body rate [rad/s]")
        axes.set_title(_stability_text(stability), loc="left", fontsize="medium")
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("time [s]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False)
    return figure


def spin_threshold_figure(
    missions: Mapping[str, InspectionMission], radii: Float[np.ndarray, " n"]
) -> Figure:
    """Threshold against station-keeping radius (m), a panel per mission, its own radius marked."""
    figure = Figure(figsize=(5.2 * len(missions), 4.6), layout="constrained")
    panels = figure.subplots(1, len(missions), squeeze=False)[0]
    for axes, (name, mission) in zip(panels, missions.items(), strict=True):
        _threshold_panel(axes, name, mission, radii)
    panels[0].set_ylabel("rate of the target [rpm]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _body_rate_axes(axes: Axes3D, extent: Float[np.ndarray, "3"]) -> None:
    """Equal body-rate axes of +-extent, rad/s.

    Few ticks, and labels clear of them and of the legend.
    """
    x, y, z = extent if np.all(extent > 0.0) else np.ones(3)
    axes.set(xlim=(-x, x), ylim=(-y, y), zlim=(-z, z))
    axes.set_box_aspect((x, y, z), zoom=0.85)  # pyright: ignore[reportArgumentType]  (typed int, documented float)
    axes.view_init(elev=24, azim=-40)
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_major_locator(MaxNLocator(5, prune="both"))
        axis.set_label_text(f"$\\omega_{name}$ [rad/s]")
        axis.labelpad = 9.0


def _stability_text(stability: AxisStability) -> str:
    """Title of a panel: axis, verdict and root."""
    text = f"spin beside the {'xyz'[stability.axis]} axis: {stability.stability.name.lower()}"
    if stability.stability is Stability.UNSTABLE:
        return f"{text}, growth rate {stability.growth_rate:.3g} 1/s"
    if stability.stability is Stability.STABLE:
        return f"{text}, nutation {stability.nutation_frequency:.3g} rad/s"
    return text


def _threshold_panel(
    axes: Axes, name: str, mission: InspectionMission, radii: Float[np.ndarray, " n"]
) -> None:
    """Both limits in rpm, the regions they divide, and the mission's own threshold."""
    limits = [spin_threshold(replace(mission, station_keeping_radius=float(radius))) for radius in radii]
    overall = np.array([limit.overall for limit in limits]) / RPM
    axes.loglog(radii, [limit.force / RPM for limit in limits], color=BLUE, label="limit by thrust")
    axes.loglog(
        radii,
        [limit.mass_fraction / RPM for limit in limits],
        color=RED,
        linestyle="--",
        label="limit by propellant",
    )
    bottom, top = 0.3 * overall.min(), 5.0 * overall.max()
    axes.fill_between(radii, bottom, overall, color=GREEN, alpha=0.15, linewidth=0)
    own = spin_threshold(mission).overall / RPM
    axes.plot(mission.station_keeping_radius, own, "o", color=BLACK, label="mission (Table 1.1)")
    axes.set_title(f"{name}: {own:.3g} rpm at {mission.station_keeping_radius:g} m")
    axes.set(xlim=(radii[0], radii[-1]), ylim=(bottom, top), xlabel="station-keeping radius [m]")
    axes.text(0.04, 0.06, "tumbling: rate may be ignored", transform=axes.transAxes)
    axes.text(0.96, 0.93, "spinning: rate must be estimated", transform=axes.transAxes, ha="right")
    axes.grid(alpha=0.3, which="both")
