"""Client of a worker process, whose crash is recorded as a row."""

import json
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final

from spinfilters.campaigns.runner import Row, ended
from spinfilters.campaigns.study import Study
from spinfilters.errors import InputError

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
    command: that answers as `spinfilters.campaigns.worker` does.
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
