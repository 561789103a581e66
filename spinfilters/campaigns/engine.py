"""Execution of a campaign's outstanding runs by processes of this machine, whose crashes are recorded as rows."""

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final, Protocol

from spinfilters.campaigns.campaign_folder import keep_study, open_folder
from spinfilters.campaigns.rows_folder import RowsFolder
from spinfilters.campaigns.runner import Row, ended
from spinfilters.campaigns.study import Study
from spinfilters.core.errors import InputError
from spinfilters.io.output_files import make_folder
from spinfilters.run.run_lock import locked_run

MOST_DEATHS: Final = 3
"""Times that a run is tried when its process is killed: once by chance, three times by the run."""
COMMAND: Final = (sys.executable, "-P", "-m", "spinfilters.campaigns.worker")
"""Nothing is imported from the working folder."""
ENVIRONMENT: Final = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 28),  # bytes: runs of one study need the same room again
    "MALLOC_MMAP_THRESHOLD_": str(1 << 28),
}
"""Of a worker, where nothing else is set."""
LARGEST_ANSWER: Final = 1 << 24
"""Bytes of a row: more is none."""


class WorkerProcess:
    """One process and the runs that it has been given.

    Call `receive` when its `stream` is readable; it never blocks for longer than a line takes to come.

    Parameters
    ----------
    command : Sequence[str]
        That answers as `spinfilters.campaigns.worker` does.
    """

    def __init__(self, study: Study, command: Sequence[str] = COMMAND) -> None:
        self._study, self._command = study, command
        self._deaths: dict[int, int] = {}
        self.assigned: deque[int] = deque()
        self._process: subprocess.Popen[bytes] | None = None
        self._buffer, self._since, self._ready = b"", 0.0, False
        self._failed_starts = 0

    @property
    def stream(self) -> IO[bytes]:
        """Stream from which answers are read."""
        assert self._process is not None
        assert self._process.stdout is not None
        return self._process.stdout

    @property
    def pid(self) -> int:
        """Process identifier."""
        assert self._process is not None
        return self._process.pid

    def assign(self, runs: Sequence[int]) -> None:
        """Assign runs, to be computed in this order."""
        if not self.assigned:
            self._since = time.monotonic()
        self.assigned.extend(runs)
        if self._process is None:
            self._start()
        else:
            self._send(runs)

    def receive(self) -> list[Row]:
        """Rows received, including that of a run which ended its process."""
        data = os.read(self.stream.fileno(), 1 << 16)
        if not data:
            return self._died()
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\n")
        if len(self._buffer) > LARGEST_ANSWER:
            raise InputError("a worker answers without end; this is a fault of spinfilters: please report it")
        return [row for line in lines for row in self._answered(line)]

    def stop(self) -> None:
        """End the process at once."""
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        process.wait()

    def _answered(self, line: bytes) -> list[Row]:
        if line == b"ready":
            self._ready, self._failed_starts = True, 0
            self._since = time.monotonic()
            return []
        row: dict[str, Any] = json.loads(line)
        if not self.assigned or row.get("run") != self.assigned[0]:
            return []
        self.assigned.popleft()
        self._since = time.monotonic()
        return [row]

    def _start(self) -> None:
        paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**ENVIRONMENT, **os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, env=environment
        )
        self._buffer, self._ready = b"", False
        self._write(json.dumps(dict(self._study.document)).encode() + b"\n")
        self._send(self.assigned)

    def _send(self, runs: Sequence[int]) -> None:
        self._write(b"".join(b"%d\n" % run for run in runs))

    def _write(self, data: bytes) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # it has died, which its answers will tell
            self._process.stdin.write(data)

    def _died(self) -> list[Row]:
        """The row of the run that ended its process.

        None where chance may have ended it; another process takes the rest.
        """
        assert self._process is not None
        code, was_ready = self._process.wait(), self._ready
        self.stop()
        found = []
        if not was_ready:
            self._failed_starts += 1
            if self._failed_starts >= MOST_DEATHS:
                raise InputError(
                    f"worker processes cannot be started (exit code {code}); run 'spinfilters doctor'"
                )
        elif self.assigned:
            found = self._verdict(self.assigned[0], code)
        if self.assigned:
            self._since = time.monotonic()
            self._start()
        return found

    def _verdict(self, run: int, code: int) -> list[Row]:
        seconds = time.monotonic() - self._since
        limit = self._study.options.time_limit_s
        if code == -signal.SIGALRM:
            self.assigned.popleft()
            return [
                ended(
                    self._study, run, "timeout", f"took longer than study.time_limit_s, {limit:g} s", seconds
                )
            ]
        self._deaths[run] = self._deaths.get(run, 0) + 1
        if self._deaths[run] < MOST_DEATHS:
            return []
        self.assigned.popleft()
        return [
            ended(
                self._study, run, "killed", f"its process ended {MOST_DEATHS} times: {_cause(code)}", seconds
            )
        ]


def _cause(code: int) -> str:
    if code == -signal.SIGKILL:
        return "killed, by the system short of memory or by somebody (SIGKILL)"
    with suppress(ValueError):
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"


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
    InputError
        As `open_folder`, `RowsFolder` and `keep_study`; workers that cannot be started, a scheduler that
        cannot be reached.
    KeyboardInterrupt
        Ctrl-C; every row that had come is kept.
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
