"""The clock that all solvers of the smoother's benchmark are timed with, the same for all."""

from collections.abc import Callable
from time import perf_counter, process_time
from typing import Final

CLOCKS: Final[dict[str, Callable[[], float]]] = {"wall": perf_counter, "processor": process_time}
"""On a busy machine the wall's is kind to what is short, for it is seldom interrupted: take the processor's there."""
_chosen = ["wall"]


def use_clock(name: str) -> None:
    """Of `CLOCKS`, from here on."""
    _chosen[0] = name


def now() -> float:
    """Seconds; only differences mean anything."""
    return CLOCKS[_chosen[0]]()
