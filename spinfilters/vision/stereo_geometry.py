"""Projection into a rectified pair, and search for near neighbours."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from spinfilters.data.camera import StereoRig

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
    """Pairs of a place and another that are not farther apart than a radius."""
    found = KDTree(places).sparse_distance_matrix(KDTree(others), radius, output_type="coo_matrix")
    return NearPairs(found.row.astype(int), found.col.astype(int), found.data)
