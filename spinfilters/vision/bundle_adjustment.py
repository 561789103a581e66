"""Bundle adjustment without dynamics: poses and landmarks that explain the observations best, whatever the motion.

Its residuals tell the noise of the observations and which of them are wrong, before any estimator assumes how the body moves.
Landmarks are eliminated (Schur complement); the first pose stays where it is, which fixes frame g.
"""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import bsr_array

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.camera import StereoRig
from spinfilters.models.sensor_models.camera_landmark import camera_parameters
from spinfilters.models.sensor_models.stereo_landmark import StereoLandmark
from spinfilters.models.sensor_noise import CorrelatedNoise
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

ITERATIONS: Final = 8
SETTLED: Final = 1e-4
"""Relative fall of the cost below which iterations end."""
LOSS: Final = 3.0
"""Standard deviations beyond which a residual loses weight (Huber's loss of the length of the three whitened residuals)."""
RIDGE: Final = 1e-9
"""Share of its own trace that is added to a landmark's information, so that one seen once has an inverse."""

PLACE_AND_DISPARITY: Final = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, -1]])
"""Of (u_left, v_left, u_right)."""


@dataclass(frozen=True)
class Observations:
    """n observations of landmarks at epochs.

    Attributes
    ----------
    epoch: (n,) row of the poses.   landmark: (n,) row of the landmarks.   values: (n, 3) px.   covariance: (n, 3, 3) px^2.
    """

    epoch: Int[np.ndarray, " n"]
    landmark: Int[np.ndarray, " n"]
    values: Float[np.ndarray, "n 3"]
    covariance: Float[np.ndarray, "n 3 3"]

    def part(self, chosen: Bool[np.ndarray, " n"]) -> "Observations":
        """Some of them, of the same poses and landmarks."""
        return Observations(
            self.epoch[chosen], self.landmark[chosen], self.values[chosen], self.covariance[chosen]
        )


