"""Calls on one thread of BLAS.

The matrices here are so small that more only wait for each other.
"""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Final, ParamSpec, TypeVar

from threadpoolctl import OpenBLASController, threadpool_limits

ASKED_FOR: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables by which somebody has said how many; then that holds."""
P = ParamSpec("P")
T = TypeVar("T")


def on_one_blas_thread(call: Callable[P, T]) -> Callable[P, T]:
    """The same function with BLAS on one thread.

    Before and after, BLAS has as many threads as it had.
    """

    @wraps(call)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        """The call on one thread."""
        if any(name in os.environ for name in ASKED_FOR):
            return call(*args, **kwargs)
        with _limit():
            return call(*args, **kwargs)

    return limited


class _Limit:
    """The limit of this process, and how many calls are inside it: BLAS counts its threads for all of them together."""

    lock = threading.Lock()
    inside = 0
    limits: threadpool_limits | None = None


@contextmanager
def _limit() -> Iterator[None]:
    """Within it BLAS has one thread; the first call in sets the limit, the last one out lifts it."""
    with _Limit.lock:
        if _Limit.limits is None:
            _free_openblas()
            _Limit.limits = threadpool_limits(1, user_api="blas")
        _Limit.inside += 1
    try:
        yield
    finally:
        with _Limit.lock:
            _Limit.inside -= 1
            if not _Limit.inside and _Limit.limits is not None:
                _free_openblas()
                _Limit.limits.restore_original_limits()
                _Limit.limits = None
                _free_openblas()


def _free_openblas() -> None:
    """Let any thread set OpenBLAS' number of threads.

    Since threadpoolctl 3.8 the first thread that sets it keeps the right to, as long as it lives, and what others set is ignored in
    silence. Here the first call in and the last one out may be of any threads.
    """
    clear = getattr(OpenBLASController, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)
