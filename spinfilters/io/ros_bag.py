"""Bags of ROS 1 and 2 and MCAP files: rates, poses and transforms with a stamp; needs the extra ``ros``."""

import os
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import MAX_TABLE_ROWS, path_text, printable, reason, require_file, value_text
from spinfilters.io.measurement_log import Acceleration, MeasurementStream
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import MotionTable
from spinfilters.io.stated_values import ReadingOptions

LARGEST_BAG: Final = 64 * 1024**3
"""Bytes: messages are read one by one, so that a bag with images may be large."""
FIRST_BYTES: Final = {".bag": b"#ROSBAG V", ".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
"""Of a file of each suffix."""
_CHUNK: Final = 1 << 20
_FOOTER: Final = struct.Struct(
    "<BQQQI8s"
)  # opcode, length, start of the summary, of its offsets, its checksum, magic
_DATA_END: Final = struct.Struct("<BQI")  # opcode, length, checksum of all before
_FOOTER_OPCODE, _DATA_END_OPCODE = 2, 15


def require_bag(path: Path) -> None:
    """Check a bag of ROS 1 or 2 that is one file.

    Raises
    ------
    InputError
        As `require_file`; other first bytes than its suffix says; an MCAP whose data have another checksum than
        it states.
    """
    size, begin = require_file(path, LARGEST_BAG), FIRST_BYTES[path.suffix.lower()]
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as stream:
            if stream.read(len(begin)) != begin:
                raise InputError(
                    f"{path_text(path)}: is no whole ROS bag (a {path.suffix.lower()} begins otherwise); record or copy it again"
                )
            if path.suffix.lower() == ".mcap":
                _require_checksum(path, stream, size)
    except OSError as error:
        raise InputError(f"{path_text(path)}: cannot be read ({reason(error)}); copy it again") from None


def _require_checksum(path: Path, stream: BinaryIO, size: int) -> None:
    """InputError: the data section has another CRC-32 than its end states; 0 states none, and a damaged end the parser finds."""
    if size < _FOOTER.size + _DATA_END.size:
        return
    stream.seek(size - _FOOTER.size)
    opcode, _, summary, *_ = _FOOTER.unpack(stream.read(_FOOTER.size))
    place = (summary or size - _FOOTER.size) - _DATA_END.size
    if opcode != _FOOTER_OPCODE or not 0 < place < size:
        return
    stream.seek(place)
    opcode, length, stated = _DATA_END.unpack(stream.read(_DATA_END.size))
    if opcode != _DATA_END_OPCODE or length != 4 or not stated:
        return
    stream.seek(0)
    found, left = 0, place
    while left and (chunk := stream.read(min(_CHUNK, left))):
        found, left = zlib.crc32(chunk, found), left - len(chunk)
    if found != stated:
        raise InputError(
            f"{path_text(path)}: its data do not have the checksum that it states; copy it again"
        )


def _imu(message: Any) -> list[float]:
    rate, force = message.angular_velocity, message.linear_acceleration
    return [rate.x, rate.y, rate.z, force.x, force.y, force.z]


def _pose(pose: Any) -> list[float]:
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _transform(transform: Any) -> list[float]:
    p, q = transform.translation, transform.rotation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _vector(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


_RATES: Final = ("Imu", "TwistStamped", "Vector3Stamped", "TwistWithCovarianceStamped")
"""Ends of the types that are body rates; of the others poses are read."""
_TWISTS: Final = ("TwistStamped", "TwistWithCovarianceStamped")
"""Ends of the types that a tracker derives from the poses beside them."""
_TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
"""Type of messages of many transforms; each frame is a source of its own."""
_MESSAGES: Final[dict[str, Callable[[Any], list[float]]]] = {
    "sensor_msgs/msg/Imu": _imu,
    "geometry_msgs/msg/PoseStamped": lambda message: _pose(message.pose),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: _pose(message.pose.pose),
    "geometry_msgs/msg/TransformStamped": lambda message: _transform(message.transform),
    "nav_msgs/msg/Odometry": lambda message: _pose(message.pose.pose),
    "geometry_msgs/msg/TwistStamped": lambda message: _vector(message.twist.angular),
    "geometry_msgs/msg/TwistWithCovarianceStamped": lambda message: _vector(message.twist.twist.angular),
    "geometry_msgs/msg/Vector3Stamped": lambda message: _vector(message.vector),
}
"""Numbers of a message of each type that is read: rates and specific force, or position and unit quaternion."""


MOTION_TYPES: Final = tuple(_MESSAGES)
"""Types of messages that have rates or poses."""


def read_ros_bag(path: Path, options: ReadingOptions) -> Dataset:
    """Rates or poses of one topic, which the user states where a bag has several."""
    options.require_only(("topic",), "a ROS bag")
    topic, kind, rows = _messages(path, options.topic)
    order = np.argsort(rows[:, 0], kind="stable")
    stamps, values = rows[order, 0], rows[order, 1:]
    keep = np.concatenate([[True], np.diff(stamps) > 0])
    time, values = stamps[keep], values[keep]
    remarks = [f"topic {printable(topic)}"]
    if not keep.all():
        remarks.append(f"{np.count_nonzero(~keep)} messages of a stamp that was there left out")
    sensor, columns = ("gyro", 3) if kind.endswith(_RATES) else ("pose", 7)
    try:
        stream = MeasurementStream(sensor, time, values[:, :columns])
    except InputError as error:
        raise InputError(f"{path_text(path)}: topic {printable(topic)}: {error}") from None
    force = values[:, 3:] if kind.endswith("Imu") and values[:, 3:].any() else None
    acceleration = None if force is None else Acceleration(time, force)
    return motion_dataset(path, path.name, MotionTable(stream, acceleration, tuple(remarks)))


def _rows(path: Path, bag: Any, connection: Any) -> list[list[float]]:
    """Stamp (s) and numbers of every message of a topic. InputError: too many."""
    rows: list[list[float]] = []
    for found, stamp, raw in bag.messages([connection]):
        message = bag.deserialize(raw, found.msgtype)
        rows.append([_stamp(message, stamp), *_MESSAGES[connection.msgtype](message)])
        _require_readable(path, len(rows))
    return rows


def _require_readable(path: Path, count: int) -> None:
    """InputError: more messages than are read."""
    if count > MAX_TABLE_ROWS:
        raise InputError(f"{path_text(path)}: has more than {MAX_TABLE_ROWS} messages; cut it")


def _moving_frames(path: Path, bag: Any) -> dict[str, list[list[float]]]:
    """Stamp (s) and pose in its parent of every frame that moves, of all messages of transforms. InputError: too many."""
    connections = [each for each in bag.connections if each.msgtype == _TRANSFORMS]
    rows: dict[str, list[list[float]]] = {}
    count = 0
    for found, stamp, raw in bag.messages(connections) if connections else ():
        for each in bag.deserialize(raw, found.msgtype).transforms:
            rows.setdefault(each.child_frame_id, []).append(
                [_stamp(each, stamp), *_transform(each.transform)]
            )
            count += 1
        _require_readable(path, count)
    return {frame: held for frame, held in rows.items() if any(row[1:] != held[0][1:] for row in held)}


def _of_frame(path: Path, bag: Any, topic: str | None) -> tuple[str, list[list[float]]] | None:
    """Name and rows of the one frame that moves, or of that which the user names; None without any. InputError: several."""
    frames = _moving_frames(path, bag)
    if topic in frames:
        return topic, frames[topic]
    if len(frames) > 1:
        listed = ", ".join(sorted(map(printable, frames))[:6])
        raise InputError(
            f"{path_text(path)}: has transforms of several frames that move; give --topic, one of {listed}"
        )
    is_any = topic is None or topic in {each.topic for each in bag.connections if each.msgtype == _TRANSFORMS}
    return next(iter(frames.items()), None) if is_any else None


def _messages(path: Path, topic: str | None) -> tuple[str, str, Float[np.ndarray, "n m"]]:
    """Topic, type, and rows of stamp (s) and numbers. InputError: unreadable."""
    with _open_bag(path) as bag:
        known = [each for each in bag.connections if each.msgtype in _MESSAGES]
        is_other = not known if topic is None else topic not in {each.topic for each in known}
        frame = _of_frame(path, bag, topic) if is_other else None
        if frame is None:
            connection = _connection(path, bag.connections, topic)
            name, kind, rows = connection.topic, connection.msgtype, _rows(path, bag, connection)
        else:
            (name, rows), kind = frame, _TRANSFORMS
    if len(rows) < 2:
        raise InputError(f"{path_text(path)}: topic {printable(name)} has {len(rows)} messages; record more")
    return name, kind, np.array(rows)


class BagMessage(NamedTuple):
    """A message of a bag: its topic and type, time of measurement in ns, and content."""

    topic: str
    kind: str
    stamp: int
    content: Any


def topics_by_type(path: Path) -> dict[str, str]:
    """Type of the messages of every topic of a bag. InputError: as `bag_messages`."""
    with _open_bag(path) as bag:
        return {each.topic: each.msgtype for each in bag.connections}


def bag_messages(path: Path, topics: Collection[str]) -> Iterator[BagMessage]:
    """Messages of some topics, one by one in the order of the bag.

    Raises
    ------
    InputError
        The package rosbags is missing, or the bag is damaged.
    """
    with _open_bag(path) as bag:
        for found, recorded, raw in bag.messages([each for each in bag.connections if each.topic in topics]):
            content = bag.deserialize(raw, found.msgtype)
            stamp = content.header.stamp
            yield BagMessage(
                found.topic, found.msgtype, stamp.sec * 1_000_000_000 + stamp.nanosec or recorded, content
            )


@contextmanager
def _open_bag(path: Path) -> Iterator[Any]:
    """An open bag; what its parsers raise becomes an InputError."""
    try:
        from rosbags.highlevel import AnyReader  # pyright: ignore[reportMissingImports]
        from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError(
            f"{path_text(path)}: a ROS bag needs the package rosbags; install it with pip install 'spinfilters[ros]'"
        ) from None
    if not os.path.isdir(path):
        require_bag(path)
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
            yield bag
    except InputError:
        raise
    except Exception as error:  # the package meets a damaged bag with whatever its parsers raise
        raise _broken_bag_error(path, error) from None


def _broken_bag_error(path: Path, error: Exception) -> InputError:
    return InputError(
        f"{path_text(path)}: is no whole ROS bag ({reason(error)[:120]}); record or copy it again"
    )


def _connection(path: Path, connections: list[Any], topic: str | None) -> Any:
    """The connection of the topic, or the only one that can be read."""
    known = [each for each in connections if each.msgtype in _MESSAGES]
    listed = ", ".join(sorted({printable(each.topic) for each in known})[:6])
    chosen = known if topic is None else [each for each in known if each.topic == topic]
    if topic is None:
        tracked = {_parent(each.topic) for each in known if not each.msgtype.endswith(_RATES)}
        chosen = [
            each for each in known if not (each.msgtype.endswith(_TWISTS) and _parent(each.topic) in tracked)
        ]
    if not known:
        read = ", ".join(sorted(name.rsplit("/", 1)[-1] for name in (*_MESSAGES, _TRANSFORMS)))
        types = ", ".join(sorted({each.msgtype.rsplit("/", 1)[-1] for each in connections})[:6]) or "nothing"
        raise InputError(f"{path_text(path)}: holds {printable(types)}; only {read} are read; record one")
    if not chosen:
        raise InputError(
            f"{path_text(path)}: has no topic {value_text(topic)} that is read; give --topic {listed}"
        )
    if len({each.topic for each in chosen}) > 1:
        raise InputError(
            f"{path_text(path)}: has several topics that are read; give --topic, one of {listed}"
        )
    return chosen[0]


def _parent(topic: str) -> str:
    """Path of a topic without its last word, as /vrpn/target of /vrpn/target/pose."""
    return topic.rpartition("/")[0]


def _stamp(message: Any, recorded: int) -> float:
    """Time of measurement, s: of the header, or of recording (ns) where the header has none."""
    stamp = message.header.stamp
    seconds = float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return seconds if seconds else 1e-9 * recorded
