"""The command ``calibrate``."""

import argparse

from spinfilters.cli.command import Command, Subparsers, number
from spinfilters.io.stated_values import NumberRange

SQUARE = NumberRange(1e-4, 10, "m")
WINDOW = NumberRange(2, 50, "px", whole=True)


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


def run_calibrate(options: argparse.Namespace) -> int:
    """Calibrate a stereo pair; write and print the result."""
    from spinfilters.cli.calibrate_pair import calibrate

    return calibrate(options)


CALIBRATE = Command(add_calibrate, run_calibrate)