@dataclass(frozen=True)
class Adjusted:
    """Result of a bundle adjustment.

    Attributes
    ----------
    poses: (e, 7) t, q_ig.   points: (l, 3) m, frame g.
    whitened: (n, 3) residuals in standard deviations.   jacobian: (n, 3, 3) of whitened predictions by the landmark.
    information: (l, 3, 3) of the landmarks at these poses.
    """

    poses: Float[np.ndarray, "e 7"]
    points: Float[np.ndarray, "l 3"]
    whitened: Float[np.ndarray, "n 3"]
    jacobian: Float[np.ndarray, "n 3 3"]
    information: Float[np.ndarray, "l 3 3"]

    def residuals(
        self, observations: Observations
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Residuals of u_left, v_left and disparity (px), with remaining variance shares.

        Shares that the fit has left: of the landmarks exactly, of the poses as a mean.
        """
        root = np.linalg.cholesky(observations.covariance)
        residual = np.einsum("ij,njk,nk->ni", PLACE_AND_DISPARITY, root, self.whitened)
        J, inverse = (
            self.by_landmark(observations),
            np.linalg.inv(self.information)[observations.landmark],
        )
        explained = np.einsum("nij,njk,nik->ni", J, inverse, J)
        total = np.einsum("ij,njk,ik->ni", PLACE_AND_DISPARITY, observations.covariance, PLACE_AND_DISPARITY)
        freedom = np.clip(1 - explained / total, 0.0, 1.0)
        by_poses = 6 * (len(self.poses) - 1) / max(float(freedom.sum()), 1.0)
        return residual, freedom * max(1 - by_poses, 0.1)

    def by_landmark(self, observations: Observations) -> Float[np.ndarray, "n 3 3"]:
        """Derivative of predicted u_left, v_left and disparity by the landmark, px/m."""
        return PLACE_AND_DISPARITY @ np.linalg.cholesky(observations.covariance) @ self.jacobian


@cache
def _sensor() -> StereoLandmark:
    return StereoLandmark(StateLayout(POSE_BLOCKS), CorrelatedNoise(3))


def adjust(
    observations: Observations,
    poses: Float[np.ndarray, "e 7"],
    points: Float[np.ndarray, "l 3"],
    rig: StereoRig,
) -> Adjusted:
    """Poses and landmarks of least robust cost, by Gauss-Newton.

    The best of all iterations.
    """
    best, least, last = _linearised(observations, poses, points, rig), np.inf, np.inf
    state = best
    for _ in range(ITERATIONS):
        cost = _cost(state.whitened)
        if cost < least:
            best, least = state, cost
        if not cost < last * (1 - SETTLED):
            break
        last = cost
        poses, points = _step(observations, state)
        state = _linearised(observations, poses, points, rig)
    return state if _cost(state.whitened) < least else best


def _linearised(
    observations: Observations,
    poses: Float[np.ndarray, "e 7"],
    points: Float[np.ndarray, "l 3"],
    rig: StereoRig,
) -> "_Linearised":
    parameters = camera_parameters(points[observations.landmark], rig.calibration, observations.covariance)
    innovation, by_pose, valid, _ = _sensor().linearise(
        poses[observations.epoch], parameters, observations.values
    )
    innovation, by_pose = np.array(innovation), np.array(by_pose)
    innovation[~valid], by_pose[~valid] = 0.0, 0.0
    by_point = by_pose[..., :3] @ matrix_from_quaternion(poses[:, 3:])[observations.epoch]
    weight = _weights(innovation)
    information = np.zeros((len(points), 3, 3))
    np.add.at(
        information, observations.landmark, weight[:, None, None] * (np.swapaxes(by_point, 1, 2) @ by_point)
    )
    trace = np.trace(information, axis1=1, axis2=2)
    information += (RIDGE * trace + 1e-12)[:, None, None] * np.eye(3)
    return _Linearised(poses, points, innovation, by_point, information, by_pose, weight)


@dataclass(frozen=True)
class _Linearised(Adjusted):
    """Residuals with pose Jacobian (n, 3, 6) and robust weights (n,)."""

    by_pose: Float[np.ndarray, "n 3 6"]
    weight: Float[np.ndarray, " n"]


def _weights(whitened: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    return np.minimum(1.0, LOSS / np.maximum(np.linalg.norm(whitened, axis=1), 1e-12))


def _cost(whitened: Float[np.ndarray, "n 3"]) -> float:
    length = np.linalg.norm(whitened, axis=1)
    return float(np.sum(np.where(length <= LOSS, length**2, 2 * LOSS * length - LOSS**2)))


def _step(
    observations: Observations, at: "_Linearised"
) -> tuple[Float[np.ndarray, "e 7"], Float[np.ndarray, "l 3"]]:
    """Poses and points after a Gauss-Newton step.

    Order: poses (6 e), then landmarks (3 l), which are eliminated first.
    """
    epochs, landmarks = len(at.poses), len(at.points)
    weighted_pose = at.weight[:, None, None] * np.swapaxes(at.by_pose, 1, 2)
    weighted_point = at.weight[:, None, None] * np.swapaxes(at.jacobian, 1, 2)
    H, b = np.zeros((epochs, 6, 6)), np.zeros((epochs, 6))
    np.add.at(H, observations.epoch, weighted_pose @ at.by_pose)
    np.add.at(b, observations.epoch, (weighted_pose @ at.whitened[..., None])[..., 0])
    g = np.zeros((landmarks, 3))
    np.add.at(g, observations.landmark, (weighted_point @ at.whitened[..., None])[..., 0])
    W = _blocks(observations, weighted_pose @ at.jacobian, (epochs, landmarks))
    inverse = np.linalg.inv(at.information)
    scaled = _blocks(
        observations, weighted_pose @ at.jacobian @ inverse[observations.landmark], (epochs, landmarks)
    )
    S = -(scaled @ W.T).toarray()
    for epoch in range(epochs):
        S[6 * epoch : 6 * epoch + 6, 6 * epoch : 6 * epoch + 6] += H[epoch]
    right = b.ravel() - scaled @ g.ravel()
    step = np.zeros(6 * epochs)
    S[np.diag_indices_from(S)] += 1e-9 * np.trace(S) / len(S)
    step[6:] = np.linalg.solve(S[6:, 6:], right[6:])
    back = g - (W.T @ step).reshape(-1, 3)
    points = at.points + (inverse @ back[..., None])[..., 0]
    return _sensor().layout.retract(at.poses, step.reshape(-1, 6)), points


def _blocks(
    observations: Observations, blocks: Float[np.ndarray, "n 6 3"], shape: tuple[int, int]
) -> bsr_array:
    """Sparse matrix of one block per observation.

    Rows poses, columns landmarks; a landmark is seen once in an epoch.
    """
    order = np.lexsort((observations.landmark, observations.epoch))
    starts = np.searchsorted(observations.epoch[order], np.arange(shape[0] + 1))
    return bsr_array(
        (blocks[order], observations.landmark[order], starts), shape=(6 * shape[0], 3 * shape[1])
    )
