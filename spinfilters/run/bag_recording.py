"""ROS bags of stereo images or of point clouds: their topics, and the folder into which they are unpacked."""

import hashlib
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.core.user_cache import cache_folder
from spinfilters.io.input_file import path_text, printable
from spinfilters.io.output_files import make_folder, output_folder, write_text, write_toml
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.run.readers import RosBagReader

CLOUD_TYPE: Final = "sensor_msgs/msg/PointCloud2"
IMAGE_TYPES: Final = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA_INFO_TYPE: Final = "sensor_msgs/msg/CameraInfo"
SIDES: Final = (
    ("left", "right"),
    ("cam0", "cam1"),
    ("cam_0", "cam_1"),
    ("camera0", "camera1"),
    ("camera_0", "camera_1"),
    ("infra1", "infra2"),
)
"""What the topics of a left and of a right camera are called where they agree in all else."""
PREFERRED: Final = ("image_raw", "image", "image_raw/compressed", "image/compressed", "image_rect")
"""Endings of image topics, the one that is taken first in front."""
MOST_LISTED: Final = 8
COMMAND: Final = "unpack"
"""Command whose folders these are."""


@dataclass(frozen=True)
class BagTopics:
    """Topics of a bag by what they hold, each by name."""

    motion: tuple[str, ...]
    images: tuple[str, ...]
    clouds: tuple[str, ...]
    camera_infos: tuple[str, ...]

    @classmethod
    def of(cls, path: Path) -> "BagTopics":
        """Topics of a bag. InputError: a damaged bag, or no package to read it with."""
        from spinfilters.io.ros_bag import MOTION_TYPES, topics_by_type  # of bags alone

        found = topics_by_type(path)

        def named(kinds: Sequence[str]) -> tuple[str, ...]:
            return tuple(sorted(topic for topic, kind in found.items() if kind in kinds))

        return cls(named(MOTION_TYPES), named(IMAGE_TYPES), named((CLOUD_TYPE,)), named((CAMERA_INFO_TYPE,)))

    @property
    def listed(self) -> str:
        """All that can be read, for a complaint."""
        every = (*self.images, *self.clouds, *self.motion)
        return ", ".join(printable(each) for each in every[:MOST_LISTED]) or "no images and no clouds"

    def camera_info(self, image_topic: str) -> str | None:
        """Topic of the calibration of a camera: beside its images, as ROS names it."""
        beside = [
            topic
            for topic in self.camera_infos
            if image_topic.startswith(topic.removesuffix("camera_info")) and topic.endswith("/camera_info")
        ]
        return max(beside, key=len, default=None)

    def has_calibration(self, pair: Sequence[str]) -> bool:
        """Whether each camera of a pair has a calibration of its own."""
        found = {self.camera_info(topic) for topic in pair}
        return None not in found and len(found) == len(pair)


def stereo_pair(images: Sequence[str]) -> tuple[str, str] | None:
    """The left and the right of several topics of images; None where that is not clear."""
    pairs = [
        (topic, other)
        for topic in images
        for left, right in SIDES
        if left in topic and (other := topic.replace(left, right)) in images
    ]
    if pairs:
        ranks = [_rank(left) for left, _ in pairs]
        best = [pair for pair, rank in zip(pairs, ranks, strict=True) if rank == min(ranks)]
        return best[0] if len(best) == 1 else None
    return (images[0], images[1]) if len(images) == 2 else None


def _rank(topic: str) -> int:
    """Place of a topic's ending among those that are preferred."""
    return next((k for k, ending in enumerate(PREFERRED) if topic.endswith(f"/{ending}")), len(PREFERRED))


def chosen_topics(path: Path, found: BagTopics, stated: Sequence[str]) -> tuple[str, ...]:
    """Left and right images, or one topic of clouds: those that are stated, else what is clear.

    Raises
    ------
    InputError
        It is not clear, or what is stated is not there; the text lists the topics.
    """
    chosen = tuple(stated) or stereo_pair(found.images) or found.clouds
    if (len(chosen) == 2 and set(chosen) <= set(found.images)) or (
        len(chosen) == 1 and chosen[0] in found.clouds
    ):
        return chosen
    raise InputError(
        f"{path_text(path)}: has {found.listed}; give --topic with two of images, left first, or one of clouds"
    )


