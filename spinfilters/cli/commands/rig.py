"""The command ``rig``."""

import argparse

from spinfilters.cli.command import Command, Subparsers, number
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import NumberRange

FOCAL, BASELINE, DISTANCE = (
    NumberRange(1, 1e6, "px"),
    NumberRange(1e-4, 1e3, "m"),
    NumberRange(1e-3, 1e6, "m"),
)
SIZE, PIXEL_STD = NumberRange(2, 100_000, "px", whole=True), NumberRange(1e-3, 100, "px")


def add_rig(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters rig``."""
    rig = commands.add_parser(
        "rig",
        help="how well a stereo rig can measure, before it is built",
        description="Accuracy of triangulation half-way between the cameras' axes (Tweddle 2013, section 5.3); the defaults "
        "are the thesis' rig.",
    )
    rig.add_argument(
        "--focal", type=number(FOCAL), default=466.7, metavar="PX", help="focal length (default 466.7)"
    )
    rig.add_argument("--baseline", type=number(BASELINE), default=0.09, metavar="M", help="default 0.09")
    rig.add_argument(
        "--width", type=number(SIZE), default=640, metavar="PX", help="of the images (default 640)"
    )
    rig.add_argument(
        "--height", type=number(SIZE), default=480, metavar="PX", help="of the images (default 480)"
    )
    rig.add_argument("--distance", type=number(DISTANCE), default=0.5, metavar="M", help="default 0.5")
    rig.add_argument(
        "--pixel-std", type=number(PIXEL_STD), default=1.0, metavar="PX", help="noise (default 1)"
    )
    return rig


def print_rig(options: argparse.Namespace) -> int:
    """Print how well a rig measures at a distance."""
    from spinfilters.cli.console import wide_console
    from spinfilters.io.camera import PinholeCamera, StereoRig
    from spinfilters.vision.stereo_geometry import rig_accuracy

    focal, width, height = options.focal, options.width, options.height
    camera = PinholeCamera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
    pair = StereoRig(camera, options.baseline)
    found = rig_accuracy(pair, options.distance, options.pixel_std)
    if options.distance < found.nearest or options.distance >= found.farthest:
        raise InputError(
            f"--distance {options.distance:g} m is out of this rig's sight; "
            f"give one from {found.nearest:.4g} to {found.farthest:.4g} m"
        )
    by_column, by_row, std = (
        [f"{1e3 * value:.2f}" for value in each] for each in (found.by_column, found.by_row, found.std)
    )
    lines = [
        f"focal length {options.focal:g} px, baseline {options.baseline:g} m, images {options.width} x {options.height}",
        f"at {options.distance:g} m, half-way between the cameras:",
        f"  1 px in a column of the left image moves a point by [{', '.join(by_column)}] mm",
        f"  1 px in the rows moves it by [{', '.join(by_row)}] mm",
        f"  noise of {options.pixel_std:g} px gives standard deviations of [{', '.join(std)}] mm",
        f"nearest point in both images: {found.nearest:.4g} m; a disparity of 1 px: {found.farthest:.4g} m",
    ]
    for line in lines:
        wide_console().print(line, highlight=False, soft_wrap=True)
    return 0


RIG = Command(add_rig, print_rig)
