"""Projection into a rectified pair, search for near neighbours, and how well a rig can triangulate (Tweddle 2013, section 5.3)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.cameras import stereo_pair
from spinfilters.io.camera import StereoRig

NEAREST_DEPTH = 1e-3
"""m; nearer points are projected as if they were there."""


class NearPairs(NamedTuple):
    """Rows of places and of others, and how far apart they are."""

    place: Int[np.ndarray, " k"]
    other: Int[np.ndarray, " k"]
    distance: Float[np.ndarray, " k"]


def pixels_of(at: Float[np.ndarray, "n 3"], rig: StereoRig) -> Float[np.ndarray, "n 3"]:
    """(u_left, v_left, u_right) of points of the camera frame; not meant for points behind it."""
    z = np.maximum(at[:, 2], NEAREST_DEPTH)
    u, v = rig.left.fx * at[:, 0] / z + rig.left.cx, rig.left.fy * at[:, 1] / z + rig.left.cy
    return np.stack([u, v, u - rig.left.fx * rig.baseline_m / z], axis=1)


def points_of(pixels: Float[np.ndarray, "n 3"], rig: StereoRig) -> Float[np.ndarray, "n 3"]:
    """Triangulated points in the left camera's frame, m, of stereo measurements, px."""
    return stereo_pair(rig.calibration).points_of(pixels, rig.calibration)


def pixels_by_point(at: Float[np.ndarray, "n 3"], rig: StereoRig) -> Float[np.ndarray, "n 3 3"]:
    """Jacobian of the pixels by the point, px/m."""
    x, y, z = at.T
    J = np.zeros((len(at), 3, 3))
    J[:, 0, 0] = J[:, 2, 0] = rig.left.fx / z
    J[:, 1, 1] = rig.left.fy / z
    J[:, 0, 2], J[:, 1, 2] = -rig.left.fx * x / z**2, -rig.left.fy * y / z**2
    J[:, 2, 2] = -rig.left.fx * (x - rig.baseline_m) / z**2
    return J


def near_pairs(
    places: Float[np.ndarray, "n k"], others: Float[np.ndarray, "m k"], radius: float
) -> NearPairs:
    """Pairs of a place and another that are not farther apart than a radius, in the order of the places."""
    # of the others by row, those within the radius of a place's row stand together
    order = np.argsort(others[:, 1], kind="stable")
    rows = others[order, 1]
    first = np.searchsorted(rows, places[:, 1] - radius)
    counts = np.searchsorted(rows, places[:, 1] + radius, side="right") - first
    place = np.repeat(np.arange(len(places)), counts)
    other = order[np.arange(len(place)) + np.repeat(first - np.cumsum(counts) + counts, counts)]
    beside = np.flatnonzero(np.abs(places[place, 0] - others[other, 0]) <= radius)
    place, other = place[beside], other[beside]
    distance = np.linalg.norm(places[place] - others[other], axis=1)
    near = distance <= radius
    return NearPairs(place[near], other[near], distance[near])


@dataclass(frozen=True)
class RigAccuracy:
    """Accuracy of a point half-way between the cameras' axes.

    Attributes
    ----------
    by_column, by_row : ndarray of shape (3,)
        How far one pixel in the left column, or in both rows, moves the triangulated point, m.
    std : ndarray of shape (3,)
        Of its coordinates with white noise on (u_left, v_left, u_right), m.
    nearest : float
        Distance at which both cameras begin to see it, m (Eq. 5.2).
    farthest : float
        Where its disparity is one pixel, m.
    """

    by_column: Float[np.ndarray, " 3"]
    by_row: Float[np.ndarray, " 3"]
    std: Float[np.ndarray, " 3"]
    nearest: float
    farthest: float


def rig_accuracy(rig: StereoRig, distance: float, pixel_std: float) -> RigAccuracy:
    """Accuracy at a distance, m, with so much noise of each pixel coordinate."""
    point = np.array([[rig.baseline_m / 2, 0.0, distance]])
    pixels = pixels_of(point, rig)
    moved = [points_of(pixels + step, rig)[0] - point[0] for step in ([1.0, 0, 0], [0, 1.0, 0])]
    inverse = np.linalg.inv(pixels_by_point(point, rig)[0])
    std = pixel_std * np.sqrt(np.diag(inverse @ inverse.T))
    half_angle = np.arctan(rig.left.width / 2 / rig.left.fx)
    return RigAccuracy(
        moved[0],
        moved[1],
        std,
        float(rig.baseline_m / 2 / np.tan(half_angle)),
        float(rig.baseline_m * rig.left.fx),
    )
