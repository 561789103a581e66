"""Calls on one thread of BLAS.

The matrices here are so small that more only wait for each other.
"""

import os
from collections.abc import Callable
from functools import wraps
from typing import Final, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

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
        with threadpool_limits(1, user_api="blas"):
            return call(*args, **kwargs)

    return limited
