"""Poses of a body from stereo tracks and a map."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.known_map import KnownMap
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.errors import InputError
from spinfilters.models.sensor_noise import NoiseLevel, noise_of_rows
from spinfilters.tracks.matches import Matches
from spinfilters.tracks.pose_fit import FittedPose, fit_poses


def poses_with_map(
    tracks: MeasurementStream, known: KnownMap, calibration: Float[np.ndarray, " c"], noise: NoiseLevel
) -> MeasurementStream:
    """One pose per epoch that sees at least four landmarks of the map.

    Parameters
    ----------
    noise: of the tracks: a standard deviation (px), or the covariance of every row (px^2).

    Raises
    ------
    InputError: when no epoch does.
    """
    assert tracks.ids is not None
    times, epochs = [], []
    for time, rows in track_epochs(tracks):
        index, found = find_landmarks(known.ids, tracks.ids[rows])
        own = noise_of_rows(noise_of_rows(noise, rows), found)
        times.append(time)
        epochs.append(Matches(known.points[index[found]], tracks.values[rows][found], own))
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
    """Row of every wanted id, and whether it is known.

    Among the ascending known ones (any row where unknown).
    """
    index = np.clip(np.searchsorted(known, wanted), 0, len(known) - 1)
    return index, known[index] == wanted


def pose_stream(fits: dict[float, FittedPose | None]) -> MeasurementStream:
    """The poses that could be fitted, by time.

    Raises
    ------
    InputError: when none could.
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
