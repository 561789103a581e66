"""Wrong associations, for tests of everything that must survive them."""

import numpy as np

from spinfilters.io.measurement_log import MeasurementStream


def swapped(tracks: MeasurementStream, share: float, generator: np.random.Generator) -> MeasurementStream:
    """Tracks with a share of every frame's ids handed on among their observations."""
    assert tracks.ids is not None
    ids = tracks.ids.copy()
    for first, last in zip(tracks.epoch_offsets[:-1], tracks.epoch_offsets[1:], strict=True):
        rows = first + np.flatnonzero(generator.random(last - first) < share)
        ids[rows] = np.roll(ids[rows], 1)
    return MeasurementStream("stereo", tracks.time, tracks.values, ids)
