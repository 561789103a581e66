"""The command ``track``: stereo images to tracks of landmarks."""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text
from spinfilters.io.stated_values import Argument

if TYPE_CHECKING:
    from spinfilters.run.estimation import Progress
    from spinfilters.vision.track_images import TrackedImages


@dataclass(frozen=True, kw_only=True)
class TrackArguments:
    """Arguments of ``track``."""

    dataset: Annotated[str, Argument("folder of the images", positional=True, metavar="DATASET")]
    output: Annotated[str, Argument("folder of the data set of tracks", short="-o", metavar="TRACKS")]
    detector: Annotated[str, Argument("sift, or orb, which is faster and less exact")] = "sift"
    online: Annotated[bool, Argument("use past images only, as on a spacecraft")] = False
    figures: Annotated[
        bool, Argument("draw stereo matches and where features were one pair before: matches.png")
    ] = False


def track(options: TrackArguments) -> int:
    """Write the tracks of a folder of stereo images, and counts of losses."""
    from spinfilters.cli.console import progress_bars

    with progress_bars() as report:
        report("reading", 0, 1)
        done = _track(options, report)
    _print(*done)
    print_document({**done.tracked.document, "seconds": done.seconds})
    return 0


class _Tracking(NamedTuple):
    """What was tracked, where it was written, and how long it took, s."""

    tracked: "TrackedImages"
    folder: Path
    seconds: float


def _track(options: TrackArguments, report: "Progress") -> _Tracking:
    from spinfilters.io.dataset_folder import write_dataset
    from spinfilters.io.dataset_reader import has_images
    from spinfilters.io.output_files import output_folder, refuse_foreign, write_json
    from spinfilters.vision.front_end import FrontEndOptions
    from spinfilters.vision.stereo_matching import detector
    from spinfilters.vision.track_images import track_images, track_images_online

    source, folder = Path(options.dataset), Path(options.output)
    if not has_images(source):
        raise InputError(
            f"{path_text(source)}: has no stereo images; give a folder with cam0/data and cam1/data, and no tracks.csv"
        )
    refuse_foreign(folder, COMMAND.name)
    detector(options.detector)
    follow, began = track_images_online if options.online else track_images, time.perf_counter()
    tracked = follow(source, FrontEndOptions(options.detector), report)
    seconds = time.perf_counter() - began
    with output_folder(folder, COMMAND.name) as place:
        write_dataset(replace(tracked.dataset, path=None), place)
        write_json(place / "front_end.json", {**tracked.document, "seconds": seconds})
        if options.figures:
            _draw(source, tracked, place / "matches.png")
    return _Tracking(tracked, folder, seconds)


def _draw(source: Path, tracked: "TrackedImages", path: Path) -> None:
    from spinfilters.plots.measurement_figures import matches_figure
    from spinfilters.plots.style import save_figure
    from spinfilters.vision.tracked_pairs import tracked_pairs

    (stream,) = tracked.dataset.log.streams
    save_figure(matches_figure(tracked_pairs(source, stream)), path)


def _print(tracked: "TrackedImages", folder: Path, seconds: float) -> None:
    import numpy as np

    from spinfilters.cli.console import wide_console

    console = wide_console()
    for line in tracked.losses.sentences():
        console.print(line, highlight=False, soft_wrap=True)
    (stream,) = tracked.dataset.log.streams
    assert stream.ids is not None  # a stream of landmarks always has them
    epochs, landmarks = len(np.unique(stream.time)), len(np.unique(stream.ids))
    console.print(
        f"{len(stream)} observations of {landmarks} landmarks in {epochs} epochs in {folder}, {seconds:.1f} s",
        highlight=False,
        soft_wrap=True,
    )


COMMAND = Command(
    "track",
    TrackArguments,
    track,
    "Reads stereo images in the EuRoC layout (cam0/data, cam0/data.csv, cam0/sensor.yaml; cam1), finds landmarks and follows them "
    "through all revolutions. The result is a data set of stereo tracks with a covariance per row, for compare. The file "
    "front_end.json lists losses by stage and cause. Images can also be given to compare directly.",
    common=PrintingOptions,
)
