"""Camera poses from tracks of known landmarks: a weighted fit per epoch, with its covariance and the error of the map."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_expressions import matrix_from_quaternion
from spinfilters.core.cameras import StereoPair, stereo_pair
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import which_definite
from spinfilters.core.vectorised import Vectorised
from spinfilters.core.working_time import building
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.models.camera_landmarks import StereoLandmark
from spinfilters.models.measurement import row_by_row
from spinfilters.models.sensor_noise import NoiseLevel, SensorNoiseModel, noise_model, noise_of_rows
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.models.tracks.pose_consensus import (
    SMALLEST_SHARE,
    Consensus,
    Matches,
    MatchTable,
    consensus_poses,
)


class MatchRows(NamedTuple):
    """Matches about their poses and points, of one epoch or of several.

    Attributes
    ----------
    innovation : Float[np.ndarray, '*k 3']
        Whitened by the noise of the pixels, and of the points where a map states it.
    jacobian : Float[np.ndarray, '*k 3 6']
        Its derivative by the pose.
    valid : Bool[np.ndarray, '*k']
        Where the sensor applies.
    by_left : Float[np.ndarray, '*k 3 3'] | None
        Correction of the map's point, m, by what a step leaves of the innovation; None of a map known exactly.
    """

    innovation: Float[np.ndarray, "*k 3"]
    jacobian: Float[np.ndarray, "*k 3 6"]
    valid: Bool[np.ndarray, "*k"]
    by_left: Float[np.ndarray, "*k 3 3"] | None


class UncertainMatches(NamedTuple):
    """k matches with points (m, frame g) that a map gives with covariances.

    Attributes
    ----------
    parameters : Float[np.ndarray, 'k p']
        (k, p) of the sensor, with the points that all is linear about.
    pixels : Float[np.ndarray, 'k 3']
        (k, 3).
    away : Float[np.ndarray, 'k 3']
        (k, 3) from those points to the map's.
    covariance : Float[np.ndarray, 'k 3 3']
        (k, 3, 3) of the map.
    """

    parameters: Float[np.ndarray, "k p"]
    pixels: Float[np.ndarray, "k 3"]
    away: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"]

    def linearised(
        self, model: StereoLandmark, poses: Float[np.ndarray, "f 7"], epochs: Int[np.ndarray, " k"]
    ) -> MatchRows:
        """The matches about the poses of their epochs."""
        given = (poses, self.parameters, self.pixels, self.away, self.covariance.reshape(-1, 9))
        made = _linearisation(model)(*given, rows=(epochs, None, None, None, None))
        innovation, jacobian, valid, by_left = made
        return MatchRows(innovation, jacobian.reshape(-1, 3, 6), valid[:, 0] > 0, by_left.reshape(-1, 3, 3))


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
    """Pose (t, q_ig) with its covariance (6 x 6, order t, a), inliers, and their squared whitened innovations."""

    pose: Float[np.ndarray, " 7"]
    covariance: Float[np.ndarray, "6 6"]
    inliers: Bool[np.ndarray, " k"]
    squares: Float[np.ndarray, " k"]


@cache
def _stereo(noise: SensorNoiseModel, camera: StereoPair) -> StereoLandmark:
    return StereoLandmark(StateLayout(POSE_BLOCKS), noise, camera)


def fit_pose(
    matches: Matches, calibration: Float[np.ndarray, " c"], settled: float = SETTLED
) -> FittedPose | None:
    """`fit_poses` of one epoch; steps of less than ``settled`` standard deviations end it."""
    return _fit_poses([matches], calibration, settled)[0]


def fit_poses(epochs: Sequence[Matches], calibration: Float[np.ndarray, " c"]) -> list[FittedPose | None]:
    """Poses of g in the camera's frame from mapped pixels.

    They reproject map points onto pixels; None for an epoch where fewer than four matches agree.

    Parameters
    ----------
    epochs : Sequence[Matches]
        Whose noise is stated in one way: all by a standard deviation, or all by covariances; so are their points.
    calibration : Float[np.ndarray, ' c']
        Of the pair (`spinfilters.core.cameras.StereoPair`).
    """
    found: list[FittedPose | None] = []
    for first in range(0, len(epochs), EPOCHS_AT_ONCE):
        found += _fit_poses(epochs[first : first + EPOCHS_AT_ONCE], calibration, SETTLED)
    return found


def _fit_poses(
    epochs: Sequence[Matches], calibration: Float[np.ndarray, " c"], settled: float
) -> list[FittedPose | None]:
    table = MatchTable.of(epochs, calibration)
    if not table.given.any():
        return [None] * len(epochs)
    model = _stereo(noise_model(epochs[0].noise, 3), stereo_pair(calibration))
    return _refine_poses(model, table, consensus_poses(table, calibration), settled)


def refine_pose(
    matches: Matches, calibration: Float[np.ndarray, " c"], pose: Float[np.ndarray, " 7"], settled: float
) -> FittedPose | None:
    """`fit_pose` from a near pose, on which most matches agree; steps of less than ``settled`` standard deviations end it."""
    table = MatchTable.of([matches], calibration)
    if not table.given.any():
        return None
    model = _stereo(noise_model(matches.noise, 3), stereo_pair(calibration))
    near = Consensus(pose[None].copy(), np.ones(1, dtype=bool), table.given)
    return _refine_poses(model, table, near, settled)[0]


def _refine_poses(
    model: StereoLandmark, table: MatchTable, rough: Consensus, smallest: float
) -> list[FittedPose | None]:
    """Fits from rough poses by Gauss-Newton until the steps, in standard deviations, are small."""
    fits: list[FittedPose | None] = [None] * len(rough.poses)
    counts = table.counts.tolist()
    poses, points, moving = rough.poses, table.points.copy(), rough.found.copy()
    for iteration in range(ITERATIONS):
        rows = np.flatnonzero(moving)
        if not len(rows):
            break
        step = _gauss_newton(model, table.part(moving), poses[moving], points[moving], rough.agreeing[moving])
        poses[rows], points[rows] = step.poses, step.points
        settled = step.determined & (step.length < smallest)
        done = np.flatnonzero(step.determined if iteration == ITERATIONS - 1 else settled)
        for k, covariance in zip(done, np.linalg.inv(step.information[done]), strict=True):
            given = slice(counts[rows[k]])
            fits[rows[k]] = FittedPose(
                step.poses[k],
                covariance,
                step.inliers[k, given],
                step.squares[k, given],
            )
        moving[rows] = step.determined & ~settled
    return fits


class _Step(NamedTuple):
    """One step of Gauss-Newton of f epochs.

    Attributes
    ----------
    poses : Float[np.ndarray, 'f 7']
        (f, 7), points: (f, k, 3) after it.
    information : Float[np.ndarray, 'f 6 6']
        (f, 6, 6) before it.
    inliers : Bool[np.ndarray, 'f k']
        (f, k) matches that took part.
    squares : Float[np.ndarray, 'f k']
        (f, k) squared lengths of the whitened innovations before it.
    length : Float[np.ndarray, ' f']
        (f,) in standard deviations of the pose.
    determined : Bool[np.ndarray, ' f']
        (f,) whether the matches determine a pose; else it stays.
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
    poses: Float[np.ndarray, "f 7"],
    points: Float[np.ndarray, "f k 3"],
    agreeing: Bool[np.ndarray, "f k"],
) -> _Step:
    """A step from poses and points (m, frame g) of these epochs."""
    innovation, jacobian, valid, by_left = _linearise_matches(model, table, poses, points)
    squares = np.einsum("fki,fki->fk", innovation, innovation)
    u, v, right = (np.abs(innovation[..., k]) for k in range(3))  # a maximum along so short an axis is slow
    inliers = valid & _within_gate(np.maximum(np.maximum(u, v), right), agreeing)
    determined = np.count_nonzero(inliers, axis=1) >= np.maximum(4, SMALLEST_SHARE * table.counts)
    jacobian[~inliers], innovation[~inliers] = 0.0, 0.0
    A, b = jacobian.reshape(len(poses), -1, 6), innovation.reshape(len(poses), -1, 1)
    information, gradient = np.swapaxes(A, 1, 2) @ A, np.swapaxes(A, 1, 2) @ b
    determined[determined] = which_definite(information[determined])
    step = np.zeros((len(poses), 6))
    step[determined] = np.linalg.solve(information[determined], gradient[determined])[..., 0]
    length = np.sqrt(np.einsum("fi,fij,fj->f", step, information, step))
    if by_left is not None:
        left = innovation - (jacobian @ step[:, None, :, None])[..., 0]
        corrections = (by_left @ left[..., None])[..., 0]
        points = table.points + np.where(inliers[..., None], corrections, 0.0)
    return _Step(model.layout.retract(poses, step), points, information, inliers, squares, length, determined)


