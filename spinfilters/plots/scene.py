"""Figures in space: path, axes and landmarks before the camera, and the polhode on its ellipsoids."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.cameras import monocular_camera
from spinfilters.core.polhode import polhode
from spinfilters.evaluation.epoch_spans import FAR_ORIGIN, clock_text
from spinfilters.evaluation.estimated_motion import BodyRates, Trajectory
from spinfilters.io.camera import Rig
from spinfilters.models.body import BodyEstimate
from spinfilters.plots.style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    GREY,
    INITIALISATION,
    MOST_DRAWN,
    ORANGE,
    PRINCIPAL_NAMES,
    PURPLE,
    RED,
    SKY,
    legend_below,
    note_figure,
)


def space_figure(width: float, height: float) -> tuple[Figure, Axes3D]:
    """A figure (inches) with three-dimensional axes that draw in the order of zorder.

    Parameters
    ----------
    width : float
        Inches.
    height : float
        Inches.

    Returns
    -------
    figure : Figure
        With one panel.
    axes : Axes3D
        Its axes.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    assert isinstance(axes, Axes3D)
    return figure, axes


def equal_scales(axes: Axes3D, points: Float[np.ndarray, "n 3"], zoom: float = 0.9) -> None:
    """Limits that hold all points at the same scale along all axes, and few ticks.

    Parameters
    ----------
    axes : Axes3D
        Three-dimensional.
    points : ndarray of float, shape (n, 3)
        In the units of the axes.
    zoom : float
        Size of the box within its panel.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    least = 0.25 * float((high - low).max()) or 1.0
    middle, half = (low + high) / 2, 0.54 * np.maximum(high - low, least)
    for k, name in enumerate(("x", "y", "z")):
        getattr(axes, f"set_{name}lim")(middle[k] - half[k], middle[k] + half[k])
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4, prune="both"))
    x, y, z = (half / half.max()).tolist()
    axes.set_box_aspect((x, y, z), zoom=zoom)  # pyright: ignore[reportArgumentType]  (typed int, documented float)


def draw_ellipsoid(axes: Axes3D, semi_axes: Float[np.ndarray, "3"], colour: str) -> None:
    """A translucent ellipsoid about the origin.

    Parameters
    ----------
    axes : Axes3D
        Three-dimensional.
    semi_axes : ndarray of float, shape (3,)
        Along the axes, in their unit.
    colour : str
        Of matplotlib.
    """
    axes.plot_surface(*_ellipsoid(semi_axes), color=colour, alpha=0.2, linewidth=0, rstride=1, cstride=1)


def draw_wires(axes: Axes3D, semi_axes: Float[np.ndarray, "3"], colour: str) -> None:
    """Meridians and parallels of an ellipsoid about the origin.

    Parameters
    ----------
    axes : Axes3D
        Three-dimensional.
    semi_axes : ndarray of float, shape (3,)
        Along the axes, in their unit.
    colour : str
        Of matplotlib.
    """
    surface = np.moveaxis(_ellipsoid(semi_axes), 0, -1)
    meridians, parallels = np.moveaxis(surface[:, ::4], 1, 0), surface[::4]
    for line in (*meridians, *parallels):
        draw_on_ellipsoid(axes, line, semi_axes, colour, 0.7, 2)


def draw_on_ellipsoid(
    axes: Axes3D,
    curve: Float[np.ndarray, "n 3"],
    semi_axes: Float[np.ndarray, "3"],
    colour: str,
    width: float,
    order: int = 3,
) -> None:
    """A curve on an ellipsoid about the origin, faint where it lies on the far side.

    Parameters
    ----------
    axes : Axes3D
        Three-dimensional, seen from where it shall be drawn (`Axes3D.view_init`).
    curve : ndarray of float, shape (n, 3)
        Points of the ellipsoid.
    semi_axes : ndarray of float, shape (3,)
        Along the axes, in their unit.
    colour : str
        Of matplotlib.
    width : float
        Of the line, points.
    order : int
        Above what lower numbers have.
    """
    near = faces_viewer(axes, curve, semi_axes)
    changes = np.flatnonzero(near[1:] != near[:-1]) + 1
    for begin, end in pairwise([0, *changes.tolist(), len(curve)]):
        # every part ends at the first point of the next one, so that no gap opens between both
        x, y, z = curve[begin : end + 1].T
        axes.plot(x, y, z, color=colour, linewidth=width, alpha=1.0 if near[begin] else 0.25, zorder=order)


def faces_viewer(
    axes: Axes3D, points: Float[np.ndarray, "n 3"], semi_axes: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, " n"]:
    """Whether points of an ellipsoid are on its near side: the outward normal has a part towards the viewer.

    Parameters
    ----------
    axes : Axes3D
        Whose elevation and azimuth say where the viewer is.
    points : ndarray of float, shape (n, 3)
        Of the ellipsoid.
    semi_axes : ndarray of float, shape (3,)
        Along the axes, in their unit.

    Returns
    -------
    ndarray of bool, shape (n,)
        False for what the ellipsoid hides.
    """
    return (points / np.square(semi_axes)) @ viewer_direction(axes) >= 0.0


def viewer_direction(axes: Axes3D) -> Float[np.ndarray, "3"]:
    """Unit vector from the origin of three-dimensional axes to the viewer.

    Parameters
    ----------
    axes : Axes3D
        Whose elevation and azimuth say where the viewer is.
    """
    elevation, azimuth = np.deg2rad(axes.elev), np.deg2rad(axes.azim)
    return np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )


def frustum_edges(rig: Rig, depth: float) -> Float[np.ndarray, "8 2 3"]:
    """Edges of the left camera's field of view down to a depth (m), in camera axes.

    Parameters
    ----------
    rig : Rig
        Calibration of the camera.
    depth : float
        Of the far end, m.

    Returns
    -------
    ndarray of float, shape (8, 2, 3)
        Begin and end of every edge, m, camera axes.
    """
    corners = np.array(
        [[0, 0], [rig.left.width, 0], [rig.left.width, rig.left.height], [0, rig.left.height]], dtype=float
    )
    calibration = rig.left.calibration
    far = depth * monocular_camera(calibration).rays_of(corners, calibration)
    sides = np.stack([np.zeros_like(far), far], axis=1)
    return np.concatenate([sides, np.stack([far, np.roll(far, -1, axis=0)], axis=1)])


def _ellipsoid(semi_axes: np.ndarray) -> Float[np.ndarray, "3 25 49"]:
    longitude, latitude = np.meshgrid(np.linspace(0, 2 * np.pi, 49), np.linspace(-np.pi / 2, np.pi / 2, 25))
    x, y, z = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)
    return semi_axes[:, np.newaxis, np.newaxis] * np.stack([x, y, z])


_TO_VIEW = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Inertial axes (x right, y down, z forward) to axes of a figure whose third axis points up."""
_MOST_POINTS = 400
_EPOCHS = 4  # at which the principal axes are drawn
_ZOOM, _WIDE_ZOOM = (
    1.15,
    1.0,
)  # a path about the body is wide in both horizontal axes, and labels need the room
_INSPECTOR = ORANGE
_DOTS = (0, (1.0, 1.0))
_REVOLUTIONS = 4  # of the paths of axes: more is a ball of wool


