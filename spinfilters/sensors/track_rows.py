"""Rows of feature tracks against a map: what cameras have in common."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.data.known_map import KnownMap
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import NoiseOption
from spinfilters.data.stated_values import NumberRange
from spinfilters.geometry.camera_trajectory import in_inertial
from spinfilters.sensors.sensor import CameraView, MotionSamples

PIXEL_STD: Final = NoiseOption("pixel_std", "pixels", NumberRange(1e-12, 1e6, "px"), 1.0, (0, 1))
"""Of each pixel coordinate: an option that cameras share."""
CALIBRATION: Final = (466.7, 470.0, 320.0, 240.0)
"""fx, fy, cx, cy of the analyser's cameras, px."""


def mapped_rows(
    stream: MeasurementStream, known_map: KnownMap
) -> tuple[slice | Bool[np.ndarray, " n"], Float[np.ndarray, "k 3"]]:
    """Rows that see mapped landmarks, and the points of these.

    A slice where all do.
    """
    assert stream.ids is not None  # a stream of landmarks always has them
    ids, last = known_map.ids, len(known_map.ids) - 1
    numbered = ids[0] == 0 and ids[-1] == last  # from 0 on: an id is its row
    row = np.clip(stream.ids if numbered else np.searchsorted(ids, stream.ids), 0, last)
    known = ids[row] == stream.ids
    return (slice(None), known_map.points[row]) if known.all() else (known, known_map.points[row[known]])


def posed_samples(
    time: Float[np.ndarray, " k"],
    poses: Float[np.ndarray, "k 7"],
    view: CameraView,
    landmarks: KnownMap | None = None,
) -> MotionSamples:
    """Initial motion samples of camera poses (t m, q) of g.

    They are in the camera's frame, with the map that was found with them, if one was.
    """
    camera_poses = view.camera_poses(time)
    if camera_poses is not None:
        poses = in_inertial(poses, camera_poses)
    return MotionSamples(time, poses[:, 3:], positions=poses[:, :3], landmarks=landmarks)
