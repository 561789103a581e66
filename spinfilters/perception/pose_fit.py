"""Poses from a stereo pair's pixels and a map: what most matches of a frame agree on, then Gauss-Newton, many frames at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.geometry.cameras import StereoPair, stereo_pair
from spinfilters.linear_algebra.definite import which_definite
from spinfilters.models.sensor_noise import SensorNoiseModel, noise_model
from spinfilters.models.sensors.stereo_landmark import StereoLandmark
from spinfilters.perception.matches import Matches, MatchTable
from spinfilters.perception.pose_consensus import SMALLEST_SHARE, consensus_poses
from spinfilters.state.layout import POSE_BLOCKS, StateLayout

ITERATIONS = 8
SETTLED = 1e-6
"""Length of a step in standard deviations of the pose below which iterations end."""
GATE_PX = 6.0
"""Residual in standard deviations beyond which a match counts as wrong."""
OPENING = 6.0
"""Times the lower quartile of the residuals: less than the gate when all matches are right and so is their noise."""
FRAMES_AT_ONCE = 64
"""Whose rows are in memory together: more gain no time."""


@dataclass(frozen=True)
class FittedPose:
    """Pose (t, q_ig), its covariance (6 x 6, order t, a) and which matches agree with it."""

    pose: Float[np.ndarray, " 7"]
    covariance: Float[np.ndarray, "6 6"]
    inliers: Bool[np.ndarray, " k"]


@cache
def _stereo(noise: SensorNoiseModel, camera: StereoPair) -> StereoLandmark:
    return StereoLandmark(StateLayout(POSE_BLOCKS), noise, camera)


def fit_pose(matches: Matches, calibration: Float[np.ndarray, " c"]) -> FittedPose | None:
    """`fit_poses` of one frame."""
    return fit_poses([matches], calibration)[0]


def fit_poses(frames: Sequence[Matches], calibration: Float[np.ndarray, " c"]) -> list[FittedPose | None]:
    """Poses of g in the camera's frame that reproject map points onto pixels; None for a frame where fewer than four matches agree.

    Parameters
    ----------
    frames: whose noise is told in one way: all by a standard deviation, or all by covariances; so are their points.
    calibration: of the pair (`spinfilters.geometry.cameras.StereoPair`).
    """
    found: list[FittedPose | None] = []
    for first in range(0, len(frames), FRAMES_AT_ONCE):
        found += _fitted(frames[first : first + FRAMES_AT_ONCE], calibration)
    return found


def _fitted(frames: Sequence[Matches], calibration: Float[np.ndarray, " c"]) -> list[FittedPose | None]:
    table = MatchTable.of(frames, calibration)
    fits: list[FittedPose | None] = [None] * len(frames)
    if not table.given.any():
        return fits
    model = _stereo(noise_model(frames[0].noise, 3), stereo_pair(calibration))
    rough = consensus_poses(table, calibration)
    poses, moving = rough.poses, rough.found.copy()
    for iteration in range(ITERATIONS):
        rows = np.flatnonzero(moving)
        if not len(rows):
            break
        step = _gauss_newton(model, table.part(moving), poses[moving], rough.agreeing[moving])
        poses[rows] = step.poses
        settled = step.determined & (step.length < SETTLED)
        done = step.determined if iteration == ITERATIONS - 1 else settled
        for k in np.flatnonzero(done):
            inliers = step.inliers[k, : len(frames[rows[k]].points)]
            fits[rows[k]] = FittedPose(step.poses[k], np.linalg.inv(step.information[k]), inliers)
        moving[rows] = step.determined & ~settled
    return fits


class _Step(NamedTuple):
    """One step of Gauss-Newton of f frames.

    Attributes
    ----------
    poses: (f, 7) after it.   information: (f, 6, 6) before it.   inliers: (f, k) matches that took part.
    length: (f,) in standard deviations of the pose.   determined: (f,) whether the matches tell a pose; else it stays.
    """

    poses: Float[np.ndarray, "f 7"]
    information: Float[np.ndarray, "f 6 6"]
    inliers: Bool[np.ndarray, "f k"]
    length: Float[np.ndarray, " f"]
    determined: Bool[np.ndarray, " f"]


def _gauss_newton(
    model: StereoLandmark,
    table: MatchTable,
    poses: Float[np.ndarray, "f 7"],
    agreeing: Bool[np.ndarray, "f k"],
) -> _Step:
    innovation, jacobian, valid = _linearised(model, table, poses)
    if table.covariance is not None:
        innovation, jacobian = _with_map_noise(poses, innovation, jacobian, table.covariance)
    inliers = valid & _within_gate(np.abs(innovation).max(axis=2), agreeing)
    determined = np.count_nonzero(inliers, axis=1) >= np.maximum(4, SMALLEST_SHARE * table.counts)
    jacobian[~inliers], innovation[~inliers] = 0.0, 0.0
    A, b = jacobian.reshape(len(poses), -1, 6), innovation.reshape(len(poses), -1, 1)
    information, gradient = np.swapaxes(A, 1, 2) @ A, np.swapaxes(A, 1, 2) @ b
    determined[determined] = which_definite(information[determined])
    step = np.zeros((len(poses), 6))
    step[determined] = np.linalg.solve(information[determined], gradient[determined])[..., 0]
    length = np.sqrt(np.einsum("fi,fij,fj->f", step, information, step))
    return _Step(model.layout.retract(poses, step), information, inliers, length, determined)


def _linearised(
    model: StereoLandmark, table: MatchTable, poses: Float[np.ndarray, "f 7"]
) -> tuple[Float[np.ndarray, "f k 3"], Float[np.ndarray, "f k 3 6"], Bool[np.ndarray, "f k"]]:
    """Whitened innovations of the matches, their derivatives by the poses, and where the sensor applies."""
    (f, k), p = table.given.shape, table.parameters.shape[2]
    innovation, jacobian, valid, _ = model.linearise(
        np.repeat(poses, k, axis=0), table.parameters.reshape(f * k, p), table.pixels.reshape(f * k, 3)
    )
    return innovation.reshape(f, k, 3), jacobian.reshape(f, k, 3, 6), valid.reshape(f, k) & table.given


def _within_gate(
    size: Float[np.ndarray, "f k"], agreeing: Bool[np.ndarray, "f k"]
) -> Bool[np.ndarray, "f k"]:
    """Residuals (standard deviations) below a gate that opens while a pose is off.

    By how much is judged by the best quarter of those that agree with the rough pose: among all, that quarter may be wrong.
    """
    ordered = np.sort(np.where(agreeing, size, np.nan), axis=1)  # what is not a number comes last
    quarter = np.count_nonzero(agreeing, axis=1)[:, None] // 4
    return size < np.fmax(GATE_PX, OPENING * np.take_along_axis(ordered, quarter, axis=1))


def _with_map_noise(
    poses: Float[np.ndarray, "f 7"],
    innovation: Float[np.ndarray, "f k 3"],
    jacobian: Float[np.ndarray, "f k 3 6"],
    covariance: Float[np.ndarray, "f k 3 3"],
) -> tuple[Float[np.ndarray, "f k 3"], Float[np.ndarray, "f k 3 6"]]:
    """Whitened once more, by the pixels' and the points' noise together."""
    by_point = jacobian[..., :3] @ matrix_from_quaternion(poses[:, 3:])[:, None]
    root = np.linalg.cholesky(np.eye(3) + by_point @ covariance @ np.swapaxes(by_point, 2, 3))
    both = np.linalg.solve(root, np.concatenate([innovation[..., None], jacobian], axis=3))
    return both[..., 0], both[..., 1:]
