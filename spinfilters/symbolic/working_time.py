"""Processing time without the compilation of functions."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter


class _Building:
    """Seconds spent on building in this process, and how many builds are nested at the moment."""

    seconds = 0.0
    depth = 0


def working_seconds() -> float:
    """A clock that stands still while functions are built."""
    return perf_counter() - _Building.seconds


@contextmanager
def building() -> Iterator[None]:
    """Within it functions are built."""
    begin = perf_counter()
    _Building.depth += 1
    try:
        yield
    finally:
        _Building.depth -= 1
        if not _Building.depth:
            _Building.seconds += perf_counter() - begin
