"""Clock and threads of the benchmarks, the same for all solvers."""

import os
import sys
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Final

CLOCKS: Final[dict[str, Callable[[], float]]] = {"wall": perf_counter, "processor": process_time}
"""On a busy machine the wall's is kind to what is short, for it is seldom interrupted: take the processor's there."""
_chosen = ["wall"]


def use_clock(name: str) -> None:
    """Use this clock of `CLOCKS` from here on."""
    _chosen[0] = name


def now() -> float:
    """Seconds; only differences mean anything."""
    return CLOCKS[_chosen[0]]()


ONE_THREAD: Final[dict[str, str]] = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)


def use_one_thread(module: str) -> None:
    """Restart a module with one thread per library.

    Linear algebra libraries read these variables only when they are loaded.
    """
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        os.environ.update(ONE_THREAD)
        os.execv(sys.executable, [sys.executable, "-m", module, *sys.argv[1:]])
