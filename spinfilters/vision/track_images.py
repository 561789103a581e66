"""Tracks of the stereo images of a folder, as a data set that every estimator takes."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from spinfilters.data.dataset import DATASET_FILE, Dataset
from spinfilters.data.dataset_options import DatasetOptions, options_from_toml, with_told_deviations
from spinfilters.data.input_file import path_text, printable, read_toml
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.errors import InputError
from spinfilters.vision.batch_tracks import batch_tracks, require_epochs
from spinfilters.vision.epoch_observations import EpochObservations
from spinfilters.vision.front_end import FrontEndOptions, OnlineFrontEnd, StereoPoints
from spinfilters.vision.image_folder import (
    CAMERAS,
    STAGE,
    PairReader,
    read_pairs,
)
from spinfilters.vision.image_source import ImageSource, read_image_source
from spinfilters.vision.loss_count import LossCount
from spinfilters.vision.stereo_matching import TimedFeatures

SYSTEMATIC_PX: Final = 0.01
"""Errors of places and disparities that many observations have in common, as near edges of the body and from interpolation: they
do not average out, and are told as errors of the calibration, which they are like."""
Progress = Callable[[str, int, int], None]
"""Called with a stage, how much of it is done, and of how much."""


@dataclass(frozen=True)
class TrackedImages:
    """Tracks and losses of a folder of images.

    Attributes
    ----------
    dataset: stereo tracks of unknown landmarks, in rectified pixels.   losses: of every stage, by cause.
    document: the same and the identified noise, as JSON.
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
    InputError: no images, no calibration, no two pairs whose motion is found. The text names the folder or file.
    """
    options, losses = options or FrontEndOptions(), LossCount()
    found, points, count = stereo_points(folder, options, losses, progress)
    with _naming(folder, losses):
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
    dataset = _dataset(found, tracks.stream, tracks.correlation.inflation)
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

    Errors: no images, no calibration.
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
    on_epoch: called with the observations of every epoch at once.   Errors: `track_images`.
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
    with _naming(folder, losses):
        _require_pairs(losses, len(source.pairs))
        stream = online_stream(epochs)
    return TrackedImages(_dataset(source, stream), losses, {"losses": losses.document})


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
def _naming(folder: Path, losses: LossCount) -> Iterator[None]:
    """Put the folder, and what was lost most, into an InputError of the front end."""
    try:
        yield
    except InputError as error:
        of_pairs_first = sorted(losses.lost.items(), key=lambda loss: (loss[0][0] != STAGE, -loss[1]))
        worst = [f"{count} {cause}" for (_, cause), count in of_pairs_first[:2]]
        lost = f" (lost: {', '.join(worst)})" if worst else ""
        raise InputError(f"{path_text(folder)}: {error}{lost}") from None


def _dataset(source: ImageSource, stream: MeasurementStream, inflation: float = 1.0) -> Dataset:
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
            replace(with_told_deviations(options, folder), covariance_inflation=inflation), stream
        ),
    )


def _with_systematic_errors(options: DatasetOptions, stream: MeasurementStream) -> DatasetOptions:
    """The options with deviations of the calibration, where they are told, that hold for these tracks."""
    u, v, right = stream.values.T
    size = float(np.hypot(np.std(u), np.std(v)))
    own = {
        "center_std": SYSTEMATIC_PX,
        "focal_std": SYSTEMATIC_PX / max(size, 1.0),
        "baseline_std": SYSTEMATIC_PX / max(float(np.median(u - right)), 1.0),
    }
    told = {name: float(np.hypot(std, own.get(name, 0.0))) for name, std in options.calibration.items()}
    return replace(options, calibration=told)
