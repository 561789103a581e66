"""Figures of free rotation without a recording: polhode and herpolhode, cones, stability of spins, tumbling or spinning target."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from spinfilters.core.conventions import RPM
from spinfilters.core.polhode import Polhode, are_of_rigid_body, nearest_possible_moments, polhode_of_moments
from spinfilters.core.rolling_motion import (
    AxisStability,
    Cones,
    RollingMotion,
    Stability,
    axis_stability,
    cones,
    rolling_motion,
)
from spinfilters.core.spin_threshold import InspectionMission, spin_threshold
from spinfilters.plots.scene import draw_ellipsoid, draw_on_ellipsoid, draw_wires, faces_viewer
from spinfilters.plots.style import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, PURPLE, RED, legend_below, tidy

ELEVATION, AZIMUTH = 24.0, -40.0
"""Direction of view of all figures in space, degrees."""
ZOOM = 0.85
"""Size of what is drawn in space, so that labels of the axes find room."""


def polhode_figure(moments: Float[np.ndarray, "3"], rate: Float[np.ndarray, "3"]) -> Figure:
    """Polhode on both ellipsoids, herpolhode on the invariable plane, and rates over time.

    Parameters
    ----------
    moments : Float[np.ndarray, "3"]
        Principal moments, kg m^2; those of no rigid body are drawn, and the title says so.
    rate : Float[np.ndarray, "3"]
        Body rate at t = 0 in principal axes, rad/s.

    Returns
    -------
    Figure
        As Figures 2-6, 2-7 and 2-9 of Tweddle (2013), with what happens over time.
    """
    curves, motion = polhode_of_moments(moments, rate), rolling_motion(moments, rate)
    figure = Figure(figsize=(12.0, 6.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0))
    space = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
    assert isinstance(space, Axes3D)
    _draw_polhode(space, curves, rate)
    _draw_herpolhode(figure.add_subplot(grid[0, 1]), motion)
    _draw_rates(figure.add_subplot(grid[1, 1]), motion)
    figure.suptitle(_title(moments, rate, curves))
    legend_below(
        figure,
        [
            *_polhode_handles("polhode and herpolhode"),
            *(
                Line2D([], [], color=c, label=f"rate about {n}")
                for n, c in zip("xyz", AXIS_COLOURS, strict=True)
            ),
        ],
    )
    return figure


def possible_body_figure(moments: Float[np.ndarray, "3"], rate: Float[np.ndarray, "3"]) -> Figure:
    """Polhode of moments that no rigid body has beside that of the nearest body that can exist.

    Parameters
    ----------
    moments : Float[np.ndarray, "3"]
        Principal moments, kg m^2.
    rate : Float[np.ndarray, "3"]
        Body rate at t = 0 in principal axes, rad/s.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(12.0, 6.0), layout="constrained")
    both = (
        (moments, "no rigid body:"),
        (nearest_possible_moments(moments), "a thin plate, the nearest body:"),
    )
    for column, (own, words) in enumerate(both, start=1):
        axes = figure.add_subplot(1, 2, column, projection="3d", computed_zorder=False)
        assert isinstance(axes, Axes3D)
        curves = polhode_of_moments(own, rate)
        _draw_polhode(axes, curves, rate, zoom=0.72)  # labels of the axes stay above the legend
        axes.set_title(f"{words} J = {_numbers(own)}\npolhode {curves.kind.value}")
    legend_below(figure, _polhode_handles("polhode"))
    return figure


