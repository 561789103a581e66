"""Arguments of the commands that analyse before a flight; nothing heavy is imported here, so that help is quick."""

import argparse
from collections.abc import Callable
from typing import Any

from spinfilters.api.argument_ranges import (
    DEFAULT_MOMENTS,
    DEFAULT_RATE_RPM,
    FRAMES,
    INTERVAL,
    LANDMARKS,
    MOMENT,
    RATE_RPM,
)
from spinfilters.logs.number_range import NumberRange

Commands = Any
"""What `argparse.ArgumentParser.add_subparsers` returns; its class is private."""


def add_observe(commands: Commands) -> argparse.ArgumentParser:
    """Parser of ``spinfilters observe``."""
    observe = commands.add_parser(
        "observe", help="what a sensor can determine of a motion, proved, and how well"
    )
    observe.add_argument(
        "-o",
        "--output",
        metavar="FOLDER",
        default="runs/observe",
        help="text, JSON and pictures (default runs/observe)",
    )
    _add_question(observe)
    _add_known_inputs(observe)
    observe.add_argument(
        "--study", action="store_true", help="maps of the bound against motion, duration, frames, landmarks"
    )
    add_motion(observe)
    return observe


def _add_question(observe: argparse.ArgumentParser) -> None:
    observe.add_argument(
        "--sensor",
        nargs="+",
        default=["stereo"],
        metavar="NAME",
        help="one or several together: stereo, monocular, lidar (range, azimuth and elevation of points of the body), pose (of a "
        "lidar's scan match or a tracker), attitude, gyro (default stereo)",
    )
    observe.add_argument(
        "--landmarks",
        type=number(LANDMARKS),
        default=4,
        metavar="N",
        help="that each camera or lidar sees, its own (default 4)",
    )
    observe.add_argument("--known-map", action="store_true", help="the landmarks are known")
    observe.add_argument(
        "--chart",
        default="principal",
        help="coordinates of the unknowns: principal (the thesis' principal axes), tensor (inertia tensor in frame g, regular at "
        "equal moments) or filter (the filters' state) (default principal)",
    )
    observe.add_argument(
        "--unknowns",
        default="ratios",
        help="of the inertia in the principal chart: ratios, or moments (all three, with their scale, as in chapter 3 of the "
        "thesis) (default ratios)",
    )


def _add_known_inputs(observe: argparse.ArgumentParser) -> None:
    body = "the body's principal axes, fixed in the body and known in frame g"
    camera = "the camera's axes at the first frame (x right, y down, z forward)"
    for name, what, axes in (
        ("--torque", "known torques about", body),
        ("--manoeuvre", "known accelerations of the inspector along", camera),
    ):
        observe.add_argument(
            name,
            nargs="+",
            choices=tuple("xyz"),
            metavar="AXIS",
            help=f"{what} x, y, z of {axes}; in every chart",
        )
    for name, unit, default, what in (
        (
            "--torque-size",
            "N m",
            0.1,
            "amplitude of the torques in the bound, N m; --moments are then kg m^2",
        ),
        ("--manoeuvre-size", "m/s^2", 0.01, "amplitude of the accelerations in the bound, m/s^2"),
        ("--input-period", "s", 20.0, "period of the first of them, s; each further one is faster"),
    ):
        observe.add_argument(
            name,
            type=number(NumberRange(1e-6, 1e6, unit)),
            default=default,
            metavar="X",
            help=f"{what} (default {default:g})",
        )


def add_condition(commands: Commands) -> argparse.ArgumentParser:
    """Parser of ``spinfilters condition``."""
    condition = commands.add_parser(
        "condition",
        help="how well conditioned covariances are, by time step and units",
        description="Without RUN: condition number of the process noise gathered over a time step, with velocity in units of "
        "alpha (section 4.9 of the thesis; the best is dt = sqrt(3)/alpha, 13.93), and of the whole pose and its velocities at a "
        "body rate. With RUN: condition number of every estimator's own covariance over its epochs, and the units that "
        "improve it.",
    )
    condition.add_argument("run", metavar="RUN", nargs="?", help="run folder made by compare or estimate")
    condition.add_argument(
        "-o",
        "--output",
        metavar="FOLDER",
        default="runs/condition",
        help="JSON, CSV and picture (default runs/condition)",
    )
    condition.add_argument(
        "--time-step", type=number(NumberRange(1e-6, 1e6, "s")), metavar="DT", help="s (default 0.5)"
    )
    condition.add_argument(
        "--alpha",
        type=number(NumberRange(1e-6, 1e6, "1/s")),
        metavar="A",
        help="unit of velocity over that of position, 1/s (default sqrt(3)/DT, the best)",
    )
    condition.add_argument(
        "--rate-rpm",
        type=number(RATE_RPM),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="body rate about the principal axes x, y, z (default 0.5 10 0.5)",
    )
    return condition


def add_motion(parser: argparse.ArgumentParser) -> None:
    """Options of a simulated motion."""
    parser.add_argument("--frames", type=number(FRAMES), default=115, help="number of frames (default 115)")
    parser.add_argument(
        "--interval", type=number(INTERVAL), default=0.5, help="seconds between frames (default 0.5)"
    )
    parser.add_argument(
        "--rate-rpm",
        type=number(RATE_RPM),
        nargs=3,
        default=DEFAULT_RATE_RPM,
        metavar=("X", "Y", "Z"),
        help="about the principal axes x, y, z in the order of --moments (default 0.5 10 0.5)",
    )
    parser.add_argument(
        "--moments",
        type=number(MOMENT),
        nargs=3,
        default=DEFAULT_MOMENTS,
        metavar=("JX", "JY", "JZ"),
        help="principal moments about x, y, z, of any scale (default 1.0322 1 0.8596)",
    )


def number(allowed: NumberRange) -> Callable[[str], float | int]:
    """What reads a number of a range from an argument."""

    def parsed(text: str) -> float | int:
        try:
            return allowed.parsed(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parsed
