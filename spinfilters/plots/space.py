"""What three-dimensional figures share: equal scales, ellipsoids, arrows, a camera."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from spinfilters.data.camera import Rig
from spinfilters.geometry.cameras import monocular_camera


def space_figure(width: float, height: float) -> tuple[Figure, Axes3D]:
    """A figure (inches) with three-dimensional axes that draw in the order of zorder."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    assert isinstance(axes, Axes3D)
    return figure, axes


def equal_scales(axes: Axes3D, points: Float[np.ndarray, "n 3"], zoom: float = 0.9) -> None:
    """Limits that hold all points at the same scale along all axes, and few ticks."""
    low, high = points.min(axis=0), points.max(axis=0)
    least = 0.25 * float((high - low).max()) or 1.0
    middle, half = (low + high) / 2, 0.54 * np.maximum(high - low, least)
    for k, name in enumerate(("x", "y", "z")):
        getattr(axes, f"set_{name}lim")(middle[k] - half[k], middle[k] + half[k])
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4, prune="both"))
    x, y, z = (half / half.max()).tolist()
    axes.set_box_aspect((x, y, z), zoom=zoom)  # pyright: ignore[reportArgumentType]  (typed int, documented float)


def draw_ellipsoid(axes: Axes3D, semi_axes: Float[np.ndarray, "3"], colour: str) -> None:
    """A translucent ellipsoid about the origin."""
    axes.plot_surface(*_ellipsoid(semi_axes), color=colour, alpha=0.2, linewidth=0, rstride=1, cstride=1)


def draw_wires(axes: Axes3D, semi_axes: Float[np.ndarray, "3"], colour: str) -> None:
    """Meridians and parallels of an ellipsoid about the origin."""
    axes.plot_wireframe(
        *_ellipsoid(semi_axes), color=colour, alpha=0.6, linewidth=0.7, rstride=4, cstride=4, zorder=2
    )


def frustum_edges(rig: Rig, depth: float) -> Float[np.ndarray, "8 2 3"]:
    """Edges of the left camera's field of view down to a depth (m), in camera axes."""
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
