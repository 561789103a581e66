"""The command ``reconstruct``."""

import argparse

from spinfilters.cli.arguments import number
from spinfilters.cli.command import Command, Subparsers
from spinfilters.data.stated_values import NumberRange

VOXELS = NumberRange(16, 256, whole=True)


def add_reconstruct(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters reconstruct``."""
    reconstruct = commands.add_parser(
        "reconstruct",
        help="dense model of the body of a run made of stereo images",
        description="Depth of every stereo pair, fused into one surface in principal axes by the motion that the run estimated. "
        "Writes RUN/reconstruction/model.ply, reconstruction.json (dimensions with standard deviations), reprojection.gif, and "
        "RUN/report.html with the model to turn.",
    )
    reconstruct.add_argument(
        "run", metavar="RUN", help="folder made by compare or estimate from stereo images"
    )
    reconstruct.add_argument(
        "--images", metavar="FOLDER", help="the stereo images, where the run does not tell or they have moved"
    )
    reconstruct.add_argument(
        "--voxels",
        type=number(VOXELS),
        default=128,
        metavar="N",
        help="along each axis of the volume (default 128)",
    )
    return reconstruct


COMMANDS = (Command(29, add_reconstruct, "spinfilters.cli.reconstruct:reconstruct"),)
"""``spinfilters reconstruct``."""
