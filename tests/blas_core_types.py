"""A program that prints the core types of OpenBLAS under which the numeric tests are run once more.

Every processor has its own compiled loops, which sum in another order: what passes by rounding on one machine fails on another.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Final

from spinfilters.core.c_library import processor

NEEDED: Final = {
    "Haswell": {"avx2", "fma"},
    "SkylakeX": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "Nehalem": {"sse4_2"},
}
"""Core types, and the instructions without which a processor cannot run them (as Linux names both)."""
RUNNING: Final = (
    "import numpy, scipy.linalg, threadpoolctl\n"
    "print(*{each['architecture'] for each in threadpoolctl.threadpool_info() if each['internal_api'] == 'openblas'})"
)


def running(core_type: str | None) -> set[str]:
    """What NumPy's and SciPy's OpenBLAS run in a process that is asked for a core type, or not asked."""
    asked = {} if core_type is None else {"OPENBLAS_CORETYPE": core_type}
    command = [sys.executable, "-c", RUNNING]
    done = subprocess.run(command, env=os.environ | asked, capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def left_out(flags: set[str]) -> Iterator[tuple[str, str | None]]:
    """Every core type, and why it is left out, or None."""
    own = running(None)
    for core_type, needed in NEEDED.items():
        if own == {core_type}:
            yield core_type, "the whole suite runs under it here"
        elif needed - flags:
            yield core_type, f"this processor lacks {' '.join(sorted(needed - flags))}"
        elif (found := running(core_type)) != {core_type}:
            yield core_type, f"{' '.join(sorted(found)) or 'no OpenBLAS'} runs in its place"
        else:
            yield core_type, None


if __name__ == "__main__":
    for name, why in left_out(set(processor().split())):
        print(
            name if why is None else f"core type {name} left out: {why}",
            file=sys.stderr if why else sys.stdout,
        )
