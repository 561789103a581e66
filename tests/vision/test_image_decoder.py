"""What a decoder complains of is heard, and what others write meanwhile passes."""

import os
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from spinfilters.vision.image_folder import decode_grey

PICTURE = np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)
JPEG = cv2.imencode(".jpg", PICTURE)[1].tobytes()
CUT = JPEG[: len(JPEG) // 2] + b"\xff\xd9"
BAR = b"\r\x1b[2K    features \xe2\x94\x81\xe2\x94\x81 3/8 0:00:01"


@pytest.fixture
def talkative(monkeypatch: pytest.MonkeyPatch) -> None:
    """Something else of this process writes to standard error while an image is decoded."""
    decode = cv2.imdecode

    def decode_and_write(*arguments):
        os.write(2, BAR)
        return decode(*arguments)

    monkeypatch.setattr(cv2, "imdecode", decode_and_write)


def test_a_decoder_that_complains_is_heard_and_not_seen(capfd: pytest.CaptureFixture[str]) -> None:
    assert decode_grey(JPEG)[1] is False
    assert decode_grey(CUT)[1] is True
    assert capfd.readouterr().err == ""


@pytest.mark.usefixtures("talkative")
def test_a_progress_bar_drawn_meanwhile_is_no_complaint(capfd: pytest.CaptureFixture[str]) -> None:
    assert decode_grey(JPEG)[1] is False
    assert capfd.readouterr().err.encode() == BAR


@pytest.mark.usefixtures("talkative")
def test_a_complaint_is_heard_behind_a_progress_bar(capfd: pytest.CaptureFixture[str]) -> None:
    assert decode_grey(CUT)[1] is True
    assert capfd.readouterr().err.encode() == BAR


def test_a_few_superfluous_bytes_are_no_damage() -> None:
    assert decode_grey(JPEG[:-2] + bytes(8) + JPEG[-2:])[1] is False
    assert decode_grey(JPEG[:-2] + bytes(100) + JPEG[-2:])[1] is True


def test_standard_error_is_the_same_after_threads_have_decoded() -> None:
    before = os.fstat(2)
    with ThreadPoolExecutor(4) as pool:
        images = list(pool.map(decode_grey, [JPEG] * 40))
    assert all(image is not None and not complained for image, complained in images)
    assert os.path.samestat(before, os.fstat(2))
