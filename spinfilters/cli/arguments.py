"""Arguments that several commands have; nothing heavy is imported here, so that help is quick."""

import argparse
from collections.abc import Callable

from spinfilters.api.argument_ranges import (
    DEFAULT_MOMENTS,
    DEFAULT_RATE_RPM,
    FRAMES,
    INTERVAL,
    MOMENT,
    RATE_RPM,
)
from spinfilters.data.stated_values import CLOCK_UNITS, RATE_UNITS, SAMPLING_RATE, NumberRange, ReadingOptions


def add_motion(parser: argparse.ArgumentParser) -> None:
    """Options of a simulated motion."""
    parser.add_argument("--frames", type=number(FRAMES), default=115, help="number of epochs (default 115)")
    parser.add_argument(
        "--interval", type=number(INTERVAL), default=0.5, help="seconds between epochs (default 0.5)"
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


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Options that state what a recording does not tell."""
    group = parser.add_argument_group("what the recording does not tell")
    group.add_argument("--unit", metavar="UNIT", help=f"of body rates: {', '.join(RATE_UNITS)}")
    group.add_argument("--clock", metavar="UNIT", help=f"of time stamps: {', '.join(CLOCK_UNITS)}")
    group.add_argument(
        "--rate", type=number(SAMPLING_RATE), metavar="HZ", help="samples a second, in place of a clock"
    )
    group.add_argument("--topic", metavar="NAME", help="of a ROS bag, where it has several that can be read")


def reading_options(options: argparse.Namespace) -> ReadingOptions:
    """Reading options of the arguments. InputError: an unknown unit."""
    return ReadingOptions(options.unit, options.clock, options.rate, options.topic)


def number(allowed: NumberRange) -> Callable[[str], float | int]:
    """Argument parser for numbers within a range."""

    def parsed(text: str) -> float | int:
        """The number, in its range."""
        try:
            return allowed.parsed(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parsed
