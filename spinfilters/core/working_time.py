"""Building of functions: one thread at a time, and left out of processing times.

CasADi's expressions are not safe to be written down by two threads at once: its Python package lets go of the interpreter's lock
in every call, and reference counts, caches of constants and the marks of its sorting are shared by all expressions of a process.
What has been built is evaluated by any number of threads.
"""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import thread_time
from typing import Any, Final, Generic, TypeVar, overload

T = TypeVar("T")
_LOCK: Final = threading.RLock()
"""Held by the one thread that writes down, differentiates, copies or translates expressions."""
if sys.platform != "win32":
    # a process that is forked while another thread builds would wait for that thread's lock for ever
    os.register_at_fork(before=_LOCK.acquire, after_in_parent=_LOCK.release, after_in_child=_LOCK.release)


class _Building(threading.local):
    """Seconds that this thread has spent on building, and how many builds are nested at the moment."""

    seconds = 0.0
    depth = 0


_building = _Building()


def working_seconds() -> float:
    """Processor time of this thread, without what it spends on building functions [s].

    A busy machine does not make it longer; waiting for a disk or for another thread's building is not counted.
    """
    return thread_time() - _building.seconds


def is_building() -> bool:
    """Whether this thread may write down expressions."""
    return _building.depth > 0


@contextmanager
def building() -> Iterator[None]:
    """Within it this thread alone builds functions; it may be nested."""
    begin = thread_time()
    with _LOCK:
        _building.depth += 1
        try:
            yield
        finally:
            _building.depth -= 1
            if not _building.depth:
                _building.seconds += thread_time() - begin


class built_property(Generic[T]):  # noqa: N801  (a decorator, as functools.cached_property)
    """A cached property that is built once, whichever threads ask for it.

    ``functools.cached_property`` of Python 3.11 holds a lock of its own while it computes. Two threads that take that one and the
    lock of building in different orders would wait for each other for ever; here there is only the latter.
    """

    def __init__(self, build: Callable[[Any], T]) -> None:
        self._build, self.__doc__ = build, build.__doc__
        self._name = build.__name__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> "built_property[T]": ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> "T | built_property[T]":
        if instance is None:
            return self
        kept = instance.__dict__  # found there first from now on: this descriptor has no __set__
        with building():
            if self._name not in kept:
                kept[self._name] = self._build(instance)
            return kept[self._name]
