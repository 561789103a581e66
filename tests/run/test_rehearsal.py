"""What an estimator computes with is built before its clock runs, so that a first run takes as long as the second."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("built_in_clock.py")


@pytest.mark.parametrize("kind", ["map", "tracks", "gyro", "pose"])
def test_nothing_is_built_while_a_clock_runs(kind: str) -> None:
    done = subprocess.run([sys.executable, PROGRAM, kind], capture_output=True, text=True, check=True)
    looks, _, rest = done.stdout.partition(" ")
    assert int(looks) > 40, done.stdout
    assert rest == "looks at clocks; built while they ran: nothing\n"