def _linearise_matches(
    model: StereoLandmark,
    table: MatchTable,
    poses: Float[np.ndarray, "f 7"],
    points: Float[np.ndarray, "f k 3"],
) -> MatchRows:
    (f, k), epochs = table.given.shape, np.repeat(np.arange(len(table.given)), table.given.shape[1])
    pixels, by_left = table.pixels.reshape(f * k, 3), None
    if table.covariance is None:  # points of an exact map stay where they are
        parameters = table.parameters.reshape(f * k, -1)
        innovation, jacobian, valid, _ = model.linearise_each(poses, epochs, parameters, pixels)
    else:
        # Parameters of the sensor: [point (3) | calibration | noise].
        parameters = np.concatenate([points, table.parameters[..., 3:]], axis=2).reshape(f * k, -1)
        away = (table.points - points).reshape(f * k, 3)
        matches = UncertainMatches(parameters, pixels, away, table.covariance.reshape(f * k, 3, 3))
        innovation, jacobian, valid, by_left = matches.linearised(model, poses, epochs)
        by_left = None if by_left is None else by_left.reshape(f, k, 3, 3)
    valid = valid.reshape(f, k) & table.given
    return MatchRows(innovation.reshape(f, k, 3), jacobian.reshape(f, k, 3, 6), valid, by_left)


