"""A folder of stereo images to a data set of tracks, with truth and inspector where the folder has them."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import (
    DATASET_FILE,
    INSPECTOR_FILE,
    Dataset,
    DatasetOptions,
    options_from_toml,
    with_stated_deviations,
)
from spinfilters.io.dataset_folder import read_inspector
from spinfilters.io.input_file import path_text, printable, read_toml
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.truth import TRUTH_FILES, TRUTH_TABLE, Truth, read_truth
from spinfilters.vision.batch_tracks import batch_tracks, require_epochs
from spinfilters.vision.front_end import FrontEndOptions, OnlineFrontEnd, StereoPoints
from spinfilters.vision.image_folder import (
    CAMERAS,
    NANOSECOND,
    STAGE,
    LossCount,
    PairReader,
    StampedPair,
    read_pairs,
    stamped_pairs,
)
from spinfilters.vision.rectification import Rectification, read_raw_rig
from spinfilters.vision.stereo_matching import EpochObservations, TimedFeatures

SAME_TIME_S: Final = 1e-6
"""Times that differ by less are one: seconds since 1970 are stored to a quarter of it."""
SHORTEST_INTERVAL_S: Final = 1e-5
"""Between pairs, on the mean: less is another unit, or numbers of images."""
SPARSEST: Final = 10.0
"""Durations of all images, beyond which poses of an inspector are apart by no motion that images could see."""


class ImageSource(NamedTuple):
    """A folder of images with its rectified cameras and stamped pairs.

    ``inspector`` holds the poses of the rectified left camera in i; None of one at rest. Times count from the first pair, s.
    """

    folder: Path
    rectification: Rectification
    pairs: list[StampedPair]
    inspector: MeasurementStream | None
    truth: Truth | None


def read_image_source(folder: Path, losses: LossCount) -> ImageSource:
    """Calibration, pairs, inspector and truth of a folder; no image is read.

    ``inspector.tum`` holds poses of the raw left camera, ``truth.csv`` the truth, both on the clock of the images' stamps, s.

    Raises
    ------
    InputError
        No calibration, no pairs, cameras that are not side by side, stamps in another unit, poses that do not
        cover the pairs, a truth of another time. The text names the file.
    """
    rectification = Rectification(read_raw_rig(folder))
    try:
        _ = rectification.stereo
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None
    pairs = stamped_pairs(folder, losses)
    mean = pairs[-1].time / (len(pairs) - 1)
    if mean < SHORTEST_INTERVAL_S:
        raise InputError(
            f"{path_text(folder)}: {len(pairs)} pairs are {mean:.2g} s apart by their stamps; write the times in ns into data.csv"
        )
    inspector = rectified_camera_poses(folder, pairs, rectification)
    truth = _read_truth(folder, pairs)
    if truth is not None and inspector is None:
        truth = rectification.truth(truth)
    return ImageSource(folder, rectification, pairs, inspector, truth)


def rectified_camera_poses(
    folder: Path, pairs: list[StampedPair], rectification: Rectification
) -> MeasurementStream | None:
    """Poses of the rectified left camera in i; None of an inspector at rest.

    Times count from the first pair, s. InputError: what `read_inspector` refuses, poses that are too few or do not cover the pairs.
    """
    raw, path = read_inspector(folder), folder / INSPECTOR_FILE
    if raw is None:
        return None
    poses = replace(raw, time=_times_from_first(pairs, raw.time), values=rectification.left_poses(raw.values))
    try:
        CameraTrajectory(poses.time, poses.values).require_cover(np.array([0.0, pairs[-1].time]))
    except InputError as error:
        raise InputError(f"{path_text(path)}: from the first pair on, {error}") from None
    apart = float(np.diff(poses.time).max(initial=0.0))
    if apart > SPARSEST * pairs[-1].time:
        raise InputError(
            f"{path_text(path)}: poses are {apart:.2g} s apart, and all images {pairs[-1].time:.2g} s; give their times in s"
        )
    return poses


def _read_truth(folder: Path, pairs: list[StampedPair]) -> Truth | None:
    """The truth by times from the first pair.

    InputError: as `read_truth`, or of another time than the images.
    """
    if not any(os.path.lexists(folder / name) for name in TRUTH_FILES):
        return None
    truth = read_truth(folder)
    time = _times_from_first(pairs, truth.time)
    if time[-1] < 0 or time[0] > pairs[-1].time:
        raise InputError(
            f"{path_text(folder / TRUTH_TABLE)}: is from {truth.time[0]:.9g} s to {truth.time[-1]:.9g} s, the images by their "
            f"stamps from {pairs[0].stamp * NANOSECOND:.9g} s to {pairs[-1].stamp * NANOSECOND:.9g} s; give both on one clock"
        )
    return replace(truth, time=time)


def _times_from_first(pairs: list[StampedPair], time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Times on the images' clock from the first pair; those of a pair to the bit."""
    since = time - pairs[0].stamp * NANOSECOND
    stamps = np.array([pair.time for pair in pairs])
    after = np.clip(np.searchsorted(stamps, since), 1, len(stamps) - 1)
    nearest = np.where(since - stamps[after - 1] < stamps[after] - since, stamps[after - 1], stamps[after])
    return np.where(np.abs(nearest - since) < SAME_TIME_S, nearest, since)


