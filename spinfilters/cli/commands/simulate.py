"""The command ``simulate``."""

import argparse

from spinfilters.api.argument_ranges import GYRO_BIAS, SEED
from spinfilters.cli.command import Command, Subparsers, add_motion, number
from spinfilters.io.stated_values import NumberRange


def add_simulate(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters simulate``."""
    simulate = commands.add_parser(
        "simulate", help="write a simulated data set with truth, and a picture of it"
    )
    simulate.add_argument("-o", "--output", metavar="DATASET", required=True, help="folder of the data set")
    simulate.add_argument(
        "--kind",
        default="stereo-tracks",
        help="stereo-tracks, mono-tracks, pose, attitude, gyro, lidar-points, lidar-poses, or stereo-images, which are rendered",
    )
    simulate.add_argument(
        "--beside",
        nargs=2,
        action="append",
        metavar=("KIND", "SECONDS"),
        help="another sensor on the same motion and its interval, such as gyro 0.01; may be repeated",
    )
    simulate.add_argument("--seed", type=number(SEED), default=0)
    simulate.add_argument(
        "--known-map", action="store_true", help="write landmarks.csv, the map of the tracks"
    )
    _add_sensor_options(simulate)
    _add_images(simulate)
    add_motion(simulate)
    return simulate


def _add_sensor_options(simulate: argparse.ArgumentParser) -> None:
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
        metavar="static|circle|sway|dead-band",
        help="how the camera moves, as inspector.tum says: circle, about the body; sway, it swings; dead-band, pulses of thrusters "
        "keep its place",
    )
    simulate.add_argument(
        "--inspector-error",
        nargs="+",
        action="append",
        metavar=("NAME", "SIZE"),
        help="what is wrong with inspector.tum: late S, turning RAD or drifting M over the recording, lever M, sparse S, "
        "missing; may be repeated",
    )


def _add_images(simulate: argparse.ArgumentParser) -> None:
    simulate.add_argument(
        "--shape",
        help="of the body in stereo-images: spheres (default), box, octahedron, or a mesh (.obj, binary .stl, .tab, .txt)",
    )
    simulate.add_argument(
        "--foil",
        type=number(NumberRange(0, 1)),
        help="share of the surface that is crinkled metal foil, in stereo-images (default 0)",
    )


def run_simulate(options: argparse.Namespace) -> int:
    """Write a simulated data set and a picture of its true rates."""
    from spinfilters.cli.simulate_recording import simulate

    return simulate(options)


SIMULATE = Command(add_simulate, run_simulate)