@dataclass(frozen=True)
class DrawnCamera:
    """The camera of a scene.

    Attributes
    ----------
    rig : Rig
        Its calibration.
    inspector : CameraTrajectory or None
        Its known trajectory in i; None where it rests in the origin.
    """

    rig: Rig
    inspector: CameraTrajectory | None = None

    def poses(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """(t_ic m, q_ic) at these times, s; beyond the known trajectory its end.

        Parameters
        ----------
        time : ndarray of float, shape (n,)
            Times, s.

        Returns
        -------
        ndarray of float, shape (n, 7)
            Position in i, m, and attitude.
        """
        if self.inspector is None:
            return np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(time), 1))
        return self.inspector.at(np.clip(time, self.inspector.time[0], self.inspector.time[-1]))


def scene_figure(
    trajectory: Trajectory,
    body: BodyEstimate,
    camera: DrawnCamera | None = None,
    map_points: Float[np.ndarray, "k 3"] | None = None,
    initialisation: int = 0,
) -> Figure:
    """Path of the centre of mass with principal axes and landmarks.

    The axes at some times, the landmarks at the last.
    Without a position (a gyro) the paths of the principal axes on the unit sphere take their place. Frames that are not finite are
    left out; a note takes the place of a body that is not.

    Parameters
    ----------
    trajectory : Trajectory
        Motion of the body.
    body : BodyEstimate
        After the last epoch.
    camera : DrawnCamera or None
        Drawn at the last epoch when given, with its path where it moves.
    map_points : ndarray of float, shape (k, 3) or None
        Landmarks, m, frame g.
    initialisation : int
        How many of the first epochs a smoother made for a filter; dotted.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    held = np.flatnonzero(trajectory.is_finite)
    centre = np.zeros(3) if body.center_of_mass_g is None else body.center_of_mass_g
    if not held.size or not np.isfinite([*body.principal_axes_g, centre]).all():
        return note_figure("No scene: the body at the end is not finite")
    initialisation = int(np.searchsorted(held, initialisation))
    trajectory = trajectory.at(held)
    map_points = map_points if map_points is not None and len(map_points) else None
    if not trajectory.sees_position:
        return _directions_figure(trajectory, body, initialisation)
    figure, axes = space_figure(9.4, 7.4)
    rows = np.unique(np.linspace(0, len(trajectory.time) - 1, _EPOCHS).round().astype(int))
    size = _body_size(trajectory, body, map_points)
    shown = [_draw_axes(axes, trajectory, body, row, size, (1 + k) / len(rows)) for k, row in enumerate(rows)]
    if map_points is not None and body.center_of_mass_g is not None:
        shown.append(_draw_landmarks(axes, trajectory, map_points - body.center_of_mass_g, rows[-1]))
    shown.append(_draw_path(axes, trajectory, initialisation))
    if camera is not None:
        shown.append(_draw_camera(axes, camera, trajectory))
    equal_scales(axes, np.concatenate(shown), zoom=_WIDE_ZOOM if _moves(camera) else _ZOOM)
    _label_axes(axes, camera)
    axes.set_title(_title(trajectory.time[rows], map_points is not None), y=0.98)
    handles = _handles(camera, map_points is not None)
    legend_below(figure, [*handles, *_initialisation_handles(initialisation)])
    return figure


def _moves(camera: DrawnCamera | None) -> bool:
    return camera is not None and camera.inspector is not None


def _title(time: Float[np.ndarray, " n"], has_landmarks: bool) -> str:
    landmarks = ", landmarks at the last" if has_landmarks else ""
    return f"Principal axes {_times_in_words(time)} (stronger: later){landmarks}"


def _times_in_words(time: Float[np.ndarray, " n"]) -> str:
    """Times, s; of a clock whose origin is far, such as that of Unix, after the first of them."""
    first = float(time[0])
    if abs(first) < FAR_ORIGIN:
        return f"at t = {', '.join(f'{each:.1f}' for each in time)} s"
    return f"{', '.join(f'{each:.1f}' for each in time - first)} s after t = {clock_text(first)} s"


def _draw_path(axes: Axes3D, trajectory: Trajectory, initialisation: int) -> Float[np.ndarray, "n 3"]:
    """Draw the path of the centre of mass, dotted during the initialisation; its points."""
    path = trajectory.position @ _TO_VIEW.T
    axes.plot(*path[:initialisation].T, color=BLACK, linewidth=1.8, linestyle=_DOTS, zorder=6)
    axes.plot(*path[max(initialisation - 1, 0) :].T, color=BLACK, linewidth=1.8, zorder=6)
    return path


def _label_axes(axes: Axes3D, camera: DrawnCamera | None) -> None:
    moves = _moves(camera)
    depth, up = ("z of i", "-y of i") if moves else ("z, away from the camera", "-y, up")
    axes.set(xlabel="x of i [m]" if moves else "x [m]", ylabel=f"{depth} [m]", zlabel=f"{up} [m]")
    axes.view_init(elev=20, azim=-62)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.labelpad = 12.0


def _draw_axes(
    axes: Axes3D, trajectory: Trajectory, body: BodyEstimate, row: int, size: float, strength: float
) -> Float[np.ndarray, "3 3"]:
    """Draw the principal axes at one frame; their ends, for the limits."""
    R, r = matrix_from_quaternion(trajectory.q_ig[row]), trajectory.position[row]
    ends, centre = (r + size * body.principal_axes_g @ R.T) @ _TO_VIEW.T, r @ _TO_VIEW.T
    for end, colour in zip(ends, AXIS_COLOURS, strict=True):
        axes.plot(
            *np.stack([centre, end]).T, color=colour, linewidth=1.2 + strength, alpha=strength, zorder=5
        )
    axes.scatter(*centre, color=BLACK, s=14, depthshade=False, zorder=6)
    return ends


def _draw_landmarks(
    axes: Axes3D, trajectory: Trajectory, about_centre: np.ndarray, row: int
) -> Float[np.ndarray, "n 3"]:
    """Draw landmarks at one frame and give the drawn points.

    M, axes g, from the centre of mass; for the limits.
    """
    R = matrix_from_quaternion(trajectory.q_ig[row])
    step = max(1, len(about_centre) // _MOST_POINTS)
    points = (trajectory.position[row] + about_centre[::step] @ R.T) @ _TO_VIEW.T
    axes.scatter(*points.T, color=SKY, s=3, alpha=0.6, depthshade=False, zorder=3)
    return points


def _draw_camera(axes: Axes3D, camera: DrawnCamera, trajectory: Trajectory) -> Float[np.ndarray, "n 3"]:
    """Draw the left camera's path and its field of view at the last epoch; the drawn points, for the limits."""
    poses = camera.poses(trajectory.time)
    depth = 0.35 * float(np.linalg.norm(trajectory.position - poses[:, :3], axis=1).max())
    R_ic, path = matrix_from_quaternion(poses[-1, 3:]), poses[:, :3] @ _TO_VIEW.T
    edges = (frustum_edges(camera.rig, depth) @ R_ic.T + poses[-1, :3]) @ _TO_VIEW.T
    axes.add_collection3d(Line3DCollection(list(edges), colors=GREY, linewidths=1.0))
    if camera.inspector is not None:
        axes.plot(*path.T, color=_INSPECTOR, linewidth=1.8, zorder=4)
    return np.concatenate([edges.reshape(-1, 3), path])