def cones_figure(moments: Float[np.ndarray, "3"], rate: Float[np.ndarray, "3"]) -> Figure:
    """Space cone and body cone at t = 0, the momentum along z, and the invariable plane.

    As Figures 2-8 and 2-10 of Tweddle (2013); of a body without an axis of symmetry both cones are not circular.

    Parameters
    ----------
    moments : Float[np.ndarray, "3"]
        Principal moments, kg m^2.
    rate : Float[np.ndarray, "3"]
        Body rate at t = 0 in principal axes, rad/s.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    motion, circular = rolling_motion(moments, rate), cones(moments, rate)
    body = (
        motion.body_rate[motion.time <= motion.period] @ motion.axes[0].T
    )  # the polhode, placed as the body is at t = 0
    space = motion.space_rate if circular is None else motion.space_rate[_first_turn(motion.space_rate)]
    figure = Figure(figsize=(7.4, 6.8), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    assert isinstance(axes, Axes3D)
    points = np.concatenate([motion.space_rate, body, np.zeros((1, 3))])
    _draw_plane(axes, motion, 1.25 * float(np.abs(points[:, :2]).max()))
    _draw_cone(axes, space, BLUE)
    _draw_cone(axes, body, RED)
    reach = 1.25 * float(np.linalg.norm(rate))
    _draw_ray(axes, np.array([0.0, 0.0, 1.0]) * reach, BLACK)
    axis = (
        int(np.argmax(np.abs(motion.axes[0].T @ motion.space_rate[0]) * moments))
        if circular is None
        else circular.axis
    )
    symmetry = motion.axes[0][:, axis] * math.copysign(1.0, motion.body_rate[0, axis])
    _draw_ray(axes, symmetry * reach, PURPLE)
    axes.plot(*np.stack([np.zeros(3), motion.space_rate[0]]).T, color=GREEN, linewidth=2.2, zorder=6)
    axes.scatter(*motion.space_rate[0], color=GREEN, s=40, depthshade=False, zorder=7)
    _space_axes(axes, np.concatenate([points, symmetry[np.newaxis] * reach, [[0.0, 0.0, reach]]]), "space")
    axes.set_title(_cones_title(circular))
    legend_below(
        figure,
        [
            Patch(color=BLUE, alpha=0.4, label="space cone"),
            Patch(color=RED, alpha=0.4, label="body cone"),
            Patch(color=GREY, alpha=0.2, label="invariable plane"),
            Line2D([], [], color=BLACK, label="angular momentum"),
            Line2D([], [], color=PURPLE, label="axis of the body"),
            Line2D([], [], color=GREEN, marker="o", label="rate at t = 0"),
        ],
    )
    return figure


def stability_figure(moments: Float[np.ndarray, "3"], spin_rate: float, disturbance: float = 0.02) -> Figure:
    """Rates of spins that begin near each principal axis, with the roots of the linearised motion.

    Parameters
    ----------
    moments : Float[np.ndarray, "3"]
        Principal moments of a rigid body, kg m^2.
    spin_rate : float
        Rate about each axis in turn, rad/s; not zero.
    disturbance : float
        Rate about the other two axes, as a part of ``spin_rate``.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(8.0, 7.4), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    duration = 12.0 * 2.0 * math.pi / abs(spin_rate)
    for axes, stability in zip(panels, axis_stability(moments, spin_rate), strict=True):
        start = np.where(np.arange(3) == stability.axis, 1.0, disturbance) * spin_rate
        motion = rolling_motion(moments, start, duration)
        for component, colour in enumerate(AXIS_COLOURS):
            axes.plot(motion.time, motion.body_rate[:, component] / RPM, color=colour, linewidth=1.6)
        axes.set_ylabel("body rate [rpm]")
        axes.set_title(_stability_text(stability), loc="left", fontsize="medium")
        tidy(axes)
    panels[-1].set_xlabel("time [s]")
    legend_below(
        figure,
        [Line2D([], [], color=c, label=f"about {n}") for n, c in zip("xyz", AXIS_COLOURS, strict=True)],
    )
    return figure


