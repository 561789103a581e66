"""What an estimator computes with is built before its clock runs, so that a first run takes as long as the second."""

import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("built_in_clock.py")
KINDS = ("map", "tracks", "gyro", "pose")


@cache
def said() -> dict[str, str]:
    """What the program says of every kind."""
    done = subprocess.run([sys.executable, PROGRAM, *KINDS], capture_output=True, text=True, check=True)
    return dict(zip(KINDS, done.stdout.splitlines(keepends=True), strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_built_while_a_clock_runs(kind: str) -> None:
    looks, _, rest = said()[kind].partition(" ")
    assert int(looks) > 40, said()[kind]
    assert rest == "looks at clocks; built while they ran: nothing\n"
