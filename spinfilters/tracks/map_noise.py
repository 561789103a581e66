"""Matches with noisy map points, linearised about a pose.

The points are eliminated.
A fit that whitens by the covariance of the points as a pose turns it, and takes that as constant, has a cost of which the
derivative by the rotation is missing: it finds too small rotations where points are poor. About the points' own estimates there is
nothing to miss: they are unknowns, eliminated at every step. With B the derivative of whitened pixels by a point of covariance C,

    L L' = I + B C B',   L^-1 (innovation - B away, J),   correction of the point: C B' L^-T (what a step leaves of the innovation).
"""

from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.attitude.expressions import matrix_from_quaternion
from spinfilters.models.measurement import row_by_row
from spinfilters.models.sensor_models.stereo_landmark import StereoLandmark
from spinfilters.symbolic.vectorised import Vectorised
from spinfilters.symbolic.working_time import building


class UncertainRows(NamedTuple):
    """k matches about their poses and points.

    Attributes
    ----------
    innovation: (k, 3), jacobian: (k, 3, 6) by the pose, whitened by the pixels' and the points' noise together.
    valid: (k,) where the sensor applies.
    by_left: (k, 3, 3) correction of the map's point, m, by what a step leaves of the whitened innovation.
    """

    innovation: Float[np.ndarray, "k 3"]
    jacobian: Float[np.ndarray, "k 3 6"]
    valid: Bool[np.ndarray, " k"]
    by_left: Float[np.ndarray, "k 3 3"]


class UncertainMatches(NamedTuple):
    """k matches with points (m, frame g) that a map tells with covariances.

    Attributes
    ----------
    parameters: (k, p) of the sensor, with the points that all is linear about.   pixels: (k, 3).
    away: (k, 3) from those points to the map's.   covariance: (k, 3, 3) of the map.
    """

    parameters: Float[np.ndarray, "k p"]
    pixels: Float[np.ndarray, "k 3"]
    away: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"]

    def linearised(
        self, model: StereoLandmark, poses: Float[np.ndarray, "f 7"], epochs: Int[np.ndarray, " k"]
    ) -> UncertainRows:
        """The matches about the poses of their epochs."""
        given = (poses, self.parameters, self.pixels, self.away, self.covariance.reshape(-1, 9))
        made = _linearisation(model)(*given, rows=(epochs, None, None, None, None))
        innovation, jacobian, valid, by_left = made
        return UncertainRows(
            innovation, jacobian.reshape(-1, 3, 6), valid[:, 0] > 0, by_left.reshape(-1, 3, 3)
        )


@cache
@building()
def _linearisation(model: StereoLandmark) -> Vectorised:
    sizes = {"x": model.layout.mean_dim, "p": model.parameter_dim, "z": 3, "away": 3, "covariance": 9}
    x, p, z, away, covariance = given = [ca.SX.sym(name, size) for name, size in sizes.items()]
    innovation, jacobian, valid, _ = model.linearisation.function(x, p, z)
    J, C = ca.reshape(jacobian, 6, 3).T, ca.reshape(covariance, 3, 3)
    by_point = J[:, :3] @ matrix_from_quaternion(model.layout.unpack(x)["q"])
    root = ca.chol(ca.SX.eye(3) + by_point @ C @ by_point.T).T
    rows = ca.solve(root, ca.horzcat(innovation - by_point @ away, J, by_point @ C))
    outputs = [rows[:, 0], row_by_row(rows[:, 1:7]), valid, row_by_row(rows[:, 7:].T)]
    return Vectorised(ca.Function("uncertain_matches", given, outputs))
