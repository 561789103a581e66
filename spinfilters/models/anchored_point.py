"""Coordinates of a landmark in which one sighting of it is Gaussian.

Depth from a pair of cameras is bent: its error is Gaussian in disparity, not in metres, and the bend has the same sign for every
landmark, so that hundreds of them turn it into a bias. A landmark is therefore held in projective coordinates
xi = (x/z, y/z, 1/z) of the camera pose from which it was first seen, its anchor (Civera, Davison, Montiel 2008 for one camera):

    p_g = R_ig' ((xi_1, xi_2, 1) / xi_3 - t),   (t, q_ig) the anchor.

The anchor is a set of constants that fixes a chart of space, no state: whatever its value, the map to p_g is exact.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import conjugate, rotate
from spinfilters.symbolic import Compiled, building

ANCHOR_DIM = 7
"""t (m), q_ig (x, y, z, w)."""


def anchored_points(
    anchors: Float[np.ndarray, "*batch 7"], coordinates: Float[np.ndarray, "*batch 3"]
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
    """Points in frame g (m), and their derivatives by the coordinates."""
    points, slopes = _forward()(anchors, coordinates)
    return points, slopes


def anchored_coordinates(
    anchors: Float[np.ndarray, "*batch 7"], points: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Coordinates of points in frame g (m); the third is positive for points in front of the anchor."""
    return _backward()(anchors, points)[0]


@cache
@building()
def _forward() -> Compiled:
    anchor, xi = ca.SX.sym("anchor", ANCHOR_DIM), ca.SX.sym("xi", 3)
    camera = ca.vertcat(xi[0], xi[1], 1) / xi[2]
    point = rotate(conjugate(anchor[3:]), camera - anchor[:3])
    return Compiled(ca.Function("anchored_point", [anchor, xi], [point, ca.jacobian(point, xi)]))


@cache
@building()
def _backward() -> Compiled:
    anchor, p = ca.SX.sym("anchor", ANCHOR_DIM), ca.SX.sym("p", 3)
    camera = anchor[:3] + rotate(anchor[3:], p)
    xi = ca.vertcat(camera[0] / camera[2], camera[1] / camera[2], 1 / camera[2])
    return Compiled(ca.Function("anchored_coordinates", [anchor, p], [xi]))
