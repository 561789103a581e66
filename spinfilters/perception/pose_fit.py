"""The pose of one frame from a stereo pair's points and a map: absolute orientation, then Gauss-Newton on the pixels."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion, rotate
from spinfilters.errors import InputError
from spinfilters.geometry.absolute_orientation import absolute_orientation
from spinfilters.geometry.triangulation import triangulate
from spinfilters.models.sensors.stereo_landmark import StereoLandmark, stereo_parameters
from spinfilters.state.layout import StateLayout

ITERATIONS = 8
GATE_PX = 6.0
"""Residual in standard deviations beyond which a match counts as wrong."""


@dataclass(frozen=True)
class FittedPose:
    """Pose (t, q_ig), its covariance (6 x 6, order t, a) and which matches agree with it."""

    pose: Float[np.ndarray, " 7"]
    covariance: Float[np.ndarray, "6 6"]
    inliers: Bool[np.ndarray, " k"]


@cache
def _stereo() -> StereoLandmark:
    return StereoLandmark(StateLayout(("t", "a")))


def fit_pose(
    points: Float[np.ndarray, "k 3"],
    pixels: Float[np.ndarray, "k 3"],
    calibration: Float[np.ndarray, " 5"],
    pixel_std: float,
    covariance: Float[np.ndarray, "k 3 3"] | None = None,
) -> FittedPose | None:
    """Pose of g in i that reprojects map points (frame g, m) onto rectified pixels; None when fewer than four matches agree.

    Parameters
    ----------
    calibration: (fx, fy, cx, cy, baseline) of the rig.
    pixel_std: standard deviation of each pixel coordinate.
    covariance: of the points, m^2, frame g; None for a map that is known exactly. A triangulated depth is so uncertain that
        a fit without it would turn the body to please the depths.
    """
    model, parameters = _stereo(), stereo_parameters(points, calibration, pixel_std)
    pose = _first_pose(points, triangulate(pixels, calibration))
    if pose is None:
        return None
    inliers = np.ones(len(points), dtype=bool)
    information = np.eye(6)
    for _ in range(ITERATIONS):
        innovation, jacobian, valid, _ = model.linearise(pose, parameters, pixels)
        if covariance is not None:
            innovation, jacobian = _with_map_noise(pose, innovation, jacobian, covariance)
        size = np.abs(innovation).max(axis=1)
        inliers = valid & (size < max(GATE_PX, 4 * float(np.median(size))))
        if np.count_nonzero(inliers) < 4:
            return None
        A, b = jacobian[inliers].reshape(-1, 6), innovation[inliers].reshape(-1)
        information = A.T @ A
        step = np.linalg.lstsq(A, b, rcond=None)[0]
        pose = model.layout.retract(pose, step)
        if np.abs(step).max() < 1e-10:
            break
    if np.linalg.eigvalsh(information)[0] <= 0:
        return None
    return FittedPose(pose, np.linalg.inv(information), inliers)


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


def _first_pose(
    points: Float[np.ndarray, "k 3"], seen: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, " 7"] | None:
    """Absolute orientation with depth-dependent weights, repeated once without what disagrees grossly."""
    keep = np.isfinite(seen).all(axis=1) & (seen[:, 2] > 0)
    q, t = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
    for _ in range(3):
        if np.count_nonzero(keep) < 4:
            return None
        try:
            q, t = absolute_orientation(seen[keep], points[keep], seen[keep, 2] ** -4)
        except InputError:
            return None
        error = np.linalg.norm(seen - (rotate(q, points) + t), axis=1)
        keep = keep & (error <= 4 * np.median(error[keep]) + 1e-12)
    return np.concatenate([t, q])
