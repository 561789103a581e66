"""Containers of ROS bags, looked at before a parser trusts them: first bytes, and the checksum of an MCAP."""

import os
import struct
import zlib
from pathlib import Path
from typing import BinaryIO, Final

from spinfilters.data.input_file import path_text, reason, require_file
from spinfilters.errors import InputError

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
    InputError: as `require_file`; other first bytes than its suffix says; an MCAP whose data have another checksum than it states.
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
