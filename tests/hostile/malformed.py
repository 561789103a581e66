"""Malformed inputs of every format through the command line: ``python -m tests.hostile.malformed``."""

from collections.abc import Sequence

from .calibrations import calibration_cases
from .campaign import campaign, parser
from .case import Case
from .commands import command_cases
from .motions import motion_cases
from .runs import run_cases
from .settings import settings_cases
from .tables import table_cases


def malformed_cases() -> list[Case]:
    """Every malformed input, their names unique."""
    cases = [
        *table_cases(),
        *calibration_cases(),
        *settings_cases(),
        *command_cases(),
        *run_cases(),
        *motion_cases(),
    ]
    names = [case.name for case in cases]
    assert len(set(names)) == len(names), sorted(name for name in names if names.count(name) > 1)
    return cases


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them all; exit code 1 where one did what it must not."""
    assert __doc__ is not None
    return campaign("tests.hostile.malformed", malformed_cases(), parser(__doc__).parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
