"""Width, height and checksums of an image file before decoding."""

import re
import struct
import zlib
from typing import Final

PNG_BEGIN: Final = b"\x89PNG\r\n\x1a\n"
_PGM: Final = re.compile(rb"P[1-7]\s+(?:#[^\n]*\n\s*)*(\d{1,9})\s+(?:#[^\n]*\n\s*)*(\d{1,9})\s")
_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of a JPEG segment that tells the size."""


def claimed_size(data: bytes) -> tuple[int, int] | None:
    """Width and height of an image file, px, None if unknown.

    PNG, JPEG, BMP, PNM or TIFF.
    """
    try:
        for begin, read in _READERS:
            if data.startswith(begin):
                return read(data)
    except (struct.error, IndexError, ValueError):
        pass
    return None


def is_damaged_png(data: bytes) -> bool:
    """Whether a PNG has a chunk whose checksum is wrong.

    Its decoder would complain on the console.
    """
    at = len(PNG_BEGIN)
    if not data.startswith(PNG_BEGIN):
        return False
    while at + 8 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return True
        if data[at + 4 : at + 8] == b"IEND":
            return False
        at = end + 4
    return True


def _png(data: bytes) -> tuple[int, int] | None:
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def _bmp(data: bytes) -> tuple[int, int] | None:
    width, height = struct.unpack("<ii", data[18:26])
    return abs(width), abs(height)


def _pnm(data: bytes) -> tuple[int, int] | None:
    found = _PGM.match(data[:4096])
    return None if found is None else (int(found[1]), int(found[2]))


def _jpeg(data: bytes) -> tuple[int, int] | None:
    """Size in a JPEG's first frame segment."""
    at = 2
    while at < len(data):
        if data[at] != 0xFF or data[at + 1] == 0xFF:
            at += 1
        elif data[at + 1] in _FRAMES:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        else:
            at += 2 + struct.unpack(">H", data[at + 2 : at + 4])[0]
    return None


def _tiff(data: bytes) -> tuple[int, int] | None:
    """Size in a TIFF's tags 256 and 257, which are short or long."""
    order = "<" if data.startswith(b"II") else ">"
    first = struct.unpack(order + "I", data[4:8])[0]
    found: dict[int, int] = {}
    for entry in range(struct.unpack(order + "H", data[first : first + 2])[0]):
        at = first + 2 + 12 * entry
        tag, kind = struct.unpack(order + "HH", data[at : at + 4])
        if tag in (256, 257):
            found[tag] = struct.unpack(
                order + ("H" if kind == 3 else "I"), data[at + 8 : at + (10 if kind == 3 else 12)]
            )[0]
    return (found[256], found[257]) if len(found) == 2 else None


_READERS: Final = (
    (b"\x89PNG", _png),
    (b"\xff\xd8", _jpeg),
    (b"BM", _bmp),
    (b"P", _pnm),
    (b"II*\0", _tiff),
    (b"MM\0*", _tiff),
)
