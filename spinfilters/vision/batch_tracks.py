"""Tracks of a whole sequence of images.

Visual odometry, bundle adjustment, global association, and the noise of what comes out.

Visual odometry starts at the epoch from where it finds most poses. Epochs after a gap are not recognised by the few that went
before. They are tried again with the map of all that was found, last ones first; and where most are still lost, the sequence is
begun anew at the first of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.camera import StereoRig
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.errors import InputError
from spinfilters.geometry.cameras import stereo_pair
from spinfilters.vision.association import EPOCHS, Tracker
from spinfilters.vision.bundle_adjustment import Adjusted, Observations, adjust
from spinfilters.vision.epoch_observations import EpochObservations
from spinfilters.vision.error_correlation import ErrorCorrelation, LandmarkResiduals, error_correlation
from spinfilters.vision.front_end import FrontEndOptions
from spinfilters.vision.loss_count import LossCount
from spinfilters.vision.stereo_matching import StereoFeatures, TimedFeatures
from spinfilters.vision.track_noise import FEWEST, TrackNoise, identified

STAGE: Final = "observations in tracks"
FEWEST_EPOCHS: Final = 2
LARGEST_ERROR: Final = 4.0
"""Length of a residual in standard deviations beyond which an observation is left out."""


@dataclass(frozen=True)
class Tracks:
    """Tracks of a sequence.

    Attributes
    ----------
    stream: of the sensor "stereo", with a covariance per row.   poses: (e, 7) of g at its epochs, without dynamics.
    noise: identified.   correlation: of the errors of a landmark's observations.
    """

    stream: MeasurementStream
    poses: Float[np.ndarray, "e 7"]
    noise: TrackNoise
    correlation: ErrorCorrelation


@dataclass(frozen=True)
class _Sequence:
    """Observations of landmarks that are seen twice at least, and what tells their noise."""

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
    progress: called with how many epochs are associated, of both passes over them.

    Raises
    ------
    InputError: fewer than two epochs whose pose is found, no landmark seen twice.
    """
    epochs = _required(found_epochs(points, rig, options, lambda done, _: progress(done, 2 * len(points))))
    noise, adjusted, _ = _settled(epochs, options.noise, rig)
    tracker = Tracker(rig, noise, losses, options.association)
    again = []
    for epoch, pose in zip(epochs, adjusted.poses, strict=True):
        again.append(tracker.add(epoch.epoch, epoch.time, points[epoch.epoch][1], pose))
        progress(len(points) + epoch.epoch + 1, 2 * len(points))
    losses.lose(EPOCHS, "whose pose was not found", len(points) - len(epochs))
    epochs = _required([each for each in again if each is not None])
    noise, adjusted, sequence = _settled(epochs, noise, rig)
    return _finished(epochs, adjusted, sequence, noise, losses)


def _finished(
    epochs: list[EpochObservations],
    adjusted: Adjusted,
    sequence: _Sequence,
    noise: TrackNoise,
    losses: LossCount,
) -> Tracks:
    good = _explained(adjusted)
    losses.lose(STAGE, "of landmarks seen once", sum(len(each.ids) for each in epochs) - len(sequence))
    losses.lose(STAGE, "against the map", int(np.count_nonzero(~good)))
    correlation = error_correlation(_whitened(adjusted, sequence, noise).part(good))
    kept = sequence.part(good)
    kept = kept.part(np.bincount(kept.ids)[kept.ids] > 1)
    losses.lose(STAGE, "of landmarks seen once", int(np.count_nonzero(good)) - len(kept))
    losses.keep(STAGE, len(kept))
    covariance = correlation.inflated(noise).covariance(kept.size, kept.residual)
    _, ids = np.unique(kept.ids, return_inverse=True)
    stream = MeasurementStream("stereo", kept.time, kept.observations.values, ids, covariance)
    return Tracks(stream, adjusted.poses, noise, correlation)


def _required(epochs: list[EpochObservations]) -> list[EpochObservations]:
    require_epochs(len(epochs))
    return epochs


def require_epochs(count: int) -> None:
    """InputError: so few epochs with a pose."""
    if count < FEWEST_EPOCHS:
        raise InputError(
            f"the pose of {count} pair(s) was found, at least {FEWEST_EPOCHS} are needed; a textured body must be sharp in both "
            "images, these taken at one time, and cam0 the left camera"
        )


def _settled(
    epochs: list[EpochObservations], noise: TrackNoise, rig: StereoRig
) -> tuple[TrackNoise, Adjusted, _Sequence]:
    """Bundle adjustment with the noise that it leaves, by turns."""
    sequence = _sequence(epochs)
    poses = np.array([epoch.pose for epoch in epochs])
    points = _first_points(sequence.observations, poses, rig)
    adjusted = adjust(sequence.with_noise(noise).observations, poses, points, rig)
    for _ in range(2):
        current = sequence.with_noise(noise)
        good = _explained(adjusted)
        if np.count_nonzero(good) < FEWEST:
            break
        residuals, freedom = adjusted.residuals(current.observations)
        noise = identified(residuals[good], freedom[good], sequence.size[good], sequence.residual[good])
        observations = sequence.with_noise(noise).observations
        adjusted = adjust(observations, adjusted.poses, adjusted.points, rig)
    return noise, adjusted, sequence.with_noise(noise)


def _explained(adjusted: Adjusted) -> Bool[np.ndarray, " n"]:
    return np.linalg.norm(adjusted.whitened, axis=1) <= LARGEST_ERROR


def _whitened(adjusted: Adjusted, sequence: _Sequence, noise: TrackNoise) -> LandmarkResiduals:
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
    camera = stereo_pair(rig.calibration).points_of(observations.values, rig.calibration)
    rotations = matrix_from_quaternion(poses[:, 3:])[observations.epoch]
    points = np.einsum("nji,nj->ni", rotations, camera - poses[observations.epoch, :3])
    sums = np.zeros((int(observations.landmark.max()) + 1, 3))
    np.add.at(sums, observations.landmark, points)
    return sums / np.bincount(observations.landmark)[:, None]


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
    points: times (s) and points of each pair.   progress: called with how many epochs are associated, and of how many.
    """
    best: dict[int, EpochObservations] = {}
    begin = 0
    for _ in range(MOST_BEGINNINGS):
        found = _from(points, begin, Tracker(rig, options.noise, LossCount(), options.association), progress)
        best = max(best, found, key=len)
        begin = next((number for number in range(begin, len(points)) if number not in found), len(points))
        if len(best) >= ENOUGH * len(points) or len(points) - begin <= len(best):
            break
    return [best[number] for number in sorted(best)]


def _from(
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
