"""The commands ``calibrate`` and ``rig``."""

import argparse

from spinfilters.cli.arguments import number
from spinfilters.cli.command import Command, Subparsers
from spinfilters.data.stated_values import NumberRange

SQUARE = NumberRange(1e-4, 10, "m")
WINDOW = NumberRange(2, 50, "px", whole=True)
FOCAL, BASELINE, DISTANCE = (
    NumberRange(1, 1e6, "px"),
    NumberRange(1e-4, 1e3, "m"),
    NumberRange(1e-3, 1e6, "m"),
)
SIZE, PIXEL_STD = NumberRange(2, 100_000, "px", whole=True), NumberRange(1e-3, 100, "px")


def add_calibrate(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters calibrate``."""
    calibrate = commands.add_parser(
        "calibrate",
        help="stereo calibration from images of a board",
        description="Images are named left* and right*, or lie in the EuRoC layout. Writes cam0/sensor.yaml and cam1/sensor.yaml, "
        "which track reads, opencv.yml, and calibration.json with the uncertainty of every parameter, the error of every image and "
        "the views that were left out, and why.",
    )
    calibrate.add_argument("folder", metavar="FOLDER", help="folder of the images")
    _add_board(calibrate)
    calibrate.add_argument("-o", "--output", metavar="OUT", required=True, help="folder of the calibration")
    calibrate.add_argument(
        "--check",
        action="store_true",
        help="the checkout before use: parameters in range, rows that correspond, measured square, a disparity map in check.png",
    )
    return calibrate


def _add_board(calibrate: argparse.ArgumentParser) -> None:
    calibrate.add_argument(
        "--corners", required=True, metavar="9x6", help="inner corners of the board, columns x rows"
    )
    calibrate.add_argument(
        "--square", required=True, type=number(SQUARE), metavar="METRES", help="side of a square"
    )
    calibrate.add_argument(
        "--charuco", action="store_true", help="the board has markers (DICT_5X5_250, 3/4 of a square)"
    )
    calibrate.add_argument(
        "--window",
        type=number(WINDOW),
        default=11,
        metavar="PX",
        help="half width in which a corner is refined (default 11); smaller where corners are close together",
    )


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


COMMANDS = (
    Command(26, add_calibrate, "spinfilters.cli.calibrate:calibrate"),
    Command(27, add_rig, "spinfilters.cli.rig:rig"),
)
"""``spinfilters calibrate`` and ``rig``."""
