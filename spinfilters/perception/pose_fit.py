"""The pose of one frame from a stereo pair's points and a map: what most matches agree on, then Gauss-Newton on the pixels."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.linear_algebra.definite import is_definite
from spinfilters.models.sensor_noise import NoiseLevel, SensorNoiseModel, noise_model
from spinfilters.models.sensors.stereo_landmark import StereoLandmark, stereo_parameters
from spinfilters.perception.pose_consensus import SMALLEST_SHARE, consensus_pose
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

ITERATIONS = 8
SETTLED = 1e-6
"""Length of a step in standard deviations of the pose below which iterations end."""
GATE_PX = 6.0
"""Residual in standard deviations beyond which a match counts as wrong."""
OPENING = 6.0
"""Times the lower quartile of the residuals: less than the gate when all matches are right and so is their noise."""


@dataclass(frozen=True)
class FittedPose:
    """Pose (t, q_ig), its covariance (6 x 6, order t, a) and which matches agree with it."""

    pose: Float[np.ndarray, " 7"]
    covariance: Float[np.ndarray, "6 6"]
    inliers: Bool[np.ndarray, " k"]


@cache
def _stereo(noise: SensorNoiseModel) -> StereoLandmark:
    return StereoLandmark(StateLayout(POSE_BLOCKS), noise)


def fit_pose(
    points: Float[np.ndarray, "k 3"],
    pixels: Float[np.ndarray, "k 3"],
    calibration: Float[np.ndarray, " 5"],
    noise: NoiseLevel,
    covariance: Float[np.ndarray, "k 3 3"] | None = None,
) -> FittedPose | None:
    """Pose of g in i that reprojects map points (frame g, m) onto rectified pixels; None when fewer than four matches agree.

    Parameters
    ----------
    calibration: (fx, fy, cx, cy, baseline) of the rig.
    noise: standard deviation (px) of each pixel coordinate, or (k, 3, 3) covariances of the matches (px^2).
    covariance: of the points, m^2, frame g; None for a map that is known exactly. A triangulated depth is so uncertain that
        a fit without it would turn the body to please the depths.
    """
    model, parameters = _stereo(noise_model(noise, 3)), stereo_parameters(points, calibration, noise)
    pose = consensus_pose(points, pixels, calibration)
    if pose is None:
        return None
    inliers = np.ones(len(points), dtype=bool)
    information = np.eye(6)
    for _ in range(ITERATIONS):
        innovation, jacobian, valid, _ = model.linearise(pose, parameters, pixels)
        if covariance is not None:
            innovation, jacobian = _with_map_noise(pose, innovation, jacobian, covariance)
        inliers = valid & _within_gate(np.abs(innovation).max(axis=1))
        if np.count_nonzero(inliers) < max(4, SMALLEST_SHARE * len(points)):
            return None
        A, b = jacobian[inliers].reshape(-1, 6), innovation[inliers].reshape(-1)
        information = A.T @ A
        if not is_definite(information):
            return None
        step = np.linalg.solve(information, A.T @ b)
        pose = model.layout.retract(pose, step)
        if step @ information @ step < SETTLED**2:
            break
    return FittedPose(pose, np.linalg.inv(information), inliers)


def _within_gate(size: Float[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    """Residuals (standard deviations) below a gate that opens while the pose is off, judged by the quarter that fits best."""
    quarter = len(size) // 4
    return size < max(GATE_PX, OPENING * float(np.partition(size, quarter)[quarter]))


def _with_map_noise(
    pose: Float[np.ndarray, " 7"],
    innovation: Float[np.ndarray, "k 3"],
    jacobian: Float[np.ndarray, "k 3 6"],
    covariance: Float[np.ndarray, "k 3 3"],
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 6"]]:
    """Whitened once more, by the pixels' and the points' noise together."""
    by_point = jacobian[:, :, :3] @ matrix_from_quaternion(pose[3:])
    root = np.linalg.cholesky(np.eye(3) + by_point @ covariance @ np.swapaxes(by_point, 1, 2))
    both = np.linalg.solve(root, np.concatenate([innovation[..., None], jacobian], axis=2))
    return both[..., 0], both[..., 1:]