SYSTEMATIC_PX: Final = 0.01
"""Errors of places and disparities that many observations have in common, as near edges of the body and from interpolation: they
do not average out, and are stated as errors of the calibration, which they resemble."""
Progress = Callable[[str, int, int], None]
"""Called with a stage, how much of it is done, and of how much."""


@dataclass(frozen=True)
class TrackedImages:
    """Tracks and losses of a folder of images.

    Attributes
    ----------
    dataset : Dataset
        Stereo tracks of unknown landmarks, in rectified pixels.
    losses : LossCount
        Of every stage, by cause.
    document : dict[str, Any]
        The same and the identified noise, as JSON.
    """

    dataset: Dataset
    losses: LossCount
    document: dict[str, Any]


def track_images(
    folder: Path, options: FrontEndOptions | None = None, progress: Progress = lambda *_: None
) -> TrackedImages:
    """Tracks of a whole folder of images.

    Every epoch is associated with what was seen before and after it.

    Raises
    ------
    InputError
        No images, no calibration, no two pairs whose motion is found. The text names the folder or file.
    """
    options, losses = options or FrontEndOptions(), LossCount()
    found, points, count = stereo_points(folder, options, losses, progress)
    with _naming_folder(folder, losses):
        _require_pairs(losses, count)
        tracks = batch_tracks(
            points, found.rectification.stereo, options, losses, lambda *at: progress("tracks", *at)
        )
    document = {
        "losses": losses.document,
        "noise": {"place_px2": tracks.noise.place, "disparity_px2": tracks.noise.disparity},
        "error_correlation": {
            "place": tracks.correlation.place,
            "disparity": tracks.correlation.disparity,
            "inflation": tracks.correlation.inflation,
        },
    }
    dataset = _make_dataset(found, tracks.stream, tracks.correlation.inflation)
    return TrackedImages(dataset, losses, document)


class FolderPoints(NamedTuple):
    """Stereo points of a folder's usable pairs, their times (s) and number."""

    source: ImageSource
    points: list[TimedFeatures]
    pairs: int


def stereo_points(
    folder: Path, options: FrontEndOptions, losses: LossCount, progress: Progress = lambda *_: None
) -> FolderPoints:
    """Stereo points of every pair of a folder, before association.

    Raises
    ------
    InputError
        The folder has no images or no calibration.
    """
    source = read_image_source(folder, losses)
    reader = PairReader(source.rectification.rig.size, losses)
    finder, points = StereoPoints(source.rectification, options, losses), []
    for number, pair in enumerate(read_pairs(source.pairs, reader), start=1):
        if pair is not None:
            points.append(TimedFeatures(pair.time, finder.of(pair)))
        progress("features", number, len(source.pairs))
    return FolderPoints(source, points, len(source.pairs))