def _body_size(trajectory: Trajectory, body: BodyEstimate, map_points: np.ndarray | None) -> float:
    """Length in m of the drawn axes.

    Somewhat more than the landmarks' distance, or a tenth of the range.
    """
    if map_points is not None and body.center_of_mass_g is not None:
        return 1.3 * float(np.median(np.linalg.norm(map_points - body.center_of_mass_g, axis=1)))
    return 0.1 * float(np.linalg.norm(trajectory.position, axis=1).max())


def _directions_figure(trajectory: Trajectory, body: BodyEstimate, initialisation: int) -> Figure:
    figure, axes = space_figure(8.0, 7.2)
    last = _last_revolutions(trajectory)
    paths = matrix_from_quaternion(trajectory.q_ig[last:]) @ body.principal_axes_g.T
    for k, colour in enumerate(AXIS_COLOURS):
        before = max(initialisation - last, 0)
        axes.plot(*paths[:before, :, k].T, color=colour, linewidth=1.1, linestyle=_DOTS, zorder=3)
        axes.plot(*paths[max(before - 1, 0) :, :, k].T, color=colour, linewidth=1.1, zorder=3)
        axes.plot(*np.stack([np.zeros(3), paths[-1, :, k]]).T, color=colour, linewidth=2.2, zorder=5)
    momentum = _momentum_direction(trajectory, body)
    axes.plot(*np.stack([np.zeros(3), 1.3 * momentum]).T, color=BLACK, linewidth=2.2, zorder=6)
    equal_scales(axes, np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]) * 1.2, zoom=1.05)
    axes.set(xlabel="x of i [-]", ylabel="y of i [-]", zlabel="z of i [-]")
    axes.view_init(elev=22, azim=-52)
    axes.set_title(f"Directions of the principal axes in space, last {_REVOLUTIONS} revolutions")
    momentum_handle = Line2D([], [], color=BLACK, linewidth=2.2, label="angular momentum (mean)")
    begun = _initialisation_handles(max(initialisation - last, 0))
    legend_below(figure, [*_axis_handles(), momentum_handle, *begun])
    return figure


