"""The script that runs compiled code under sanitizers finds what it is for."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / ".ci" / "sanitize"
GCC = shutil.which("gcc")
PROGRAM = """
import ctypes
import numpy as np
from spinfilters.core.c_library import FLAGS, load_text

text = "int shifted(int n) { return 1 << n; } double taken(const double* x, long long k) { return x[k]; }"
library, numbers = load_text("tried", text, FLAGS), np.zeros(100)
library.shifted(SHIFT)
library.taken(ctypes.c_void_p(numbers.ctypes.data), ctypes.c_longlong(PLACE))
"""


def has_sanitizers() -> bool:
    """Whether there is a GCC whose address sanitizer is installed."""
    if GCC is None:
        return False
    found = subprocess.run([GCC, "-print-file-name=libasan.so"], capture_output=True, text=True, check=False)
    return Path(found.stdout.strip()).exists() and "/" in found.stdout


@pytest.mark.skipif(not has_sanitizers(), reason="no GCC with an address sanitizer")
@pytest.mark.parametrize(
    ("shift", "place", "finding"),
    [(3, 99, ""), (40, 0, "shift exponent 40"), (3, 100, "heap-buffer-overflow")],
    ids=["clean", "undefined", "out of bounds"],
)
def test_a_watched_library_is_clean_or_named(
    monkeypatch: pytest.MonkeyPatch, shift: int, place: int, finding: str
) -> None:
    monkeypatch.setenv("CC", GCC or "")
    program = PROGRAM.replace("SHIFT", str(shift)).replace("PLACE", str(place))
    command = [str(SCRIPT), "--", sys.executable, "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == (1 if finding else 0), ended.stderr
    assert "1 libraries watched" in ended.stdout
    assert finding in ended.stderr
