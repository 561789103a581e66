"""A command of ``spinfilters``: its parser, the function that runs it, and arguments that several commands have.

Nothing heavy is imported here, so that help is quick.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from spinfilters.api.argument_ranges import FRAMES, MOMENT
from spinfilters.api.argument_ranges import INTERVAL as INTERVAL_RANGE
from spinfilters.api.argument_ranges import RATE_RPM as RATE_RANGE
from spinfilters.io.stated_values import CLOCK_UNITS, RATE_UNITS, SAMPLING_RATE, NumberRange, ReadingOptions
from spinfilters.simulation.bundled_example import EPOCHS, INTERVAL, PRINCIPAL_MOMENTS, RATE_RPM

Subparsers = Any
"""What `argparse.ArgumentParser.add_subparsers` returns; its class is private."""


@dataclass(frozen=True)
class Command:
    """A command: its parser and the function that runs it.

    ``run`` takes the parsed arguments and returns the exit code. It imports what it needs when it is called, so that help is quick.
    """

    add_parser: Callable[[Subparsers], argparse.ArgumentParser]
    run: Callable[[argparse.Namespace], int]

    def add(self, subparsers: Subparsers) -> None:
        """Register the command's parser, with what runs it."""
        self.add_parser(subparsers).set_defaults(command=self.run)


def add_motion(parser: argparse.ArgumentParser) -> None:
    """Options of a simulated motion."""
    parser.add_argument(
        "--frames", type=number(FRAMES), default=EPOCHS, help=f"number of epochs (default {EPOCHS})"
    )
    parser.add_argument(
        "--interval",
        type=number(INTERVAL_RANGE),
        default=INTERVAL,
        help=f"seconds between epochs (default {INTERVAL:g})",
    )
    parser.add_argument(
        "--rate-rpm",
        type=number(RATE_RANGE),
        nargs=3,
        default=RATE_RPM,
        metavar=("X", "Y", "Z"),
        help=f"about the principal axes x, y, z in the order of --moments (default {_words(RATE_RPM)})",
    )
    parser.add_argument(
        "--moments",
        type=number(MOMENT),
        nargs=3,
        default=PRINCIPAL_MOMENTS,
        metavar=("JX", "JY", "JZ"),
        help=f"principal moments about x, y, z, of any scale (default {_words(PRINCIPAL_MOMENTS)})",
    )


def _words(numbers: tuple[float, ...]) -> str:
    """Numbers as they are given on a command line."""
    return " ".join(f"{each:g}" for each in numbers)


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
