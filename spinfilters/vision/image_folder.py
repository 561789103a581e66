"""Folders of stereo images: header, decoding, pairs in order of time, and the count of what was left out at each stage."""

import os
import re
import struct
import threading
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8, UInt16

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_bytes, require_folder, require_text_table, value_text

HARMLESS_BYTES: Final = 16
"""Superfluous bytes before a marker that some webcams write into a JPEG; more are data that could not be read."""
_WORDS: Final = re.compile(
    rb"(?:Corrupt JPEG data|Premature end of JPEG|Inconsistent progression sequence|Invalid SOS parameters"
    rb"|Application transferred too|Unknown Adobe color transform|Warning: unknown JFIF|libpng (?:warning|error):"
    rb"|TIFF\w*: |\[ *(?:FATAL|ERROR|WARN|INFO|DEBUG):\d+(?:@[\d.]+)?\])[^\n]*\n*"
)
"""Lines of libjpeg, libpng, libtiff and OpenCV. All else is of other threads, such as the one that draws progress bars."""
_EXTRANEOUS: Final = re.compile(rb"Corrupt JPEG data: (\d+) extraneous bytes before marker 0x[0-9a-f]{2}\s*")
_lock = threading.Lock()  # standard error is one for all threads


def decode_grey(content: bytes) -> tuple[np.ndarray | None, bool]:
    """Grey values of an image file in its own depth, None where it is none, and whether its decoder complained.

    Decoders fill what they cannot read with grey and say so on standard error alone.
    """
    with _decoder_complaints() as said:
        try:
            image = cv2.imdecode(
                np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
            )
        except cv2.error:
            image = None
    return image, any(map(_is_complaint, said))


def _is_complaint(line: bytes) -> bool:
    """Whether a decoder's line complains of data that it could not read."""
    extraneous = _EXTRANEOUS.fullmatch(line)
    return extraneous is None or int(extraneous[1]) > HARMLESS_BYTES


