"""Runs in processes of this machine, which a thread each hands out recording by recording."""

import os
import queue
import threading
from collections import deque
from collections.abc import Generator
from dataclasses import dataclass

from spinfilters.campaigns.engine import Chunk
from spinfilters.campaigns.run_process import RunProcess
from spinfilters.campaigns.runner import Row
from spinfilters.campaigns.study import Study


@dataclass(frozen=True)
class LocalProcesses:
    """Place where runs are made: this machine.

    Attributes
    ----------
    processes : int
        How many make runs side by side.
    """

    processes: int = 1

    def rows(self, study: Study, chunks: list[Chunk]) -> Generator[Row, None, None]:
        """Rows in the order of completion.

        Raises
        ------
        InputError
            Processes cannot be started.
        """
        waiting = deque(chunks)
        answered: queue.SimpleQueue[Row | Exception | None] = queue.SimpleQueue()
        processes = [RunProcess(study) for _ in range(min(self.processes, len(chunks)))]
        for process in processes:
            process.fork()  # before there are threads
        threads = [threading.Thread(target=_make_runs, args=(each, waiting, answered)) for each in processes]
        try:
            for thread in threads:
                thread.start()
            left = len(threads)
            while left:
                answer = answered.get()
                if isinstance(answer, Exception):
                    raise answer
                if answer is None:
                    left -= 1
                else:
                    yield answer
        finally:
            waiting.clear()
            for process in processes:
                process.stop()
            for thread in threads:
                if thread.ident is not None:
                    thread.join()


def usable_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _make_runs(
    process: RunProcess, waiting: deque[Chunk], answered: "queue.SimpleQueue[Row | Exception | None]"
) -> None:
    """Answer with the rows of chunks that wait, or with what went wrong, then with None."""
    try:
        while waiting:
            for run in waiting.popleft():
                answered.put(process.row(run))
    except IndexError:  # another thread took the last
        pass
    except Exception as error:
        answered.put(error)
    finally:
        answered.put(None)
