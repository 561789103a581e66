"""Decoding of image files without the decoders' own words on the console, which tell of damage."""

import os
import re
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from tempfile import TemporaryFile
from typing import Final

import cv2
import numpy as np

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
    with _said() as said:
        try:
            image = cv2.imdecode(
                np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
            )
        except cv2.error:
            image = None
    return image, any(map(_is_complaint, said))


def _is_complaint(line: bytes) -> bool:
    """Whether a decoder's line tells of data that it could not read."""
    extraneous = _EXTRANEOUS.fullmatch(line)
    return extraneous is None or int(extraneous[1]) > HARMLESS_BYTES


@contextmanager
def _said() -> Iterator[list[bytes]]:
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
