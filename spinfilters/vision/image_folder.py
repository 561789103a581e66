"""Stereo images of a folder in the EuRoC layout.

Their times, and the pairs that can be used.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8, UInt16

from spinfilters.data.input_file import (
    path_text,
    read_bytes,
    require_folder,
    require_text_table,
    value_text,
)
from spinfilters.errors import InputError
from spinfilters.vision.image_decoder import decode_grey
from spinfilters.vision.image_header import PNG_BEGIN, claimed_size, is_damaged_png
from spinfilters.vision.loss_count import LossCount

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
"""Bytes that some programs write behind the end."""
STAGE: Final = "image pairs"
NANOSECOND: Final = 1e-9
"""Of the stamps, s."""

Grey = UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"]


class StampedPair(NamedTuple):
    """Time (s) and files of a left and a right image.

    ``stamp`` is the time on the cameras' clock, ns.
    """

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
    size: width and height that images must have, px.   losses: counted here.
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
            image, cause = _decoded(path)
            if image is not None and image.shape[::-1] != self.size:
                cause = f"of another size than {self.size[0]} x {self.size[1]}"
            if image is None or cause is not None:
                self.losses.lose(STAGE, cause or "not an image")
                return None
            images.append(image)
        self._bits = max(self._bits, *map(_bits, images))
        left, right = (_of_eight_bits(image, self._bits) for image in images)
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
    image, cause = _decoded(path)
    return (None if image is None else _of_eight_bits(image, _bits(image))), cause


def _decoded(path: Path) -> tuple[Grey | None, str | None]:
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
        return None, "of more pixels than an image may have"
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


def _bits(image: Grey) -> int:
    """Bits of the largest grey value, at least 8.

    Cameras of 10, 12 and 14 bits write 16.
    """
    return max(int(image.max()).bit_length(), 8)


def _of_eight_bits(image: Grey, bits: int) -> UInt8[np.ndarray, "h w"]:
    """Grey values of so many bits as 8."""
    return image if image.dtype == np.uint8 else cv2.convertScaleAbs(image, alpha=2.0 ** (8 - bits))


def stamped_pairs(folder: Path, losses: LossCount) -> list[StampedPair]:
    """Stereo pairs of a folder in order of time.

    Images of one camera without one of the other at the same time are counted as lost.
    Times count from the first pair, in s.

    Raises
    ------
    InputError: no images, a list that is none, time stamps out of order or fewer than two pairs.
    """
    require_folder(folder)
    left, right = (_stamps(folder / camera) for camera in CAMERAS)
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


def _stamps(camera: Path) -> dict[int, Path]:
    """Image files by time stamp, ns: of data.csv, or of the files' names."""
    if not os.path.isdir(camera / IMAGES):
        raise InputError(f"{path_text(camera / IMAGES)}: no such folder; put the images of that camera there")
    if os.path.lexists(camera / LIST):
        return _listed(camera)
    files = sorted(path for path in (camera / IMAGES).iterdir() if path.suffix.lower() in SUFFIXES)
    unnamed = next((path for path in files if not path.stem.isdecimal() or len(path.stem) > 19), None)
    if unnamed is not None:
        raise InputError(
            f"{path_text(unnamed)}: its name is no time in ns; write {path_text(camera / LIST)} with lines 'ns,file name'"
        )
    return {int(path.stem): path for path in files}


def _listed(camera: Path) -> dict[int, Path]:
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
