"""Data sets of lidar scan points, measured against the body's faces."""

from pathlib import Path

from spinfilters.data.input_file import path_text
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.raw_data import RawDataReader, RawMeasurements
from spinfilters.data.truth import Truth
from spinfilters.errors import InputError
from spinfilters.front_ends.lidar_scans import in_frame_of, pose_stream, registered_scans
from spinfilters.lidar.face_points import face_points
from spinfilters.lidar.sequence import POINTS_KIND


def read_scan_points(folder: Path, truth: Truth | None) -> RawMeasurements:
    """Points of the scans in ``scans/*.ply``, the truth told in the frame g of their faces.

    Raises
    ------
    InputError: as `read_scans`; a body without plane faces.
    """
    found = registered_scans(folder)
    try:
        points = face_points(found)
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None
    stream = MeasurementStream("lidar-points", points.time, points.values, None, points.covariance)
    told = None if truth is None else in_frame_of(pose_stream(found), truth)
    return RawMeasurements(stream, told, found.remarks, found.doubts)


READER = RawDataReader(POINTS_KIND, "lidar-points", read_scan_points)
