"""Comparisons in several threads give the numbers of one after the other, bit for bit."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("compared_in_threads.py")


@pytest.mark.parametrize(
    ("compiling", "kinds"), [("on", ("gyro", "pose", "stereo-tracks")), ("off", ("gyro",))]
)
def test_threads_give_the_numbers_of_one_after_the_other(compiling: str, kinds: tuple[str, ...]) -> None:
    environment = os.environ | {"SPINFILTERS_COMPILE": compiling}
    command = [sys.executable, str(PROGRAM), *kinds]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert ended.returncode == 0, ended.stderr[-2000:]
    count = 2 * len(kinds)
    assert ended.stdout == f"{count} of {count} alike; without the lock: nobody\n"
