"""Decoding of image files without the decoders' own words on the console, which tell of damage."""

import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import Final

import cv2
import numpy as np

HARMLESS_BYTES: Final = 16
"""Superfluous bytes before a marker that some webcams write into a JPEG; more are data that could not be read."""
_EXTRANEOUS: Final = re.compile(rb"Corrupt JPEG data: (\d+) extraneous bytes before marker 0x[0-9a-f]{2}\s*")
_lock = threading.Lock()  # standard error is one for all threads


def decode_grey(content: bytes) -> tuple[np.ndarray | None, bool]:
    """Grey values of an image file in its own depth, None where it is none, and whether its decoder complained.

    Decoders fill what they cannot read with grey and say so on standard error alone.
    """
    with _said() as said:
        try:
            image = cv2.imdecode(
                np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
            )
        except cv2.error:
            image = None
    return image, _is_complaint(bytes(said))


def _is_complaint(said: bytes) -> bool:
    harmless = [int(each[1]) <= HARMLESS_BYTES for each in _EXTRANEOUS.finditer(said)]
    rest = _EXTRANEOUS.sub(b"", said)
    return not all(harmless) or bool(rest.strip())


@contextmanager
def _said() -> Iterator[bytearray]:
    """What libraries write to standard error within the block, filled in at its end."""
    said = bytearray()
    try:
        console = os.dup(2)
    except OSError:  # without a console nothing is seen, nor heard
        yield said
        return
    with _lock, TemporaryFile(buffering=0) as held:
        os.dup2(held.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(console, 2)
            os.close(console)
            held.seek(0)
            said += held.read(1 << 16)
