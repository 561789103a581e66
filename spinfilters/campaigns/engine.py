"""Execution of a campaign's outstanding runs by processes or a cluster."""

import os
import selectors
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from spinfilters.campaigns.campaign_folder import keep_study, open_folder
from spinfilters.campaigns.rows_folder import RowsFolder
from spinfilters.campaigns.runner import Row
from spinfilters.campaigns.study import Study
from spinfilters.campaigns.worker_process import WorkerProcess
from spinfilters.data.atomic_write import make_folder
from spinfilters.errors import InputError
from spinfilters.runs.run_lock import locked_run

Chunk = tuple[int, ...]
"""Runs of one recording, which one process makes one after another."""


@dataclass(frozen=True)
class Shard:
    """Share ``number`` of ``count``, from 0."""

    number: int = 0
    count: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.number < self.count:
            raise InputError(
                f"shard {self.number}/{self.count} does not exist; give i/N with i from 0 to N - 1"
            )


@dataclass(frozen=True)
class Advance:
    """Progress of a campaign: runs done, total, faulty rows, seconds left."""

    done: int
    total: int
    faulty: int
    seconds_left: float | None


Progress = Callable[[Advance], None]


class Executor(Protocol):
    """Place where runs are computed."""

    def rows(self, study: Study, chunks: list[Chunk]) -> Iterator[Row]:
        """Rows of all runs, each once, in the order of completion."""
        ...


@dataclass(frozen=True)
class Processes:
    """Processes of this machine."""

    count: int

    def rows(self, study: Study, chunks: list[Chunk]) -> Iterator[Row]:
        """Rows in the order of completion; each process has a second chunk queued."""
        left = deque(chunks)
        workers = [WorkerProcess(study) for _ in range(min(self.count, len(chunks)))]
        with selectors.DefaultSelector() as ready:
            try:
                for worker in workers:  # one chunk each before any has a second
                    worker.assign(left.popleft())
                    ready.register(worker.stream, selectors.EVENT_READ, worker)
                for worker in workers:
                    _refill(worker, left)
                while ready.get_map():
                    for key, _ in ready.select():
                        yield from _served(ready, key, left)
            finally:
                for worker in workers:
                    worker.stop()


WAITING: Final = 2
"""Chunks that a process has at hand."""


def _refill(worker: WorkerProcess, left: deque[Chunk]) -> None:
    while left and len(worker.assigned) < WAITING * len(left[0]):
        worker.assign(left.popleft())


def _served(ready: selectors.BaseSelector, key: selectors.SelectorKey, left: deque[Chunk]) -> Iterator[Row]:
    """Take what a worker has to say, give it more."""
    worker: WorkerProcess = key.data
    before = key.fileobj
    rows = worker.receive()
    _refill(worker, left)
    if not worker.assigned:
        ready.unregister(before)
        worker.stop()
    elif worker.stream is not before:  # another process in its place
        ready.unregister(before)
        ready.register(worker.stream, selectors.EVENT_READ, worker)
    yield from rows


def run_campaign(
    study: Study,
    folder: Path,
    executor: Executor,
    shard: Shard = Shard(),
    resume: bool = False,
    progress: Progress = lambda _: None,
) -> Advance:
    """Compute the runs of a study that its folder lacks.

    Raises
    ------
    InputError: as `open_folder`, `RowsFolder` and `keep_study`; workers that cannot be started, a scheduler that cannot be reached.
    KeyboardInterrupt: Ctrl-C; every row that had come is kept.
    """
    make_folder(folder)
    with locked_run(folder), _opened(folder, study, resume) as rows:
        done = rows.done()
        keep_study(folder, study, done)
        chunks = [chunk for chunk in (_left(c, done) for c in _chunks(study, shard)) if chunk]
        total = sum(map(len, chunks))
        pace = _Pace(len(done), total)
        progress(pace.advance(0, 0))
        faulty = count = 0
        if not chunks:
            return pace.advance(0, 0)
        found = executor.rows(study, chunks)
        try:
            for row in found:
                rows.append(row)
                count += 1
                faulty += row["outcome"] != "done"
                progress(pace.advance(count, faulty))
        finally:
            found.close()  # pyright: ignore[reportAttributeAccessIssue]
        return pace.advance(count, faulty)


def _opened(folder: Path, study: Study, resume: bool) -> RowsFolder:
    """Rows of a folder that is this study's."""
    open_folder(folder, study, resume)
    return RowsFolder(folder, study.columns, study.levels)


def usable_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _chunks(study: Study, shard: Shard) -> Iterator[Chunk]:
    """Runs of the same recording together; those of this shard."""
    together = study.estimators
    for number in range(len(study) // together):
        if number % shard.count == shard.number:
            yield tuple(range(number * together, (number + 1) * together))


def _left(chunk: Chunk, done: set[int]) -> Chunk:
    return tuple(run for run in chunk if run not in done)


class _Pace:
    """Time left, from the rows of this time alone."""

    def __init__(self, before: int, total: int) -> None:
        self._before, self._total, self._begin = before, total, time.monotonic()

    def advance(self, count: int, faulty: int) -> Advance:
        """Progress after ``count`` runs of this call, ``faulty`` rows among all."""
        spent = time.monotonic() - self._begin
        left = spent / count * (self._total - count) if count else None
        return Advance(self._before + count, self._before + self._total, faulty, left)
