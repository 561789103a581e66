"""Tracks of all images together: association in both directions of time, bundle adjustment, noise.

Visual odometry starts at the epoch from where it finds most poses. Epochs after a gap are not recognised by the few that went
before. They are tried again with the map of all that was found, last ones first; and where most are still lost, the sequence is
begun anew at the first of them.

Residuals of the bundle adjustment identify the noise of the observations and which of them are wrong, before any estimator assumes
how the body moves. Landmarks are eliminated (Schur complement); the first pose stays where it is, which fixes frame g.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import bsr_array, csr_array

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import Huber
from spinfilters.io.camera import StereoRig
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.sensor_noise import CorrelatedNoise
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout
from spinfilters.vision.association import EPOCHS, Tracker
from spinfilters.vision.front_end import FrontEndOptions
from spinfilters.vision.image_folder import LossCount
from spinfilters.vision.stereo_geometry import points_of
from spinfilters.vision.stereo_matching import EpochObservations, StereoFeatures, TimedFeatures
from spinfilters.vision.track_noise import (
    FEWEST,
    ErrorCorrelation,
    LandmarkResiduals,
    TrackNoise,
    error_correlation,
    identified,
)

ITERATIONS: Final = 8
SETTLED: Final = 1e-4
"""Relative fall of the cost below which iterations end."""
LOSS: Final = Huber(3.0)
"""Of the length of the three whitened residuals, in standard deviations."""
RIDGE: Final = 1e-9
"""Share of its own trace that is added to a landmark's information, so that one seen once has an inverse."""

PLACE_AND_DISPARITY: Final = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, -1]])
"""Of (u_left, v_left, u_right)."""