def _within_gate(
    size: Float[np.ndarray, "f k"], agreeing: Bool[np.ndarray, "f k"]
) -> Bool[np.ndarray, "f k"]:
    """Residuals (standard deviations) below a gate that opens while a pose is off.

    The best quarter of those that agree with the rough pose judges how far it is off: among all, that quarter may be wrong.
    """
    ordered = np.sort(np.where(agreeing, size, np.nan), axis=1)  # what is not a number comes last
    quarter = np.count_nonzero(agreeing, axis=1)[:, None] // 4
    return size < np.fmax(GATE_PX, OPENING * np.take_along_axis(ordered, quarter, axis=1))


def poses_with_map(
    tracks: MeasurementStream, known: KnownMap, calibration: Float[np.ndarray, " c"], noise: NoiseLevel
) -> MeasurementStream:
    """One pose per epoch that sees at least four landmarks of the map.

    Parameters
    ----------
    noise : NoiseLevel
        Of the tracks: a standard deviation (px), or the covariance of every row (px^2).

    Raises
    ------
    InputError
        When no epoch does.
    """
    assert tracks.ids is not None
    times, epochs = [], []
    index, found = find_landmarks(known.ids, tracks.ids)
    for time, rows in track_epochs(tracks):
        own = found[rows]
        level = noise_of_rows(noise_of_rows(noise, rows), own)
        times.append(time)
        epochs.append(Matches(known.points[index[rows][own]], tracks.values[rows][own], level))
    return pose_stream(dict(zip(times, fit_poses(epochs, calibration), strict=True)))


def track_epochs(tracks: MeasurementStream) -> list[tuple[float, slice]]:
    """Each time stamp and the rows that carry it."""
    return [(float(tracks.time[a]), slice(a, b)) for a, b in pairwise(tracks.epoch_offsets.tolist())]


def shared_landmarks(tracks: MeasurementStream, times: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Numbers of landmarks that an epoch has in common with the epoch before, at some of the times of the tracks (s)."""
    assert tracks.ids is not None
    epochs = [tracks.ids[rows] for _, rows in track_epochs(tracks)]
    shared = [len(epochs[0]), *(len(np.intersect1d(a, b)) for a, b in pairwise(epochs))]
    return np.array(shared)[np.searchsorted(tracks.epoch_times, times)]


def find_landmarks(known: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row of every wanted id among the ascending known ones (any row if unknown), and whether it is known."""
    index = np.clip(np.searchsorted(known, wanted), 0, len(known) - 1)
    return index, known[index] == wanted


def pose_stream(fits: dict[float, FittedPose | None]) -> MeasurementStream:
    """The poses that could be fitted, by time.

    Raises
    ------
    InputError
        When none could.
    """
    good = {time: fit for time, fit in fits.items() if fit is not None}
    if not good:
        raise InputError(
            "no epoch of the tracks sees four landmarks of the map; check landmark ids and the calibration"
        )
    return MeasurementStream(
        "pose",
        np.array(list(good)),
        np.array([fit.pose for fit in good.values()]),
        None,
        np.array([fit.covariance for fit in good.values()]),
    )