def _last_revolutions(trajectory: Trajectory) -> int:
    """The first row of the last `_REVOLUTIONS` revolutions, by the angle that the body has turned through."""
    turned = np.linalg.norm(trajectory.rate_i[1:], axis=1) * np.diff(trajectory.time)
    to_the_end = np.cumsum(turned[::-1])
    return max(len(turned) - int(np.searchsorted(to_the_end, 2 * np.pi * _REVOLUTIONS)), 0)


def _momentum_direction(trajectory: Trajectory, body: BodyEstimate) -> Float[np.ndarray, "3"]:
    step = -(-len(trajectory.time) // MOST_DRAWN)
    R_ib = matrix_from_quaternion(trajectory.q_ig[::step]) @ body.principal_axes_g.T
    rate_b = np.einsum("nij,ni->nj", R_ib, trajectory.rate_i[::step])
    momentum = np.einsum("nij,nj->i", R_ib, body.principal_moments * rate_b)
    length = float(np.linalg.norm(momentum))
    return momentum / length if length > 0 else momentum


def _initialisation_handles(epochs: int) -> list[Line2D]:
    """Legend entry of the dotted paths, none without any."""
    dotted = Line2D([], [], color=BLACK, linewidth=1.8, linestyle=_DOTS, label=INITIALISATION)
    return [dotted] if epochs else []


def _axis_handles() -> list[Line2D]:
    return [
        Line2D([], [], color=colour, linewidth=1.8, label=f"{name} axis")
        for name, colour in zip(PRINCIPAL_NAMES, AXIS_COLOURS, strict=True)
    ]


def _handles(camera: DrawnCamera | None, has_map: bool) -> list[Line2D]:
    handles = [*_axis_handles(), Line2D([], [], color=BLACK, linewidth=1.8, label="centre of mass")]
    if has_map:
        handles.append(
            Line2D([], [], linestyle="none", marker="o", markersize=3, color=SKY, label="landmarks")
        )
    if camera is not None:
        handles.append(Line2D([], [], color=GREY, label="view of the left camera"))
    if camera is not None and camera.inspector is not None:
        handles.append(Line2D([], [], color=_INSPECTOR, linewidth=1.8, label="path of the inspector"))
    return handles


_MOST_DOTS = 2000  # more lie upon one another


def estimated_polhode_figure(rates: BodyRates, body: BodyEstimate, initialisation: int = 0) -> Figure:
    """Estimated rates in principal axes with ellipsoids and polhode.

    Axes g; of the last rate; a note where that is not finite.

    Parameters
    ----------
    rates : BodyRates
        In axes g.
    body : BodyEstimate
        After the last epoch.
    initialisation : int
        How many of the first epochs a smoother made for a filter; hollow.

    Returns
    -------
    Figure
        Not yet saved or shown.
    """
    path = np.rad2deg(rates.in_axes(body.principal_axes_g).rate)
    if not np.isfinite(path[-1]).all():
        return note_figure(
            f"{rates.label.upper()}: no polhode, the rate or the inertia at the end is not finite"
        )
    curve = polhode(body.principal_moments, path[-1])
    figure, axes = space_figure(8.6, 6.8)
    axes.view_init(elev=22, azim=-52)
    draw_ellipsoid(axes, curve.energy_semi_axes, BLUE)
    draw_wires(axes, curve.momentum_semi_axes, RED)
    for branch in curve.curves:
        draw_on_ellipsoid(axes, branch, curve.energy_semi_axes, BLACK, 1.6)
    dots = _draw_rates(axes, rates.time, path, initialisation)
    figure.colorbar(dots, ax=axes, shrink=0.6, pad=0.12, label="estimated rate at time [s]")
    extent = np.maximum(curve.energy_semi_axes, curve.momentum_semi_axes)
    equal_scales(axes, np.stack([-extent, extent]), zoom=1.0)
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), PRINCIPAL_NAMES, strict=True):
        axis.set_label_text(f"{name} axis [deg/s]")
        axis.labelpad = 8.0
    minor, middle, _ = body.principal_moments
    moments = f"moments of inertia {minor:.3f} : {middle:.3f} : 1"
    axes.set_title(f"{rates.label.upper()}: rate goes {curve.kind.value}\n{moments}")
    hollow = Line2D(
        [], [], linestyle="none", marker="o", color=PURPLE, markerfacecolor="none", label=INITIALISATION
    )
    legend_below(
        figure,
        [
            Patch(color=BLUE, alpha=0.35, label="constant energy"),
            Line2D([], [], color=RED, linewidth=0.7, label="constant momentum"),
            Line2D([], [], color=BLACK, linewidth=1.6, label="polhode of the last rate (both branches)"),
            *([hollow] if initialisation else []),
        ],
    )
    return figure


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
