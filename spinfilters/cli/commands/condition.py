"""The command ``condition``."""

import argparse

from spinfilters.api.argument_ranges import RATE_RPM
from spinfilters.cli.command import Command, Subparsers, number
from spinfilters.io.stated_values import NumberRange


def add_condition(commands: Subparsers) -> argparse.ArgumentParser:
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
    _add_motion(condition)
    return condition


def _add_motion(condition: argparse.ArgumentParser) -> None:
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


def run_condition(options: argparse.Namespace) -> int:
    """Compute, write JSON, CSV and a picture, print the table."""
    from spinfilters.cli.condition_numbers import condition

    return condition(options)


CONDITION = Command(add_condition, run_condition)