def unpacked_recording(
    path: str | os.PathLike[str], options: ReadingOptions
) -> tuple[str | os.PathLike[str], ReadingOptions]:
    """The folder of a bag's images or clouds, in the user's cache; every other path as it is.

    A bag with messages of rates or poses is read as it is, unless ``--topic`` names images or clouds.

    Parameters
    ----------
    path : str or os.PathLike
        Of a recording.
    options : ReadingOptions
        What its user states of it: here the topics, with a comma between two, and the folder of a calibration.

    Raises
    ------
    InputError
        Topics that are not clear, images without a calibration, no folder to unpack into.
    """
    place = Path(path)
    if not RosBagReader().recognises(place) or not os.path.exists(place):
        return path, options
    found = BagTopics.of(place)
    stated = tuple(name.strip() for name in (options.topic or "").split(",") if name.strip())
    named = set(stated) & {*found.images, *found.clouds}
    if not named and (found.motion or not (found.images or found.clouds)):
        return path, options
    options.require_only(("topic", "rig"), "a bag of images or clouds")
    pair = stereo_pair(found.images)
    if pair and len(found.clouds) == 1 and not (stated or options.rig or found.has_calibration(pair)):
        topics = found.clouds  # images without a calibration are of no use
    else:
        topics = chosen_topics(place, found, stated)
    if len(topics) == 2 and options.rig is None and not found.has_calibration(topics):
        raise InputError(
            f"{path_text(place)}: {printable(topics[0])} and {printable(topics[1])} have no camera_info; give --rig FOLDER with "
            "their calibration (cam0, cam1)"
        )
    folder = _cache_of(place, topics, options.rig)
    if not folder.is_dir():
        make_folder(folder.parent)
        with output_folder(folder, COMMAND) as made:
            unpack_bag(place, topics, made, found)
            if options.rig is not None:
                copy_rig(Path(options.rig), made)
    return folder, replace(options, topic=None, rig=None)


def _cache_of(path: Path, topics: Sequence[str], rig: str | None) -> Path:
    """Folder of a bag as it is now, by its place, size and time."""
    cache = cache_folder()
    if cache is None:
        raise InputError(
            f"{path_text(path)}: there is no folder to unpack it into; set SPINFILTERS_CACHE, or use spinfilters unpack"
        )
    stats = [(each.name, each.stat().st_size, each.stat().st_mtime_ns) for each in _files_of(path)]
    calibration = None if rig is None else [each.read_bytes() for each in _rig_files(Path(rig))]
    told = repr((os.path.realpath(path), stats, tuple(topics), calibration))
    name = re.sub(r"[^A-Za-z0-9_-]", "-", path.stem)[:40]
    return cache / "bags" / f"{name}-{hashlib.sha256(told.encode()).hexdigest()[:16]}"


def _files_of(path: Path) -> list[Path]:
    return sorted(path.iterdir()) if path.is_dir() else [path]


def unpack_bag(path: Path, topics: Sequence[str], place: Path, found: BagTopics) -> str:
    """Write the images or clouds of chosen topics into a folder; a sentence on them.

    The calibration that the bag has of both cameras goes with the images.
    """
    if len(topics) == 1:
        from spinfilters.lidar.unpacked_clouds import unpack_bag_clouds

        count = unpack_bag_clouds(path, topics[0], place)
        description = f"clouds of {printable(path.name)}"
        write_toml(place / "dataset.toml", {"kind": "lidar-scans", "description": description})
        return f"{count} scans"
    from spinfilters.vision.unpacked_images import unpack_bag_images

    pairs = unpack_bag_images(path, topics, place)
    if found.has_calibration(topics):
        for camera, topic in zip(("cam0", "cam1"), topics, strict=True):
            _write_camera_info(path, found, topic, place / camera)
    alone = f" ({pairs.alone} without a partner)" if pairs.alone else ""
    return f"{pairs.pairs} pairs of images, left {printable(topics[0])}, right {printable(topics[1])}{alone},"


def _write_camera_info(path: Path, found: BagTopics, image_topic: str, place: Path) -> None:
    """Write the first calibration message of a camera as ROS' ``camera_info.yaml``."""
    import yaml

    from spinfilters.io.ros_bag import bag_messages
    from spinfilters.vision.rectification import CAMERA_INFO_FILE

    topic = str(found.camera_info(image_topic))
    message = next(bag_messages(path, (topic,)), None)
    if message is None:
        raise InputError(f"{path_text(path)}: topic {printable(topic)} has no messages; give --rig FOLDER")
    told = {name.lower(): value for name, value in vars(message.content).items()}  # ROS 1 writes K, ROS 2 k
    write_text(place / CAMERA_INFO_FILE, yaml.safe_dump(_camera_info(told, "rect" in image_topic)))


def _camera_info(told: Mapping[str, Any], is_rectified: bool) -> dict[str, Any]:
    """Content of a ``camera_info.yaml``; a rectified image has the camera matrix of its projection, and no distortion."""
    K, D, R, P = (np.asarray(told[name], dtype=float) for name in "kdrp")
    if is_rectified:
        K, D, R = P.reshape(3, 4)[:, :3].reshape(-1), np.zeros(5), np.eye(3).reshape(-1)
    return {
        "image_width": int(told["width"]),
        "image_height": int(told["height"]),
        "distortion_model": str(told["distortion_model"]) or "plumb_bob",
        "camera_matrix": K.tolist(),
        "distortion_coefficients": D.tolist(),
        "rectification_matrix": R.tolist(),
        "projection_matrix": P.tolist(),
    }


def _rig_files(rig: Path) -> list[Path]:
    """Calibration files of both cameras. InputError: one that is missing."""
    files = [rig / camera / "sensor.yaml" for camera in ("cam0", "cam1")]
    for file in files:
        if not file.is_file():
            raise InputError(
                f"{path_text(file)}: no such file; give the folder that spinfilters calibrate wrote"
            )
    return files


def copy_rig(rig: Path, place: Path) -> None:
    """Copy a calibration into a folder of images. InputError: it is missing."""
    for file in _rig_files(rig):
        camera = place / file.parent.name
        camera.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, camera / file.name)
