"""Work that is killed: done in a forked child, so that what a run has in memory is really gone."""

import os
import signal
import traceback
import warnings
from collections.abc import Callable


def killed(work: Callable[[], object]) -> bool:
    """Do the work in a forked child; whether SIGKILL ended it. A child that fails otherwise shows why."""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # of threads, which a child that only computes never misses
        child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    status = os.waitpid(child, 0)[1]
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0, "the child failed"
    return os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL


def kill_at(name: str, frame: int) -> Callable[[str, int, int], None]:
    """A progress report that kills its process when this estimator has done this many frames."""

    def progress(estimator: str, done: int, _: int) -> None:
        if (estimator, done) == (name, frame):
            os.kill(os.getpid(), signal.SIGKILL)

    return progress
