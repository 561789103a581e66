"""A process that makes runs: numbers in, rows out, as lines of JSON; its death becomes the row of the run that was under way.

    python -m spinfilters.campaigns.run_process

A run has a process around it because nothing else ends one that hangs inside C, or that the system ends for want of memory, without
taking the campaign, or a worker of a shared Dask cluster and what it holds for others, along. The process serves one run after
another. Its own alarm ends it when a run takes longer than the study allows; when its input ends, so does it.
"""

import gc
import json
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

from spinfilters.campaigns.runner import Row, Runner, ended
from spinfilters.campaigns.study import Study, study_from
from spinfilters.core.errors import InputError

MOST_DEATHS: Final = 3
"""Times that a run is tried when its process is killed: once by chance, three times by the run."""
COMMAND: Final = (sys.executable, "-P", "-m", "spinfilters.campaigns.run_process")
"""Nothing is imported from the working folder."""
ENVIRONMENT: Final = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 28),  # bytes: runs of one study need the same room again
    "MALLOC_MMAP_THRESHOLD_": str(1 << 28),
}
"""Environment of the process, where nothing else is set: libraries read it when they load."""
LARGEST_ANSWER: Final = 1 << 24
"""Bytes of a row: a longer line is a fault."""


class RunProcess:
    """A process that makes the runs of one study, started again when a run has ended it.

    Parameters
    ----------
    study : Study
        Whose runs are made.
    command : Sequence[str]
        Program that answers as this module's `main` does.
    """

    def __init__(self, study: Study, command: Sequence[str] = COMMAND) -> None:
        self._study, self._command = study, command
        self._process: subprocess.Popen[bytes] | None = None
        self._making = threading.Lock()  # while a thread waits for a row
        self._starting, self._stopped = threading.Lock(), False

    @property
    def pid(self) -> int | None:
        """Process identifier, while there is a process."""
        process = self._process
        return None if process is None else process.pid

    def row(self, run: int) -> Row:
        """Make a run, and wait for its row.

        Raises
        ------
        InputError
            The process cannot be started, or was stopped by another thread.
        """
        with self._making:
            return self._row(run)

    def stop(self) -> None:
        """End the process at once and start no other; a thread that waits in `row` is released."""
        with self._starting:
            self._stopped = True
            if self._process is not None:
                self._process.kill()
        with self._making:
            if self._process is not None:
                self._reap(self._process)

    def _row(self, run: int) -> Row:
        limit = self._study.options.time_limit_s
        for deaths in range(1, MOST_DEATHS + 1):
            process = self._process or self._start()
            begin = time.monotonic()
            _write(process, b"%d\n" % run)
            answer = _read_line(process)
            if answer:
                return json.loads(answer)
            seconds, code = time.monotonic() - begin, self._reap(process)
            if code == -signal.SIGALRM:
                reason = f"took longer than study.time_limit_s, {limit:g} s"
                return ended(self._study, run, "timeout", reason, seconds)
            if deaths == MOST_DEATHS:
                reason = f"its process ended {MOST_DEATHS} times: {_cause(code)}"
                return ended(self._study, run, "killed", reason, seconds)
        raise AssertionError("the last death gives a row")

    def _start(self) -> "subprocess.Popen[bytes]":
        """Start the process and wait until it is ready."""
        paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**ENVIRONMENT, **os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        code = 0
        for _ in range(MOST_DEATHS):
            with self._starting:
                if self._stopped:
                    raise InputError("the campaign has ended; continue with --resume")
                process = self._process = subprocess.Popen(
                    self._command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    env=environment,
                    start_new_session=True,  # Ctrl-C is for the process that asked
                )
            _write(process, json.dumps(dict(self._study.document)).encode() + b"\n")
            if _read_line(process):
                return process
            code = self._reap(process)
        raise InputError(f"worker processes cannot be started ({_cause(code)}); run 'spinfilters doctor'")

    def _reap(self, process: "subprocess.Popen[bytes]") -> int:
        """Exit code of a process that answers no more."""
        process.wait()
        self._process = None
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            with suppress(OSError):
                stream.close()
        return process.returncode


def _write(process: "subprocess.Popen[bytes]", line: bytes) -> None:
    assert process.stdin is not None
    with suppress(BrokenPipeError):  # it has ended, and its silence will say so
        process.stdin.write(line)
        process.stdin.flush()


def _read_line(process: "subprocess.Popen[bytes]") -> bytes:
    """Next whole line of a process; empty where it ended before."""
    assert process.stdout is not None
    line = process.stdout.readline(LARGEST_ANSWER)
    if line.endswith(b"\n"):
        return line
    if len(line) >= LARGEST_ANSWER:
        raise InputError("a worker answers without end; this is a fault of spinfilters: please report it")
    return b""


def _cause(code: int) -> str:
    """Cause of a process's death, in words."""
    if code == -signal.SIGKILL:
        return "killed (SIGKILL), by the system when memory was short or by a user"
    with suppress(ValueError):
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"


def main() -> None:
    """Make the runs whose numbers standard input gives, until it ends."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends the process wherever it is
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what libraries print is no answer
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as score:
        score.write("1000")  # short of memory, the system is to end this process and not the one that waits
    with suppress(BrokenPipeError):
        _serve(sys.stdin.buffer, answers)


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer the study with a line, and each number with the row of its run."""
    first = requests.readline()
    if not first:
        return
    warnings.filterwarnings("ignore", category=RuntimeWarning)  # numbers that are not finite have a status
    study = study_from(json.loads(first), "study")
    runner, limit = Runner(study), study.options.time_limit_s
    gc.freeze()  # what is loaded stays: searches for garbage between runs need not go through it
    answers.write(b"ready\n")
    for request in iter(requests.readline, b""):
        signal.setitimer(signal.ITIMER_REAL, limit)
        row = runner.row(int(request))
        signal.setitimer(signal.ITIMER_REAL, 0)
        answers.write(json.dumps(row).encode() + b"\n")


if __name__ == "__main__":
    main()
