"""Pose fit of stereo pixels to a map: RANSAC, then Gauss-Newton, for many epochs at once."""

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
from spinfilters.state.layout import POSE_BLOCKS, StateLayout
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
    innovation, jacobian, valid = _linearised(model, table.about(about.points), poses)
    by_map = None
    if table.covariance is not None:
        by_map = _MapNoise.of(about, table.points, jacobian, table.covariance)
        innovation, jacobian = by_map.whitened(innovation, jacobian)
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
    if by_map is not None:
        left = innovation - (jacobian @ step[:, None, :, None])[..., 0]
        points = table.points + np.where(inliers[..., None], by_map.corrections(left), 0.0)
    return _Step(model.layout.retract(poses, step), points, information, inliers, squares, length, determined)


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


@dataclass(frozen=True)
class _MapNoise:
    """Noise of map points, which are unknowns of their own and are eliminated at every step.

    A fit that whitens by the covariance of the points as a pose turns it, and takes that as constant, has a cost of which the
    derivative by the rotation is missing: it finds too small rotations where points are poor. About the points' own estimates there
    is nothing to miss.

    Attributes
    ----------
    away: (f, k, 3) m from the points about which all is linear to those of the map.
    by_point: (f, k, 3, 3) derivative of whitened pixels by the points.   covariance: (f, k, 3, 3) of the map.
    root: (f, k, 3, 3) lower, of the covariance of the whitened pixels given the pose.
    """

    away: Float[np.ndarray, "f k 3"]
    by_point: Float[np.ndarray, "f k 3 3"]
    covariance: Float[np.ndarray, "f k 3 3"]
    root: Float[np.ndarray, "f k 3 3"]

    @classmethod
    def of(
        cls,
        about: _About,
        points: Float[np.ndarray, "f k 3"],
        jacobian: Float[np.ndarray, "f k 3 6"],
        covariance: Float[np.ndarray, "f k 3 3"],
    ) -> "_MapNoise":
        """Projected covariance of the map points, beside unit pixel noise."""
        by_point = jacobian[..., :3] @ matrix_from_quaternion(about.poses[:, 3:])[:, None]
        root = np.linalg.cholesky(np.eye(3) + by_point @ covariance @ np.swapaxes(by_point, 2, 3))
        return cls(points - about.points, by_point, covariance, root)

    def whitened(
        self, innovation: Float[np.ndarray, "f k 3"], jacobian: Float[np.ndarray, "f k 3 6"]
    ) -> tuple[Float[np.ndarray, "f k 3"], Float[np.ndarray, "f k 3 6"]]:
        """By the pixels' and the points' noise together, about the points of the map."""
        at_map = innovation[..., None] - self.by_point @ self.away[..., None]
        both = np.linalg.solve(self.root, np.concatenate([at_map, jacobian], axis=3))
        return both[..., 0], both[..., 1:]

    def corrections(self, left: Float[np.ndarray, "f k 3"]) -> Float[np.ndarray, "f k 3"]:
        """Of the map's points, m, by what a step leaves of the whitened innovations."""
        back = np.linalg.solve(np.swapaxes(self.root, 2, 3), left[..., None])
        return (self.covariance @ np.swapaxes(self.by_point, 2, 3) @ back)[..., 0]