def track_images_online(
    folder: Path,
    options: FrontEndOptions | None = None,
    progress: Progress = lambda *_: None,
    on_epoch: Callable[[EpochObservations], None] = lambda _: None,
) -> TrackedImages:
    """Tracks of a folder of images, epoch by epoch (online).

    Each epoch is associated only with what was seen before it.

    Parameters
    ----------
    on_epoch : Callable[[EpochObservations], None]
        Called with the observations of every epoch at once.
    Errors
        `track_images`.
    """
    losses = LossCount()
    source = read_image_source(folder, losses)
    front_end = OnlineFrontEnd(source.rectification, options, losses)
    reader, epochs = PairReader(source.rectification.rig.size, losses), []
    for number, pair in enumerate(read_pairs(source.pairs, reader), start=1):
        epoch = None if pair is None else front_end.add(pair)
        if epoch is not None:
            on_epoch(epoch)
            epochs.append(epoch)
        progress("images", number, len(source.pairs))
    with _naming_folder(folder, losses):
        _require_pairs(losses, len(source.pairs))
        stream = online_stream(epochs)
    return TrackedImages(_make_dataset(source, stream), losses, {"losses": losses.document})


def online_stream(epochs: list[EpochObservations]) -> MeasurementStream:
    """Stream of the observations of some epochs. InputError: fewer than two of them."""
    require_epochs(len(epochs))
    counts = [len(epoch.ids) for epoch in epochs]
    return MeasurementStream(
        "stereo",
        np.repeat([epoch.time for epoch in epochs], counts),
        np.concatenate([epoch.points.values for epoch in epochs]),
        np.concatenate([epoch.ids for epoch in epochs]),
        np.concatenate([epoch.covariance for epoch in epochs]),
    )


def _require_pairs(losses: LossCount, count: int) -> None:
    """InputError: none of so many pairs can be used."""
    if not losses.kept[STAGE]:
        raise InputError(
            f"none of {count} pairs can be used; give whole images of the size that {CAMERAS[0]}/sensor.yaml states"
        )


@contextmanager
def _naming_folder(folder: Path, losses: LossCount) -> Iterator[None]:
    """Put the folder, and what was lost most, into an InputError of the front end."""
    try:
        yield
    except InputError as error:
        of_pairs_first = sorted(losses.lost.items(), key=lambda loss: (loss[0][0] != STAGE, -loss[1]))
        worst = [f"{count} {cause}" for (_, cause), count in of_pairs_first[:2]]
        lost = f" (lost: {', '.join(worst)})" if worst else ""
        raise InputError(f"{path_text(folder)}: {error}{lost}") from None


def _make_dataset(source: ImageSource, stream: MeasurementStream, inflation: float = 1.0) -> Dataset:
    folder = source.folder
    path, description, options = folder / DATASET_FILE, "", DatasetOptions()
    if os.path.lexists(path):
        document = read_toml(path)
        description = printable(str(document.get("description", "")))
        options = options_from_toml(path, {key: document[key] for key in ("calibration",) if key in document})
    return Dataset(
        kind="stereo-tracks",
        log=MeasurementLog((stream,)),
        path=folder,
        description=f"tracks of {description or printable(folder.name)}",
        truth=source.truth,
        rig=source.rectification.stereo,
        inspector=source.inspector,
        options=_with_systematic_errors(
            replace(with_stated_deviations(options, folder), covariance_inflation=inflation), stream
        ),
    )


def _with_systematic_errors(options: DatasetOptions, stream: MeasurementStream) -> DatasetOptions:
    """The options with deviations of the calibration, where they are stated, that hold for these tracks."""
    u, v, right = stream.values.T
    size = float(np.hypot(np.std(u), np.std(v)))
    own = {
        "center_std": SYSTEMATIC_PX,
        "focal_std": SYSTEMATIC_PX / max(size, 1.0),
        "baseline_std": SYSTEMATIC_PX / max(float(np.median(u - right)), 1.0),
    }
    stated = {name: float(np.hypot(std, own.get(name, 0.0))) for name, std in options.calibration.items()}
    return replace(options, calibration=stated)
