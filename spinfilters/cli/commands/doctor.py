"""The command ``doctor``."""

from dataclasses import dataclass

from spinfilters.cli.command import Command


@dataclass(frozen=True)
class DoctorArguments:
    """``doctor`` has none."""


def run_doctor(_: DoctorArguments) -> int:
    """Examine this installation, print what was found."""
    from spinfilters.cli.installation import doctor

    return doctor()


COMMAND = Command("doctor", DoctorArguments, run_doctor)