def spin_threshold_figure(
    missions: Mapping[str, InspectionMission], rates: Mapping[str, float] | None = None
) -> Figure:
    """Rates up to which a target tumbles, over the distance of station keeping; a panel per mission.

    Parameters
    ----------
    missions : mapping
        Missions by name; at least one.
    rates : mapping, optional
        Rates of targets to mark, rad/s by name.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    figure = Figure(figsize=(max(6.4, 5.2 * len(missions)), 4.8), layout="constrained")
    panels = figure.subplots(1, len(missions), squeeze=False)[0]
    for axes, (name, mission) in zip(panels, missions.items(), strict=True):
        _draw_threshold(axes, name, mission, rates or {})
    panels[0].set_ylabel("rate of the target [rpm]")
    handles, _ = panels[0].get_legend_handles_labels()
    legend_below(figure, handles)
    return figure


def _draw_polhode(axes: Axes3D, curves: Polhode, rate: Float[np.ndarray, "3"], zoom: float = ZOOM) -> None:
    """Both ellipsoids and both curves; what lies behind the ellipsoid is drawn faintly."""
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    draw_ellipsoid(axes, curves.energy_semi_axes, BLUE)
    draw_wires(axes, curves.momentum_semi_axes, RED)
    for curve in curves.curves:
        draw_on_ellipsoid(axes, curve, curves.energy_semi_axes, BLACK, 2.2)
    faint = 1.0 if faces_viewer(axes, rate[np.newaxis], curves.energy_semi_axes)[0] else 0.45
    axes.plot(*np.stack([np.zeros(3), rate]).T, color=GREEN, linewidth=2.0, alpha=faint, zorder=4)
    axes.scatter(*rate, color=GREEN, s=45, alpha=faint, depthshade=False, zorder=5)
    extent = np.maximum(curves.energy_semi_axes, curves.momentum_semi_axes)
    _space_axes(axes, np.stack([-extent, extent]), "body", zoom)


def _polhode_handles(curve: str) -> list[Patch | Line2D]:
    """Legend of both ellipsoids, the black curve and the rate."""
    return [
        Patch(color=BLUE, alpha=0.35, label="constant energy"),
        Line2D([], [], color=RED, alpha=0.6, linewidth=0.7, label="constant momentum"),
        Line2D([], [], color=BLACK, linewidth=2.2, label=curve),
        Line2D([], [], color=GREEN, marker="o", label="rate at t = 0"),
    ]


def _draw_herpolhode(axes: Axes, motion: RollingMotion) -> None:
    """Path of the rate on the invariable plane, between its circles."""
    x, y, _ = motion.space_rate.T
    for radius in motion.herpolhode_radii:
        axes.add_patch(Circle((0.0, 0.0), radius, fill=False, color=GREY, linewidth=0.8, linestyle="--"))
    axes.plot(x, y, color=BLACK, linewidth=1.3)
    axes.plot(x[0], y[0], "o", color=GREEN)
    axes.plot(0.0, 0.0, "+", color=GREY)
    limit = 1.15 * max(motion.herpolhode_radii[1], 1e-3 * float(np.linalg.norm(motion.space_rate[0])))
    axes.set(
        xlim=(-limit, limit),
        ylim=(-limit, limit),
        aspect="equal",
        xlabel="across the momentum [rad/s]",
        title=f"herpolhode, {motion.plane_distance:.4g} rad/s along the momentum",
    )
    tidy(axes)


def _draw_rates(axes: Axes, motion: RollingMotion) -> None:
    for component, colour in enumerate(AXIS_COLOURS):
        axes.plot(motion.time, motion.body_rate[:, component], color=colour, linewidth=1.6)
    period = f"period {motion.period:.4g} s" if math.isfinite(motion.period) else "without a period"
    axes.set(xlabel="time [s]", ylabel="body rate [rad/s]", title=f"body rate, {period}")
    tidy(axes)


def _draw_cone(axes: Axes3D, path: Float[np.ndarray, "n 3"], colour: str) -> None:
    """Surface from the centre of mass to a path of the rate, and the path."""
    step = max(1, len(path) // 600)
    rim = path[::step]
    rays = np.stack([np.zeros_like(rim), rim])
    axes.plot_surface(*np.moveaxis(rays, -1, 0), color=colour, alpha=0.22, linewidth=0, rstride=1, cstride=1)
    axes.plot(*rim.T, color=colour, linewidth=1.8, zorder=5)


def _first_turn(path: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Points of a path about z up to its first full turn."""
    azimuth = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
    return np.abs(azimuth - azimuth[0]) <= 2.0 * math.pi


def _draw_plane(axes: Axes3D, motion: RollingMotion, half: float) -> None:
    x, y = np.meshgrid([-half, half], [-half, half])
    axes.plot_surface(x, y, np.full_like(x, motion.plane_distance), color=GREY, alpha=0.15, linewidth=0)


def _draw_ray(axes: Axes3D, end: Float[np.ndarray, "3"], colour: str) -> None:
    axes.plot(*np.stack([np.zeros(3), end]).T, color=colour, linewidth=1.6, zorder=6)


