"""Folders of stereo images made from ROS bags with two cameras and from videos."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, printable, require_file
from spinfilters.io.output_files import write_bytes, write_text
from spinfilters.io.ros_bag import BagMessage, bag_messages
from spinfilters.vision.image_folder import CAMERAS, IMAGES, LIST

COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
VIDEO_SUFFIXES: Final = (".avi", ".mp4", ".mov", ".mkv", ".webm", ".m4v")
LARGEST_VIDEO: Final = 64 * 1024**3
MOST_IMAGES: Final = 200_000
"""Of a camera."""
SAME_TIME_NS: Final = 1_000_000
"""Images of two cameras whose stamps differ by no more are a pair."""
_FIRST_BYTES: Final = {".png": b"\x89PNG", ".jpg": b"\xff\xd8"}
_GREY: Final[dict[str, tuple[str, int, int | None]]] = {
    "mono8": ("u1", 1, None),
    "8UC1": ("u1", 1, None),
    "mono16": ("u2", 1, None),
    "16UC1": ("u2", 1, None),
    "rgb8": ("u1", 3, cv2.COLOR_RGB2GRAY),
    "bgr8": ("u1", 3, cv2.COLOR_BGR2GRAY),
    "8UC3": ("u1", 3, cv2.COLOR_BGR2GRAY),
    "rgba8": ("u1", 4, cv2.COLOR_RGBA2GRAY),
    "bgra8": ("u1", 4, cv2.COLOR_BGRA2GRAY),
    "bayer_rggb8": ("u1", 1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": ("u1", 1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": ("u1", 1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": ("u1", 1, cv2.COLOR_BayerGB2GRAY),
}
"""Type and number of a pixel's numbers by ROS' name of an encoding, and the conversion to grey; OpenCV names Bayer patterns by
their second row."""


class UnpackedPairs(NamedTuple):
    """Number of pairs that were written, and of images without a partner of the same time."""

    pairs: int
    alone: int


def unpack_bag_images(path: Path, topics: Sequence[str], folder: Path) -> UnpackedPairs:
    """Write the images of two topics, left first, in the EuRoC layout.

    Raises
    ------
    InputError
        An encoding that is not read, no pairs, a damaged bag.
    """
    _make_folders(folder)
    left: list[int] = []
    right: list[int] = []
    for message in bag_messages(path, topics):
        camera = topics.index(message.topic)
        stamps = (left, right)[camera]
        if len(stamps) >= MOST_IMAGES:
            raise InputError(f"{path_text(path)}: has more than {MOST_IMAGES} images of a camera; cut it")
        name, data = _image_file(path, message)
        write_bytes(folder / CAMERAS[camera] / IMAGES / name, data)
        stamps.append(message.stamp)
    return _write_lists(path, folder, left, right)


def _image_file(path: Path, found: BagMessage) -> tuple[str, bytes]:
    """Name and bytes of the file of a message: as it is where it is compressed, else a PNG of its grey values."""
    stamp, message = found.stamp, found.content
    if found.kind == COMPRESSED:
        data = bytes(message.data)
        suffix = next((name for name, first in _FIRST_BYTES.items() if data.startswith(first)), None)
        if suffix is None:
            raise InputError(
                f"{path_text(path)}: an image at {stamp} ns is neither PNG nor JPEG; record raw images"
            )
        return f"{stamp}{suffix}", data
    if message.encoding not in _GREY:
        raise InputError(
            f"{path_text(path)}: images have the encoding {printable(message.encoding)}; read are {', '.join(_GREY)}"
        )
    kind, count, conversion = _GREY[message.encoding]
    order = ">" if message.is_bigendian else "<"
    wanted = message.height * message.step
    width = message.width * count * np.dtype(kind).itemsize
    if not 0 < width <= message.step or len(message.data) < wanted:
        raise InputError(
            f"{path_text(path)}: an image at {stamp} ns has fewer bytes than its size; record it again"
        )
    lines = np.frombuffer(bytes(message.data)[:wanted], np.uint8).reshape(message.height, message.step)
    # a line may be longer than its pixels
    pixels = np.ascontiguousarray(lines[:, :width]).view(order + kind).astype(kind)
    image = pixels.reshape(message.height, message.width, count) if count > 1 else pixels
    return f"{stamp}.png", _png(image if conversion is None else cv2.cvtColor(image, conversion))


def unpack_videos(paths: Sequence[Path], rate: float | None, folder: Path) -> UnpackedPairs:
    """Write the images of a video with both cameras side by side, or of two videos, left first.

    Parameters
    ----------
    rate : float or None
        Images a second; None for what the file says.

    Raises
    ------
    InputError
        No video that can be decoded, two that differ in length, a rate that is not known.
    """
    films = [_frames(path) for path in paths]
    _make_folders(folder)
    left: list[int] = []
    rate = rate or _rate(paths[0])
    for number, images in enumerate(zip(*films, strict=False)):
        stamp = round(number / rate * 1e9)
        if number >= MOST_IMAGES:
            raise InputError(f"{path_text(paths[0])}: has more than {MOST_IMAGES} images; cut it")
        pair = (
            images if len(images) == 2 else np.split(images[0][:, : images[0].shape[1] // 2 * 2], 2, axis=1)
        )
        for camera, image in enumerate(pair):
            write_bytes(folder / CAMERAS[camera] / IMAGES / f"{stamp}.png", _png(image))
        left.append(stamp)
    return _write_lists(paths[0], folder, left, left)


def _make_folders(folder: Path) -> None:
    for camera in CAMERAS:
        (folder / camera / IMAGES).mkdir(parents=True)


def _frames(path: Path) -> Iterator[np.ndarray]:
    """Grey images of a video."""
    film = _film(path)
    while True:
        read, image = film.read()
        if not read:
            return
        yield cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image


def _film(path: Path) -> Any:
    require_file(path, LARGEST_VIDEO)
    film = cv2.VideoCapture(str(path))
    if not film.isOpened():
        raise InputError(f"{path_text(path)}: no decoder reads it; convert it to .mp4 or .avi")
    return film


def _rate(path: Path) -> float:
    """Images a second of a video, as it says."""
    rate = float(_film(path).get(cv2.CAP_PROP_FPS))
    if not 0.01 < rate < 1e5:
        raise InputError(
            f"{path_text(path)}: does not say how many images a second it has; give rate (--rate on the command line)"
        )
    return rate


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def _write_lists(path: Path, folder: Path, lefts: Sequence[int], rights: Sequence[int]) -> UnpackedPairs:
    """Write data.csv of both cameras with the stamp of the left image of each pair."""
    left, right = (np.unique(np.array(each, np.int64)) for each in (lefts, rights))
    if not len(left) or not len(right):
        raise InputError(
            f"{path_text(path)}: has {len(left)} left and {len(right)} right images; give both cameras"
        )
    nearest = np.searchsorted(
        (right[1:] + right[:-1]) // 2, left
    )  # of the right camera, by the middles between its stamps
    paired = np.abs(right[nearest] - left) <= SAME_TIME_NS
    if np.count_nonzero(paired) < 2:
        raise InputError(
            f"{path_text(path)}: {np.count_nonzero(paired)} images of the two cameras are within a millisecond of each other; "
            "synchronise the cameras"
        )
    for camera, own in zip(CAMERAS, (left[paired], right[nearest][paired]), strict=True):
        files = {int(file.stem): file.name for file in (folder / camera / IMAGES).iterdir()}
        rows = zip(left[paired].tolist(), own.tolist(), strict=True)
        lines = "".join(f"{stamp},{files[taken]}\n" for stamp, taken in rows)
        write_text(folder / camera / LIST, f"#timestamp [ns],filename\n{lines}")
    pairs = int(np.count_nonzero(paired))
    return UnpackedPairs(pairs, len(left) + len(right) - 2 * pairs)