@dataclass(frozen=True)
class Observations:
    """n observations of landmarks at epochs.

    Attributes
    ----------
    epoch : ndarray of shape (n,)
        Row of the poses.
    landmark : ndarray of shape (n,)
        Row of the landmarks.
    values : ndarray of shape (n, 3)
        px.
    covariance : ndarray of shape (n, 3, 3)
        px^2.
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
    poses : ndarray of shape (e, 7)
        t, q_ig.
    points : ndarray of shape (l, 3)
        m, frame g.
    whitened : ndarray of shape (n, 3)
        Residuals in standard deviations.
    jacobian : ndarray of shape (n, 3, 3)
        Of whitened predictions by the landmark.
    information : ndarray of shape (l, 3, 3)
        Of the landmarks at these poses.
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
    """Poses and landmarks of least robust cost by Gauss-Newton: the best of all iterations."""
    best, least, last = _linearise(observations, poses, points, rig), np.inf, np.inf
    state = best
    for _ in range(ITERATIONS):
        cost = _cost(state.whitened)
        if cost < least:
            best, least = state, cost
        if not cost < last * (1 - SETTLED):
            break
        last = cost
        poses, points = _take_step(observations, state)
        state = _linearise(observations, poses, points, rig)
    return state if _cost(state.whitened) < least else best


def _linearise(
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
    # a landmark in g moves as the place does, turned into i: columns of place times R_ig of the epoch
    by_point = by_pose[..., :3] @ matrix_from_quaternion(poses[:, 3:])[observations.epoch]
    weight = LOSS.weight(np.square(innovation).sum(axis=1))
    squares = weight[:, None, None] * (np.swapaxes(by_point, 1, 2) @ by_point)
    information = _sums(observations.landmark, squares, len(points))
    trace = np.trace(information, axis1=1, axis2=2)
    information += (RIDGE * trace + 1e-12)[:, None, None] * np.eye(3)
    return _Linearised(poses, points, innovation, by_point, information, by_pose, weight)


@dataclass(frozen=True)
class _Linearised(Adjusted):
    """Residuals with pose Jacobian (n, 3, 6) and robust weights (n,)."""

    by_pose: Float[np.ndarray, "n 3 6"]
    weight: Float[np.ndarray, " n"]


def _cost(whitened: Float[np.ndarray, "n 3"]) -> float:
    return float(np.sum(LOSS.cost(np.square(whitened).sum(axis=1))))


def _take_step(
    observations: Observations, at: "_Linearised"
) -> tuple[Float[np.ndarray, "e 7"], Float[np.ndarray, "l 3"]]:
    """Poses and points after a Gauss-Newton step.

    Order: poses (6 e), then landmarks (3 l), which are eliminated first.
    """
    epochs, landmarks = len(at.poses), len(at.points)
    weighted_pose = at.weight[:, None, None] * np.swapaxes(at.by_pose, 1, 2)
    weighted_point = at.weight[:, None, None] * np.swapaxes(at.jacobian, 1, 2)
    # diagonal blocks of the poses (H, b), right side of the landmarks (g), blocks between them (W)
    whitened = at.whitened[..., None]
    H = _sums(observations.epoch, weighted_pose @ at.by_pose, epochs)
    b = _sums(observations.epoch, (weighted_pose @ whitened)[..., 0], epochs)
    g = _sums(observations.landmark, (weighted_point @ whitened)[..., 0], landmarks)
    inverse = np.linalg.inv(at.information)
    blocks = weighted_pose @ at.jacobian
    W, scaled = _block_matrices(
        observations, (blocks, blocks @ inverse[observations.landmark]), (epochs, landmarks)
    )
    # Schur complement of the landmarks: S = H - W V^-1 W', with V their 3 by 3 blocks
    S = -(scaled @ W.T).toarray()
    for epoch in range(epochs):
        S[6 * epoch : 6 * epoch + 6, 6 * epoch : 6 * epoch + 6] += H[epoch]
    right = b.ravel() - scaled @ g.ravel()
    step = np.zeros(6 * epochs)
    S[np.diag_indices_from(S)] += 1e-9 * np.trace(S) / len(S)
    step[6:] = np.linalg.solve(S[6:, 6:], right[6:])  # the first pose is fixed: it defines g
    # back-substitution: V d = g - W' step
    back = g - (W.T @ step).reshape(-1, 3)
    points = at.points + (inverse @ back[..., None])[..., 0]
    return _sensor().layout.retract(at.poses, step.reshape(-1, 6)), points


def _sums(
    rows: Int[np.ndarray, " n"], values: Float[np.ndarray, "n ..."], count: int
) -> Float[np.ndarray, "m ..."]:
    """Sums of the values of each row, as a product with a matrix of ones."""
    ends = np.bincount(rows, minlength=count).cumsum()
    of_row = csr_array(
        (np.ones(len(rows)), np.argsort(rows, kind="stable"), np.concatenate([[0], ends])),
        shape=(count, len(rows)),
    )
    return (of_row @ values.reshape(len(rows), -1)).reshape(count, *values.shape[1:])


def _block_matrices(
    observations: Observations, matrices: Sequence[Float[np.ndarray, "n 6 3"]], shape: tuple[int, int]
) -> list[bsr_array]:
    """Sparse matrices of one block per observation each.

    Rows poses, columns landmarks; a landmark is seen once in an epoch.
    """
    order = np.lexsort((observations.landmark, observations.epoch))
    starts = np.searchsorted(observations.epoch[order], np.arange(shape[0] + 1))
    columns, size = observations.landmark[order], (6 * shape[0], 3 * shape[1])
    return [bsr_array((blocks[order], columns, starts), shape=size) for blocks in matrices]


STAGE: Final = "observations in tracks"
FEWEST_EPOCHS: Final = 2
LARGEST_ERROR: Final = 4.0
"""Length of a residual in standard deviations beyond which an observation is left out."""


@dataclass(frozen=True)
class Tracks:
    """Tracks of a sequence.

    Attributes
    ----------
    stream : MeasurementStream
        Of the sensor "stereo", with a covariance per row.
    poses : ndarray of shape (e, 7)
        Of g at its epochs, without dynamics.
    noise : TrackNoise
        Identified.
    correlation : ErrorCorrelation
        Of the errors of a landmark's observations.
    """

    stream: MeasurementStream
    poses: Float[np.ndarray, "e 7"]
    noise: TrackNoise
    correlation: ErrorCorrelation


@dataclass(frozen=True)
class _Sequence:
    """Observations of landmarks that are seen twice at least, and what identifies their noise."""

    observations: Observations
    time: Float[np.ndarray, " n"]
    ids: Int[np.ndarray, " n"]
    size: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.time)

    def part(self, chosen: Bool[np.ndarray, " n"]) -> "_Sequence":
        """The chosen observations alone."""
        return _Sequence(
            self.observations.part(chosen),
            self.time[chosen],
            self.ids[chosen],
            self.size[chosen],
            self.residual[chosen],
        )

    def with_noise(self, noise: TrackNoise) -> "_Sequence":
        """The same with covariances of this noise model."""
        covariance = noise.covariance(self.size, self.residual)
        return replace(self, observations=replace(self.observations, covariance=covariance))


def batch_tracks(
    points: Sequence[TimedFeatures],
    rig: StereoRig,
    options: FrontEndOptions,
    losses: LossCount,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Tracks:
    """Tracks of points of pairs.

    Parameters
    ----------
    progress : Callable[[int, int], None]
        Called with how many epochs are associated, of both passes over them.

    Raises
    ------
    InputError
        Fewer than two epochs whose pose is found, no landmark seen twice.
    """
    epochs = _require_epochs(
        found_epochs(points, rig, options, lambda done, _: progress(done, 2 * len(points)))
    )
    noise, adjusted, _ = _adjust_with_own_noise(epochs, options.noise, rig, 1)
    tracker = Tracker(rig, noise, losses, options.association)
    again = []
    for epoch, pose in zip(epochs, adjusted.poses, strict=True):
        again.append(tracker.add(epoch.epoch, epoch.time, points[epoch.epoch][1], pose))
        progress(len(points) + epoch.epoch + 1, 2 * len(points))
    losses.lose(EPOCHS, "whose pose was not found", len(points) - len(epochs))
    epochs = _require_epochs([each for each in again if each is not None])
    noise, adjusted, sequence = _adjust_with_own_noise(epochs, noise, rig, 2)
    return _tracks_of(epochs, adjusted, sequence, noise, losses)


def _tracks_of(
    epochs: list[EpochObservations],
    adjusted: Adjusted,
    sequence: _Sequence,
    noise: TrackNoise,
    losses: LossCount,
) -> Tracks:
    good = _share_explained(adjusted)
    losses.lose(STAGE, "of landmarks seen once", sum(len(each.ids) for each in epochs) - len(sequence))
    losses.lose(STAGE, "against the map", int(np.count_nonzero(~good)))
    correlation = error_correlation(_whiten_residuals(adjusted, sequence, noise).part(good))
    kept = sequence.part(good)
    kept = kept.part(np.bincount(kept.ids)[kept.ids] > 1)
    losses.lose(STAGE, "of landmarks seen once", int(np.count_nonzero(good)) - len(kept))
    losses.keep(STAGE, len(kept))
    covariance = correlation.inflated(noise).covariance(kept.size, kept.residual)
    _, ids = np.unique(kept.ids, return_inverse=True)
    stream = MeasurementStream("stereo", kept.time, kept.observations.values, ids, covariance)
    return Tracks(stream, adjusted.poses, noise, correlation)


def _require_epochs(epochs: list[EpochObservations]) -> list[EpochObservations]:
    require_epochs(len(epochs))
    return epochs


def require_epochs(count: int) -> None:
    """InputError: so few epochs with a pose."""
    if count < FEWEST_EPOCHS:
        raise InputError(
            f"the pose of {count} pair(s) was found, at least {FEWEST_EPOCHS} are needed: a textured body, sharp, at one time, "
            "cam0 the left camera"
        )


def _adjust_with_own_noise(
    epochs: list[EpochObservations], noise: TrackNoise, rig: StereoRig, turns: int
) -> tuple[TrackNoise, Adjusted, _Sequence]:
    """Bundle adjustment with the noise that it leaves, by turns; one is enough before the observations are found anew."""
    sequence = _sequence(epochs)
    poses = np.array([epoch.pose for epoch in epochs])
    points = _first_points(sequence.observations, poses, rig)
    adjusted = adjust(sequence.with_noise(noise).observations, poses, points, rig)
    for _ in range(turns):
        current = sequence.with_noise(noise)
        good = _share_explained(adjusted)
        if np.count_nonzero(good) < FEWEST:
            break
        residuals, freedom = adjusted.residuals(current.observations)
        noise = identified(residuals[good], freedom[good], sequence.size[good], sequence.residual[good])
        observations = sequence.with_noise(noise).observations
        adjusted = adjust(observations, adjusted.poses, adjusted.points, rig)
    return noise, adjusted, sequence.with_noise(noise)


def _share_explained(adjusted: Adjusted) -> Bool[np.ndarray, " n"]:
    return np.linalg.norm(adjusted.whitened, axis=1) <= LARGEST_ERROR


def _whiten_residuals(adjusted: Adjusted, sequence: _Sequence, noise: TrackNoise) -> LandmarkResiduals:
    """Whitened residuals of place and disparity after bundle adjustment."""
    observations = sequence.observations
    place, disparity = noise.variances(sequence.size, sequence.residual)
    std = np.sqrt(np.column_stack([place, place, disparity]))
    return LandmarkResiduals(
        observations.landmark,
        adjusted.points[observations.landmark],
        matrix_from_quaternion(adjusted.poses[:, 3:])[observations.epoch],
        adjusted.poses[observations.epoch, :3],
        adjusted.residuals(observations)[0] / std,
        adjusted.by_landmark(observations) / std[:, :, None],
    )


def _sequence(epochs: list[EpochObservations]) -> _Sequence:
    ids = np.concatenate([epoch.ids for epoch in epochs])
    often = np.bincount(ids)[ids] > 1
    if not often.any():
        raise InputError("no landmark is seen twice; give images that follow one another more closely")
    counts = [len(epoch.ids) for epoch in epochs]
    _, landmark = np.unique(ids[often], return_inverse=True)
    observations = Observations(
        np.repeat(np.arange(len(epochs)), counts)[often],
        landmark,
        np.concatenate([epoch.points.values for epoch in epochs])[often],
        np.concatenate([epoch.covariance for epoch in epochs])[often],
    )
    time = np.repeat([epoch.time for epoch in epochs], counts)[often]
    size = np.concatenate([epoch.points.features.size for epoch in epochs])[often]
    residual = np.concatenate([epoch.points.residual for epoch in epochs])[often]
    return _Sequence(observations, time, ids[often], size, residual)


def _first_points(
    observations: Observations, poses: Float[np.ndarray, "e 7"], rig: StereoRig
) -> Float[np.ndarray, "l 3"]:
    """Mean of the triangulated observations of each landmark, frame g."""
    camera = points_of(observations.values, rig)
    rotations = matrix_from_quaternion(poses[:, 3:])[observations.epoch]
    points = np.einsum("nji,nj->ni", rotations, camera - poses[observations.epoch, :3])
    counts = np.bincount(observations.landmark)
    return _sums(observations.landmark, points, len(counts)) / counts[:, None]


ENOUGH: Final = 0.5
"""Share of the epochs to be found, else another beginning is tried."""
MOST_BEGINNINGS: Final = 3

TimedPoints = Sequence[tuple[float, StereoFeatures]]


def found_epochs(
    points: TimedPoints,
    rig: StereoRig,
    options: FrontEndOptions,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> list[EpochObservations]:
    """Epochs whose pose is found, in order of time.

    Parameters
    ----------
    points : TimedPoints
        Times (s) and points of each pair.
    progress : Callable[[int, int], None]
        Called with how many epochs are associated, and of how many.
    """
    best: dict[int, EpochObservations] = {}
    begin = 0
    for _ in range(MOST_BEGINNINGS):
        found = _track_from(
            points, begin, Tracker(rig, options.noise, LossCount(), options.association), progress
        )
        best = max(best, found, key=len)
        begin = next((number for number in range(begin, len(points)) if number not in found), len(points))
        if len(best) >= ENOUGH * len(points) or len(points) - begin <= len(best):
            break
    return [best[number] for number in sorted(best)]


def _track_from(
    points: TimedPoints, begin: int, tracker: Tracker, progress: Callable[[int, int], None]
) -> dict[int, EpochObservations]:
    """Epochs found from a beginning on, by number, then those that were lost, backwards."""
    found: dict[int, EpochObservations] = {}
    numbers = range(begin, len(points))
    for number in (*numbers, *reversed(range(len(points)))):
        epoch = None if number in found else tracker.add(number, *points[number])
        if epoch is not None:
            found[number] = epoch
        progress(len(found), len(points))
    return found
