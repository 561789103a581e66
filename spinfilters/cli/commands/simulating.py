"""The command ``simulate``."""

import argparse

from spinfilters.api.argument_ranges import GYRO_BIAS, SEED
from spinfilters.cli.arguments import add_motion, number
from spinfilters.cli.command import Command, Subparsers


def add_simulate(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters simulate``."""
    simulate = commands.add_parser(
        "simulate", help="write a simulated data set with truth, and a picture of it"
    )
    simulate.add_argument("-o", "--output", metavar="DATASET", required=True, help="folder of the data set")
    simulate.add_argument(
        "--kind", default="stereo-tracks", help="stereo-tracks, mono-tracks, pose, attitude or gyro"
    )
    simulate.add_argument("--seed", type=number(SEED), default=0)
    simulate.add_argument(
        "--known-map", action="store_true", help="write landmarks.csv, the map of the tracks"
    )
    simulate.add_argument(
        "--gyro-bias",
        type=number(GYRO_BIAS),
        nargs=3,
        metavar=("BX", "BY", "BZ"),
        help="constant error of the gyro's rates, axes g, rad/s (with --kind gyro)",
    )
    simulate.add_argument(
        "--inspector",
        default="static",
        metavar="static|circle",
        help="circle: the camera flies about the body, and inspector.tum says how",
    )
    add_motion(simulate)
    return simulate


COMMANDS = (Command(30, add_simulate, "spinfilters.cli.simulate:simulate"),)
