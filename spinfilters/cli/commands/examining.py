"""The command ``doctor``."""

import argparse

from spinfilters.cli.command import Command, Subparsers


def add_doctor(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters doctor``."""
    return commands.add_parser("doctor", help="print versions and check that everything works")


COMMANDS = (Command(90, add_doctor, "spinfilters.cli.doctor:run_doctor"),)
