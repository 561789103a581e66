"""The command ``doctor``."""

import argparse

from spinfilters.cli.command import Command, Subparsers


def add_doctor(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters doctor``."""
    return commands.add_parser("doctor", help="print versions and check that everything works")


def run_doctor(options: argparse.Namespace) -> int:
    """Examine this installation, print what was found."""
    from spinfilters.cli.installation import run_doctor

    return run_doctor(options)


DOCTOR = Command(add_doctor, run_doctor)
