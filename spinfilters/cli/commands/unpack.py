"""The command ``unpack``: images and point clouds of bags, and videos of a stereo pair, as data sets."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document, prints_text
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import printable
from spinfilters.io.stated_values import Argument, NumberRange


@dataclass(frozen=True, kw_only=True)
class UnpackArguments:
    """Arguments of ``unpack``."""

    source: Annotated[
        str,
        Argument(
            "ROS bag, or video: of the left camera, or both side by side", positional=True, metavar="SOURCE"
        ),
    ]
    right: Annotated[str | None, Argument("video of the right camera", positional=True, metavar="RIGHT")] = (
        None
    )
    output: Annotated[str, Argument("folder of the data set", short="-o", metavar="DATASET")]
    topic: Annotated[
        tuple[str, ...],
        Argument("of a bag: the left and the right camera, or the point cloud", metavar="TOPIC"),
    ] = ()
    rate: Annotated[
        float | None,
        NumberRange(0.01, 1e5, "Hz"),
        Argument("images a second of a video (default: as it says)", metavar="HZ"),
    ] = None
    rig: Annotated[
        str | None,
        Argument(
            "folder with cam0/sensor.yaml and cam1/sensor.yaml, of calibrate, to copy", metavar="FOLDER"
        ),
    ] = None


def unpack(options: UnpackArguments) -> int:
    """Write the data set."""
    from spinfilters.io.output_files import output_folder, refuse_foreign
    from spinfilters.run.bag_recording import BagTopics, chosen_topics, copy_rig, unpack_bag
    from spinfilters.vision.unpacked_images import VIDEO_SUFFIXES, unpack_videos

    source, folder = Path(options.source), Path(options.output)
    refuse_foreign(folder, COMMAND.name)
    is_video = source.suffix.lower() in VIDEO_SUFFIXES
    if is_video and options.topic:
        raise InputError("--topic is of bags; leave it out with a video")
    if not is_video and (options.right is not None or options.rate is not None):
        raise InputError("a second file and --rate are of videos; leave them out with a bag")
    with output_folder(folder, COMMAND.name) as place:
        if is_video:
            paths = [source] if options.right is None else [source, Path(options.right)]
            found = unpack_videos(paths, options.rate, place)
            said = f"{found.pairs} pairs of images"
        else:
            found = BagTopics.of(source)
            said = unpack_bag(source, chosen_topics(source, found, options.topic), place, found)
        if options.rig is not None:
            copy_rig(Path(options.rig), place)
    print_document({"dataset": str(folder), "written": said.rstrip(",")})
    if not prints_text():
        return 0
    print(f"{said} in {printable(str(folder))}")
    if (folder / "cam0").is_dir() and not list(folder.glob("cam0/*.yaml")):
        print("no calibration yet: write cam0/sensor.yaml and cam1/sensor.yaml there (spinfilters calibrate)")
    return 0


COMMAND = Command(
    "unpack",
    UnpackArguments,
    unpack,
    "Images become a folder for track and compare (cam0, cam1); point clouds one of kind lidar-scans. Of a bag with two image "
    "topics the first by name is the left camera, unless --topic says otherwise.",
    common=PrintingOptions,
)
