"""The command ``observe``."""

import argparse

from spinfilters.api.argument_ranges import LANDMARKS
from spinfilters.cli.command import Command, Subparsers, add_motion, number
from spinfilters.io.stated_values import NumberRange


def add_observe(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters observe``."""
    observe = commands.add_parser(
        "observe", help="what a sensor can determine of a motion, proved, and how well"
    )
    observe.add_argument(
        "model",
        nargs="?",
        metavar="MODEL.toml",
        help="your own equations instead of a tumbling body: states, parameters, equations, outputs",
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
        "--study", action="store_true", help="maps of the bound against motion, duration, epochs, landmarks"
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
    camera = "the camera's axes at the first epoch (x right, y down, z forward)"
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
    _add_input_sizes(observe)


def _add_input_sizes(observe: argparse.ArgumentParser) -> None:
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


def run_observe(options: argparse.Namespace) -> int:
    """Analyse, bound, write text, JSON and a picture, print the text."""
    if options.model is not None:
        from spinfilters.cli.observe_model import observe_model

        return observe_model(options)
    from spinfilters.cli.observe_motion import observe

    return observe(options)


OBSERVE = Command(add_observe, run_observe)
