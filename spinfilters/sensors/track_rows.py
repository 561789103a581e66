"""Rows of feature tracks against a map: what cameras have in common."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import InputError
from spinfilters.logs.measurement_log import MeasurementStream
from spinfilters.logs.number_range import NumberRange
from spinfilters.logs.sensor_format import NoiseOption
from spinfilters.logs.track_files import KnownMap
from spinfilters.sensors.sensor import CameraView

PIXEL_STD: Final = NoiseOption("pixel_std", "pixels", NumberRange(1e-12, 1e6, "px"), 1.0, (0, 1))
"""Of each pixel coordinate: an option that cameras share."""
CALIBRATION: Final = (466.7, 470.0, 320.0, 240.0)
"""fx, fy, cx, cy of the analyser's cameras, px."""


def required_view(sensor: str, view: CameraView | None) -> CameraView:
    """The view. InputError: None."""
    if view is None:
        raise InputError(f"{sensor} tracks need a calibration here; give the view they were taken with")
    return view


def mapped_rows(
    stream: MeasurementStream, known_map: KnownMap
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, "k 3"]]:
    """Which rows see a landmark of the map, and the points of these."""
    assert stream.ids is not None  # a stream of landmarks always has them
    row = np.clip(np.searchsorted(known_map.ids, stream.ids), 0, len(known_map.ids) - 1)
    known = known_map.ids[row] == stream.ids
    return known, known_map.points[row[known]]
