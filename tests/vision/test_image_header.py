"""Sizes that image files claim: huge ones are refused before they are decoded."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from spinfilters.vision.image_folder import claimed_size, read_image


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".pgm", ".tiff"])
@pytest.mark.parametrize("shape", [(12, 300), (240, 7)])
def test_the_size_of_every_format_is_read(suffix: str, shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    assert claimed_size(cv2.imencode(suffix, image)[1].tobytes()) == shape[::-1]


@pytest.mark.parametrize("begin", [b"\x89PNG", b"\xff\xd8", b"BM", b"P5", b"II*\0", b"MM\0*", b"", b"hello"])
def test_what_is_no_header_tells_no_size(begin: bytes) -> None:
    assert claimed_size(begin) is None
    assert claimed_size(begin + bytes(range(7, 40))) is None or begin in (b"\x89PNG", b"BM")


def test_a_file_that_would_fill_the_memory_is_not_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def chunk(name: bytes, content: bytes) -> bytes:
        return (
            struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        )

    header = struct.pack(">IIBBBBB", 32000, 32000, 8, 0, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    path = tmp_path / "0.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    assert read_image(path) == (None, "of too many pixels")
