"""Folders of lidar scans made from the point clouds of a ROS bag."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.ray_angles import angles_of
from spinfilters.io.input_file import path_text
from spinfilters.io.ros_bag import bag_messages
from spinfilters.lidar.scan import RETURN, Scan, write_scan

MOST_CLOUDS: Final = 100_000
_NUMBERS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy's name by ROS' number of a type (sensor_msgs/PointField)."""


def unpack_bag_clouds(path: Path, topic: str, folder: Path) -> int:
    """Write the clouds of a topic as scans in the frame of the lidar; returns how many.

    All points of a cloud are at its stamp; times count from the first cloud, s.

    Raises
    ------
    InputError
        Clouds without x, y, z or with fewer bytes than they state, fewer than two, a damaged bag.
    """
    (folder / "scans").mkdir()
    count, first = 0, 0
    for message in bag_messages(path, (topic,)):
        first = first or message.stamp
        points = _points(path, message.content)
        seen = np.isfinite(points).all(axis=1) & (np.linalg.norm(points, axis=1) > 0)
        if not seen.any():
            continue
        if count >= MOST_CLOUDS:
            raise InputError(f"{path_text(path)}: has more than {MOST_CLOUDS} clouds; cut it")
        time = (message.stamp - first) * 1e-9
        write_scan(folder / "scans" / f"{count:06d}.ply", _scan(points[seen], time))
        count += 1
    if count < 2:
        raise InputError(f"{path_text(path)}: topic {topic} has {count} clouds with points; record more")
    return count


def _scan(points: Float[np.ndarray, "n 3"], time: float) -> Scan:
    azimuth, elevation = angles_of(points)
    ones = np.ones(len(points))
    return Scan(
        time=time * ones,
        azimuth=azimuth,
        elevation=elevation,
        distance=np.linalg.norm(points, axis=1),
        intensity=ones,
        flag=np.full(len(points), RETURN),
        window=np.zeros(len(points), dtype=int),
    )


def _points(path: Path, message: Any) -> Float[np.ndarray, "n 3"]:
    """Columns x, y, z of a cloud, m; lines of an organised cloud one after another."""
    fields = {each.name: each for each in message.fields if each.name in ("x", "y", "z")}
    if len(fields) < 3 or any(each.datatype not in _NUMBERS for each in fields.values()):
        raise InputError(f"{path_text(path)}: clouds have no numbers x, y and z; record points")
    order, step = ">" if message.is_bigendian else "<", message.point_step
    names = list("xyz")
    kinds = [order + _NUMBERS[fields[name].datatype] for name in names]
    places = [fields[name].offset for name in names]
    fits = all(place + np.dtype(kind).itemsize <= step for place, kind in zip(places, kinds, strict=True))
    wanted = message.height * message.row_step
    if not fits or message.width * step > message.row_step or len(message.data) < wanted:
        raise InputError(f"{path_text(path)}: a cloud has fewer bytes than its size; record it again")
    lines = np.frombuffer(bytes(message.data)[:wanted], np.uint8).reshape(message.height, message.row_step)
    packed = np.ascontiguousarray(lines[:, : message.width * step]).reshape(-1)
    kind = np.dtype({"names": names, "formats": kinds, "offsets": places, "itemsize": step})
    table = packed.view(kind)
    return np.column_stack([table[name].astype(float) for name in names])
