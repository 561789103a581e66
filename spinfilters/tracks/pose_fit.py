"""Pose fit of stereo pixels to a map: RANSAC, then Gauss-Newton, for many epochs at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.geometry.cameras import StereoPair, stereo_pair
from spinfilters.linear_algebra.definite import which_definite
from spinfilters.models.sensor_models.stereo_landmark import StereoLandmark
from spinfilters.models.sensor_noise import SensorNoiseModel, noise_model
from spinfilters.state.layout import POSE_BLOCKS, StateLayout
from spinfilters.tracks.map_noise import UncertainMatches
from spinfilters.tracks.matches import Matches, MatchTable
from spinfilters.tracks.pose_consensus import SMALLEST_SHARE, consensus_poses

ITERATIONS = 8
SETTLED = 1e-6
"""Length of a step in standard deviations of the pose below which iterations end."""
GATE_PX = 6.0
"""Residual in standard deviations beyond which a match counts as wrong."""
OPENING = 6.0
"""Times the lower quartile of the residuals: less than the gate when all matches are right and so is their noise."""
EPOCHS_AT_ONCE = 64
"""Whose rows are in memory together: more gain no time."""


@dataclass(frozen=True)
class FittedPose:
    """Pose (t, q_ig) with covariance (6 x 6, order t, a).

    Which matches agree, and their squared whitened innovations.
    """

    pose: Float[np.ndarray, " 7"]
    covariance: Float[np.ndarray, "6 6"]
    inliers: Bool[np.ndarray, " k"]
    squares: Float[np.ndarray, " k"]


@cache
def _stereo(noise: SensorNoiseModel, camera: StereoPair) -> StereoLandmark:
    return StereoLandmark(StateLayout(POSE_BLOCKS), noise, camera)


def fit_pose(matches: Matches, calibration: Float[np.ndarray, " c"]) -> FittedPose | None:
    """`fit_poses` of one epoch."""
    return fit_poses([matches], calibration)[0]


def fit_poses(epochs: Sequence[Matches], calibration: Float[np.ndarray, " c"]) -> list[FittedPose | None]:
    """Poses of g in the camera's frame from mapped pixels.

    They reproject map points onto pixels; None for an epoch where fewer than four matches agree.

    Parameters
    ----------
    epochs: whose noise is told in one way: all by a standard deviation, or all by covariances; so are their points.
    calibration: of the pair (`spinfilters.geometry.cameras.StereoPair`).
    """
    found: list[FittedPose | None] = []
    for first in range(0, len(epochs), EPOCHS_AT_ONCE):
        found += _fitted(epochs[first : first + EPOCHS_AT_ONCE], calibration)
    return found


def _fitted(epochs: Sequence[Matches], calibration: Float[np.ndarray, " c"]) -> list[FittedPose | None]:
    table = MatchTable.of(epochs, calibration)
    fits: list[FittedPose | None] = [None] * len(epochs)
    if not table.given.any():
        return fits
    model = _stereo(noise_model(epochs[0].noise, 3), stereo_pair(calibration))
    rough = consensus_poses(table, calibration)
    poses, points, moving = rough.poses, table.points.copy(), rough.found.copy()
    for iteration in range(ITERATIONS):
        rows = np.flatnonzero(moving)
        if not len(rows):
            break
        about = _About(poses[moving], points[moving])
        step = _gauss_newton(model, table.part(moving), about, rough.agreeing[moving])
        poses[rows], points[rows] = step.poses, step.points
        settled = step.determined & (step.length < SETTLED)
        done = step.determined if iteration == ITERATIONS - 1 else settled
        for k in np.flatnonzero(done):
            given = slice(len(epochs[rows[k]].points))
            fits[rows[k]] = FittedPose(
                step.poses[k],
                np.linalg.inv(step.information[k]),
                step.inliers[k, given],
                step.squares[k, given],
            )
        moving[rows] = step.determined & ~settled
    return fits


class _About(NamedTuple):
    """Poses (f, 7) and points (f, k, 3), frame g, that a step is linearised about."""

    poses: Float[np.ndarray, "f 7"]
    points: Float[np.ndarray, "f k 3"]


class _Step(NamedTuple):
    """One step of Gauss-Newton of f epochs.

    Attributes
    ----------
    poses: (f, 7), points: (f, k, 3) after it.   information: (f, 6, 6) before it.   inliers: (f, k) matches that took part.
    squares: (f, k) squared lengths of the whitened innovations before it.
    length: (f,) in standard deviations of the pose.   determined: (f,) whether the matches tell a pose; else it stays.
    """

    poses: Float[np.ndarray, "f 7"]
    points: Float[np.ndarray, "f k 3"]
    information: Float[np.ndarray, "f 6 6"]
    inliers: Bool[np.ndarray, "f k"]
    squares: Float[np.ndarray, "f k"]
    length: Float[np.ndarray, " f"]
    determined: Bool[np.ndarray, " f"]


def _gauss_newton(
    model: StereoLandmark,
    table: MatchTable,
    about: _About,
    agreeing: Bool[np.ndarray, "f k"],
) -> _Step:
    poses = about.poses
    innovation, jacobian, valid, by_left = _linearised(model, table, about)
    squares = np.square(innovation).sum(axis=2)
    inliers = valid & _within_gate(np.abs(innovation).max(axis=2), agreeing)
    determined = np.count_nonzero(inliers, axis=1) >= np.maximum(4, SMALLEST_SHARE * table.counts)
    jacobian[~inliers], innovation[~inliers] = 0.0, 0.0
    A, b = jacobian.reshape(len(poses), -1, 6), innovation.reshape(len(poses), -1, 1)
    information, gradient = np.swapaxes(A, 1, 2) @ A, np.swapaxes(A, 1, 2) @ b
    determined[determined] = which_definite(information[determined])
    step = np.zeros((len(poses), 6))
    step[determined] = np.linalg.solve(information[determined], gradient[determined])[..., 0]
    length = np.sqrt(np.einsum("fi,fij,fj->f", step, information, step))
    points = about.points
    if by_left is not None:
        left = innovation - (jacobian @ step[:, None, :, None])[..., 0]
        corrections = (by_left @ left[..., None])[..., 0]
        points = table.points + np.where(inliers[..., None], corrections, 0.0)
    return _Step(model.layout.retract(poses, step), points, information, inliers, squares, length, determined)


class _Rows(NamedTuple):
    """Whitened innovations of the matches, their derivatives by the poses, and where the sensor applies.

    Attributes
    ----------
    by_left: (f, k, 3, 3) corrections of the points by what a step leaves of the innovations; None of a map known exactly.
    """

    innovation: Float[np.ndarray, "f k 3"]
    jacobian: Float[np.ndarray, "f k 3 6"]
    valid: Bool[np.ndarray, "f k"]
    by_left: Float[np.ndarray, "f k 3 3"] | None


def _linearised(model: StereoLandmark, table: MatchTable, about: _About) -> _Rows:
    (f, k), epochs = table.given.shape, np.repeat(np.arange(len(table.given)), table.given.shape[1])
    parameters = table.about(about.points).parameters.reshape(f * k, -1)
    pixels, by_left = table.pixels.reshape(f * k, 3), None
    if table.covariance is None:
        innovation, jacobian, valid, _ = model.linearise(about.poses[epochs], parameters, pixels)
    else:
        away = (table.points - about.points).reshape(f * k, 3)
        matches = UncertainMatches(parameters, pixels, away, table.covariance.reshape(f * k, 3, 3))
        innovation, jacobian, valid, by_left = matches.linearised(model, about.poses, epochs)
        by_left = by_left.reshape(f, k, 3, 3)
    valid = valid.reshape(f, k) & table.given
    return _Rows(innovation.reshape(f, k, 3), jacobian.reshape(f, k, 3, 6), valid, by_left)


def _within_gate(
    size: Float[np.ndarray, "f k"], agreeing: Bool[np.ndarray, "f k"]
) -> Bool[np.ndarray, "f k"]:
    """Residuals (standard deviations) below a gate that opens while a pose is off.

    The best quarter of those that agree with the rough pose judges how far it is off: among all, that quarter may be wrong.
    """
    ordered = np.sort(np.where(agreeing, size, np.nan), axis=1)  # what is not a number comes last
    quarter = np.count_nonzero(agreeing, axis=1)[:, None] // 4
    return size < np.fmax(GATE_PX, OPENING * np.take_along_axis(ordered, quarter, axis=1))
