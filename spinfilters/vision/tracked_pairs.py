"""Rectified pairs of a sequence with the tracks in them, for a picture of what was matched and followed."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.vision.image_folder import LossCount, PairReader, read_pairs
from spinfilters.vision.track_images import read_image_source


@dataclass(frozen=True)
class TrackedPair:
    """One rectified pair and the landmarks in it.

    Attributes
    ----------
    time : float
        s.
    left, right : ndarray of uint8, shape (h, w)
        Rectified images.
    values : ndarray of float, shape (n, 3)
        u_left, v_left, u_right of its landmarks, px.
    before : ndarray of float, shape (m, 4)
        Of the landmarks that the pair before has too: u_left, v_left now and there, px.
    """

    time: float
    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h w"]
    values: Float[np.ndarray, "n 3"]
    before: Float[np.ndarray, "m 4"]


def tracked_pairs(folder: Path, stream: MeasurementStream, count: int = 2) -> Sequence[TrackedPair]:
    """The successive pairs of a folder that have most followed landmarks.

    Parameters
    ----------
    folder : Path
        Of the images.
    stream : MeasurementStream
        Their stereo tracks.
    count : int
        Number of successive pairs.

    Returns
    -------
    sequence of TrackedPair
        In the order of time; fewer where the sequence is shorter.

    Raises
    ------
    InputError
        No images, no calibration.
    """
    assert stream.ids is not None  # a stream of landmarks always has them
    time = np.unique(stream.time)
    rows = [np.flatnonzero(stream.time == each) for each in time]
    shared = [np.intersect1d(stream.ids[a], stream.ids[b]).size for a, b in pairwise(rows)]
    windows = [sum(shared[k : k + count - 1]) for k in range(max(len(time) - count + 1, 1))]
    first = int(np.argmax(windows))
    losses = LossCount()
    source = read_image_source(folder, losses)
    reader, found = PairReader(source.rectification.rig.size, losses), []
    wanted = {round(float(each), 6): k for k, each in enumerate(time[first : first + count], start=first)}
    for pair in read_pairs(source.pairs, reader):
        number = None if pair is None else wanted.get(round(pair.time, 6))
        if pair is None or number is None:
            continue
        images = source.rectification.images(pair.left, pair.right)
        own = rows[number]
        earlier = rows[number - 1] if number else own[:0]
        _, here, there = np.intersect1d(stream.ids[own], stream.ids[earlier], return_indices=True)
        before = np.hstack([stream.values[own[here], :2], stream.values[earlier[there], :2]])
        found.append(TrackedPair(pair.time, *images, stream.values[own], before))
    return found