@contextmanager
def _decoder_complaints() -> Iterator[list[bytes]]:
    """Lines that decoders write to standard error within the block, filled in at its end; what others write passes."""
    said: list[bytes] = []
    with _lock, ExitStack() as stack:
        try:
            held = stack.enter_context(TemporaryFile(buffering=0))
            console = os.dup(2)
        except OSError:  # without a console, or a place for what is said, nothing is heard
            yield said
            return
        stack.callback(os.close, console)
        os.dup2(held.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(console, 2)
            held.seek(0)
            heard = held.read()
            said += _WORDS.findall(heard)
            if others := _WORDS.sub(b"", heard):
                os.write(2, others)


PNG_BEGIN: Final = b"\x89PNG\r\n\x1a\n"
_PGM: Final = re.compile(rb"P[1-7]\s+(?:#[^\n]*\n\s*)*(\d{1,9})\s+(?:#[^\n]*\n\s*)*(\d{1,9})\s")
_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of a JPEG segment that holds the size."""


def claimed_size(data: bytes) -> tuple[int, int] | None:
    """Width and height, px, in the header of a PNG, JPEG, BMP, PNM or TIFF file; None if unknown."""
    try:
        for begin, read in _READERS:
            if data.startswith(begin):
                return read(data)
    except (struct.error, IndexError, ValueError):
        pass
    return None


def is_damaged_png(data: bytes) -> bool:
    """Whether a chunk of a PNG has a wrong checksum, of which its decoder would complain on the console."""
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


@dataclass
class LossCount:
    """Counts by stage and cause; ``kept`` is what went on.

    Attributes
    ----------
    lost : Counter[tuple[str, str]]
        Of (stage, cause).
    kept : Counter[str]
        Of a stage.
    """

    lost: Counter[tuple[str, str]] = field(default_factory=Counter)
    kept: Counter[str] = field(default_factory=Counter)

    def lose(self, stage: str, cause: str, count: int = 1) -> None:
        """Count what was lost."""
        if count:
            self.lost[stage, cause] += int(count)

    def keep(self, stage: str, count: int = 1) -> None:
        """Count what went on."""
        self.kept[stage] += int(count)

    def add(self, other: "LossCount") -> None:
        """Add the counts of another."""
        self.lost += other.lost
        self.kept += other.kept

    @property
    def document(self) -> dict[str, Mapping[str, int | Mapping[str, int]]]:
        """Counts by stage: how many were kept, and how many lost by cause."""
        stages = dict.fromkeys([*self.kept, *(stage for stage, _ in self.lost)])
        return {
            stage: {
                "kept": self.kept[stage],
                "lost": {cause: count for (of, cause), count in self.lost.items() if of == stage},
            }
            for stage in stages
        }

    def sentences(self) -> list[str]:
        """A line per stage."""
        lines = []
        for stage, counts in self.document.items():
            lost = counts["lost"]
            assert isinstance(lost, Mapping)
            causes = ", ".join(f"{count} {cause}" for cause, count in lost.items())
            lines.append(f"{stage}: {counts['kept']} kept" + (f"; lost: {causes}" if causes else ""))
        return lines


CAMERAS: Final = ("cam0", "cam1")
LIST: Final = "data.csv"
IMAGES: Final = "data"
SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".pgm", ".bmp", ".tif", ".tiff")
LARGEST_IMAGE_FILE: Final = 200_000_000
"""Bytes."""
MOST_PIXELS: Final = 100_000_000
"""Of an image: a file of a few kB may claim a thousand million."""
FIRST_AND_LAST: Final = ((PNG_BEGIN, b"IEND"), (b"\xff\xd8", b"\xff\xd9"))
"""Bytes at the beginning and the end of a whole PNG and JPEG: decoders fill what is missing with grey."""
LONGEST_TRAILER: Final = 65536
"""Bytes that some programs write after the end."""
STAGE: Final = "image pairs"
NANOSECOND: Final = 1e-9
"""Of the stamps, s."""

Grey = UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"]


class StampedPair(NamedTuple):
    """Time (s) and files of a left and a right image; ``stamp`` is the time on the cameras' clock, ns."""

    time: float
    left: Path
    right: Path
    stamp: int = 0


class ImagePair(NamedTuple):
    """Time (s), and grey values."""

    time: float
    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h w"]


@dataclass
class PairReader:
    """Reader of stereo pairs that counts the unusable ones.

    Grey values of more than 8 bits are scaled by the largest so far.

    Attributes
    ----------
    size : tuple[int, int]
        Width and height that images must have, px.
    losses : LossCount
        Counted here.
    """

    size: tuple[int, int]
    losses: LossCount
    _bits: int = 8
    _last: tuple[np.ndarray | None, np.ndarray | None] = (None, None)

    def read(self, stamped: StampedPair) -> ImagePair | None:
        """The pair, or None where it cannot be used.

        An image is missing, is no image, has another size, or repeats the last (a frozen camera).
        """
        images = []
        for path in (stamped.left, stamped.right):
            image, cause = _decode(path)
            if image is not None and image.shape[::-1] != self.size:
                cause = f"of another size than {self.size[0]} x {self.size[1]}"
            if image is None or cause is not None:
                self.losses.lose(STAGE, cause or "not an image")
                return None
            images.append(image)
        self._bits = max(self._bits, *map(_bits_of, images))
        left, right = (_scale_to_eight_bits(image, self._bits) for image in images)
        return self.checked(ImagePair(stamped.time, left, right))

    def checked(self, pair: ImagePair) -> ImagePair | None:
        """A pair in memory, or None where a camera sees nothing or repeats its last image."""
        repeated = [
            last is not None and np.array_equal(last, now)
            for last, now in zip(self._last, pair[1:], strict=True)
        ]
        self._last = (pair.left, pair.right)
        blank = [name for name, image in zip(CAMERAS, pair[1:], strict=True) if np.ptp(image) == 0]
        if blank:
            self.losses.lose(STAGE, f"of one grey value ({' and '.join(blank)})")
            return None
        if any(repeated):
            which = "both cameras" if all(repeated) else CAMERAS[repeated.index(True)]
            self.losses.lose(STAGE, f"repeated by a frozen camera ({which})")
            return None
        self.losses.keep(STAGE)
        return pair


def read_image(path: Path) -> tuple[UInt8[np.ndarray, "h w"] | None, str | None]:
    """Grey values of an image file, or why there are none."""
    image, cause = _decode(path)
    return (None if image is None else _scale_to_eight_bits(image, _bits_of(image))), cause


def _decode(path: Path) -> tuple[Grey | None, str | None]:
    """Grey values as the file has them, or why there are none."""
    if not os.path.exists(path):
        return None, "missing"
    if not os.path.isfile(path):  # a pipe or device, which would be waited for
        return None, "not a file"
    if os.path.getsize(path) > LARGEST_IMAGE_FILE:
        return None, "larger than an image file may be"
    try:
        content = read_bytes(path, LARGEST_IMAGE_FILE, may_be_empty=True)
    except InputError:
        return None, "not readable"
    if not content:
        return None, "empty"
    begin, end = content[:8], content[-LONGEST_TRAILER:]
    if any(begin.startswith(first) and last not in end for first, last in FIRST_AND_LAST):
        return None, "cut short"
    size = claimed_size(content)
    if size is None:  # of another format, whose decoder may take all memory
        return None, "not an image"
    if not 0 < size[0] * size[1] <= MOST_PIXELS:
        return None, "of too many pixels"
    if is_damaged_png(content):
        return None, "damaged"
    image, complained = decode_grey(content)
    if image is None:
        return None, "not an image"
    if complained:
        return None, "damaged"
    if image.dtype not in (np.uint8, np.uint16):
        return None, "not of 8 or 16 bits"
    return image, None


def _bits_of(image: Grey) -> int:
    """Bits of the largest grey value, at least 8: cameras of 10, 12 and 14 bits write files of 16."""
    return max(int(image.max()).bit_length(), 8)


def _scale_to_eight_bits(image: Grey, bits: int) -> UInt8[np.ndarray, "h w"]:
    """Grey values of so many bits as 8."""
    return image if image.dtype == np.uint8 else cv2.convertScaleAbs(image, alpha=2.0 ** (8 - bits))


def stamped_pairs(folder: Path, losses: LossCount) -> list[StampedPair]:
    """Stereo pairs of a folder in order of time.

    Images of one camera without one of the other at the same time are counted as lost.
    Times count from the first pair, in s.

    Raises
    ------
    InputError
        No images, a list that is none, time stamps out of order or fewer than two pairs.
    """
    require_folder(folder)
    left, right = (_read_stamps(folder / camera) for camera in CAMERAS)
    common = sorted(left.keys() & right.keys())
    losses.lose(STAGE, "without a partner of the same time", len(left.keys() ^ right.keys()))
    if len(common) < 2:
        raise InputError(
            f"{path_text(folder)}: {len(left)} left and {len(right)} right images have {len(common)} common time stamps; "
            "give at least 2 pairs"
        )
    return [
        StampedPair((stamp - common[0]) * NANOSECOND, left[stamp], right[stamp], stamp) for stamp in common
    ]


def read_pairs(pairs: list[StampedPair], reader: PairReader) -> Iterator[ImagePair | None]:
    """Each pair in turn, None for one that is lost."""
    for stamped in pairs:
        yield reader.read(stamped)


def _read_stamps(camera: Path) -> dict[int, Path]:
    """Image files by time stamp, ns: of data.csv, or of the files' names."""
    if not os.path.isdir(camera / IMAGES):
        raise InputError(f"{path_text(camera / IMAGES)}: no such folder; put the images of that camera there")
    if os.path.lexists(camera / LIST):
        return _read_listed(camera)
    files = sorted(path for path in (camera / IMAGES).iterdir() if path.suffix.lower() in SUFFIXES)
    unnamed = next((path for path in files if not path.stem.isdecimal() or len(path.stem) > 19), None)
    if unnamed is not None:
        raise InputError(
            f"{path_text(unnamed)}: its name is no time in ns; write {path_text(camera / LIST)} with lines 'ns,file name'"
        )
    return {int(path.stem): path for path in files}


def _read_listed(camera: Path) -> dict[int, Path]:
    path, found = camera / LIST, {}
    require_text_table(path)
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        stamp, _, name = (part.strip() for part in line.partition(","))
        place = f"{path_text(path)}: line {number}"
        if not stamp.isdecimal() or len(stamp) > 19:
            raise InputError(f"{place}: {value_text(stamp)} is no time in ns; write lines 'ns,file name'")
        if not name or Path(name).name != name:
            raise InputError(
                f"{place}: {value_text(name)} is no name of a file in {IMAGES}; write lines 'ns,file name'"
            )
        if int(stamp) in found:
            raise InputError(f"{place}: time {stamp} occurs twice; keep one line of each time")
        found[int(stamp)] = camera / IMAGES / name
    return found