def _space_axes(axes: Axes3D, points: Float[np.ndarray, "n 3"], frame: str, zoom: float = ZOOM) -> None:
    """Equal scales about all points, few ticks, and labels clear of them."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, 0.15 * float((high - low).max()))
    axes.set(**{f"{n}lim": (middle[k] - half[k], middle[k] + half[k]) for k, n in enumerate("xyz")})
    x, y, z = (half / half.max()).tolist()
    axes.set_box_aspect((x, y, z), zoom=zoom)  # pyright: ignore[reportArgumentType]  (typed int, documented float)
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_major_locator(MaxNLocator(4, prune="both"))
        axis.set_label_text(f"$\\omega_{name}$, {frame} [rad/s]")
        axis.labelpad = 9.0


def _title(moments: Float[np.ndarray, "3"], rate: Float[np.ndarray, "3"], curves: Polhode) -> str:
    title = f"J = {_numbers(moments)}, rate {_numbers(rate)} rad/s: polhode {curves.kind.value}"
    if are_of_rigid_body(np.asarray(moments)):
        return title
    name = ("Jxx", "Jyy", "Jzz")[int(np.argmax(moments))]
    return f"{title}\nno rigid body has these moments: {name} exceeds the sum of the other two"


def _numbers(values: Float[np.ndarray, "3"]) -> str:
    return f"({', '.join(f'{each:.4g}' for each in np.asarray(values).tolist())})"


def _cones_title(found: Cones | None) -> str:
    if found is None:
        return "cones of a body without an axis of symmetry: not circular"
    angles = [math.degrees(a) for a in (found.body_half_angle, found.space_half_angle, found.nutation_angle)]
    name = "" if found.sense == "none" else f"{found.sense} nutation: "
    half = f"half angles of body and space cone {angles[0]:.3g} and {angles[1]:.3g} deg"
    return f"{name}{half},\naxis of the body {angles[2]:.3g} deg off the momentum"


def _stability_text(stability: AxisStability) -> str:
    text = f"near the {'xyz'[stability.axis]} axis: {stability.stability.name.lower()}"
    if stability.stability is Stability.UNSTABLE:
        return f"{text}, disturbances grow with {stability.growth_rate:.3g} 1/s"
    if stability.stability is Stability.STABLE:
        return f"{text}, nutates with {stability.nutation_frequency:.3g} rad/s"
    return text


def _draw_threshold(axes: Axes, name: str, mission: InspectionMission, rates: Mapping[str, float]) -> None:
    """Both limits in rpm, the regions they divide, and the mission's own threshold."""
    radii = mission.station_keeping_radius * np.geomspace(0.1, 10.0, 121)
    limits = [spin_threshold(replace(mission, station_keeping_radius=float(radius))) for radius in radii]
    overall = np.array([limit.overall for limit in limits]) / RPM
    own = spin_threshold(mission).overall / RPM
    axes.loglog(radii, [limit.force / RPM for limit in limits], color=BLUE, label="limit by thrust")
    by_propellant = [limit.mass_fraction / RPM for limit in limits]
    axes.loglog(radii, by_propellant, color=RED, linestyle="--", label="limit by propellant")
    marked = [abs(rate) / RPM for rate in rates.values()]
    bottom = min([0.3 * overall.min(), *(0.5 * each for each in marked if each > 0)])
    top = max([5.0 * overall.max(), *(2.0 * each for each in marked)])
    axes.fill_between(radii, bottom, overall, color=GREEN, alpha=0.15, linewidth=0)
    axes.plot(mission.station_keeping_radius, own, "o", color=BLACK, label="threshold of the mission")
    for (target, _), rpm, colour in zip(
        rates.items(), marked, (PURPLE, GREY, GREEN) * len(marked), strict=False
    ):
        axes.axhline(rpm, color=colour, linewidth=1.4, label=f"{target}: {rpm:.3g} rpm")
    axes.set_title(f"{name}: {own:.4g} rpm at {mission.station_keeping_radius:g} m")
    axes.set(xlim=(radii[0], radii[-1]), ylim=(bottom, top), xlabel="distance of station keeping [m]")
    axes.text(0.04, 0.06, "tumbles: its rate may be ignored", transform=axes.transAxes)
    axes.text(0.96, 0.93, "spins: its rate must be estimated", transform=axes.transAxes, ha="right")
    axes.grid(alpha=0.3, which="both")
