"""The command ``plot``."""

import argparse

from spinfilters.cli.command import Command, Subparsers


def add_plot(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters plot``."""
    plot = commands.add_parser("plot", help="draw the figures of a run folder again")
    plot.add_argument("run", metavar="RUN", help="folder made by compare or estimate")
    return plot


COMMANDS = (Command(60, add_plot, "spinfilters.cli.plot:plot"),)
