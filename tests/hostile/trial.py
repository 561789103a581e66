"""One hostile input given to the command in a forked child, and what must hold of how it ended."""

import hashlib
import io
import os
import resource
import shutil
import signal
import stat
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from spinfilters.cli.main import main
from spinfilters.core.plugins import installed_plugins
from spinfilters.plots import figures

from .case import Case

SANITIZED = "libasan" in os.environ.get("LD_PRELOAD", "")
"""Whether the address sanitizer watches: it maps 20 TB, takes more memory for what is allocated, and slows the rest."""
LONGEST_S = 240 if SANITIZED else 60
"""Of the processor's time, so that a busy machine changes nothing."""
LONGEST_WAIT_S = 600.0
"""Of the clock: for a command that waits, and computes nothing."""
LONGEST_LINE = 300
MOST_MEMORY_MB = 4500 if SANITIZED else 1500
"""What a small input may take at its peak, of which the libraries alone are 200."""
ADDRESS_SPACE = resource.RLIM_INFINITY if SANITIZED else 6 << 30
"""Bytes that a command can have at all: a bound for the machine's sake."""
UNFINISHED = (".part", ".lock", ".tmp")
"""Ends of the names of what a command that has ended must not leave."""
_POLL_S = 0.005
_HASHED_BYTES = 1 << 26


@dataclass(frozen=True)
class Outcome:
    """How a command ended.

    Attributes
    ----------
    code: None where it was killed by a signal or by a limit.
    seconds, memory_mb: of the processor; at the peak.
    said: on standard error.
    harmed: the user's files that are no longer as they were.
    left: unfinished files and locks that it left behind.
    """

    code: int | None
    seconds: float
    memory_mb: float
    said: str
    harmed: tuple[str, ...]
    left: tuple[str, ...] = ()

    @property
    def violations(self) -> list[str]:
        """What must not be, in words."""
        # what is left to compile hangs on the commands before, and a full disk stops that too
        of_compiler = ("compiling the models", "not compiled, which makes models several times slower")
        lines = [line for line in self.said.splitlines() if not any(words in line for words in of_compiler)]
        found = [f"changed the user's {name}" for name in self.harmed]
        found += [f"left {name}" for name in self.left]
        if self.seconds > LONGEST_S - 1 or self.code is None:
            found.append(f"no end: killed after {self.seconds:.0f} s")
        elif self.code not in (0, 2):
            found.append(f"exit code {self.code}")
        if "Traceback" in self.said or "spinfilters: unexpected " in self.said:
            found.append(f"unexpected: {lines[-1][:200] if lines else ''}")
        elif self.code == 2 and (len(lines) != 1 or len(lines[0]) > LONGEST_LINE):
            found.append(f"{len(lines)} lines, the longest of {max(map(len, lines), default=0)}: {lines[:2]}")
        elif self.code == 0 and lines:
            found.append(f"warns: {lines[0][:200]}")
        if self.memory_mb > MOST_MEMORY_MB:
            found.append(f"took {self.memory_mb:.0f} MB")
        return found


Runner = Callable[[Case, Path], tuple[int, resource.struct_rusage]]
"""Runs the command of a case that was made in a folder, in a child; its exit status and resources."""


def tried(case: Case, originals: Path, place: Path, run: Runner | None = None) -> Outcome:
    """Make the input of a case in an empty folder and give it to the command, by default in a child of this process."""
    made(case, originals, place)
    before = _digests(place / "in")
    status, usage = (run or run_forked)(case, place)
    after = _digests(place / "in")
    changed = {name for name in {*before, *after} if before.get(name) != after.get(name)}
    harmed = sorted(name for name in changed if case.keeps is None or name.startswith(case.keeps))
    code = os.WEXITSTATUS(status) if os.WIFEXITED(status) else None
    said = (place / "said.txt").read_text(encoding="utf-8", errors="replace")
    seconds = usage.ru_utime + usage.ru_stime
    left = tuple(str(path.relative_to(place)) for path in place.rglob("*") if path.name.endswith(UNFINISHED))
    return Outcome(
        code, seconds, usage.ru_maxrss / 1024, said, tuple(harmed), left if code is not None else ()
    )


def made(case: Case, originals: Path, place: Path) -> None:
    """Copy the original of a case and change it."""
    shutil.copytree(originals / case.original, place / "in", symlinks=True)
    (place / "out").mkdir()
    case.change(place / "in")


def run_forked(case: Case, place: Path) -> tuple[int, resource.struct_rusage]:
    """Exit status and resources of the command in a child, which is killed when its time is over."""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # of threads, which a child that only computes never misses
        child = os.fork()
    if child == 0:
        _be_command(case, place)
    limit = time.monotonic() + LONGEST_WAIT_S
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            return status, usage
        if time.monotonic() > limit:
            os.killpg(child, signal.SIGKILL)
            _, status, usage = os.wait4(child, 0)
            return status, usage
        time.sleep(_POLL_S)


def _be_command(case: Case, place: Path) -> None:
    """Become the command: nothing returns from here."""
    code = 70
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S, LONGEST_S))
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        if not case.pictures:
            figures._figures = lambda _: ()
        os.chdir(place / "out")
        sys.dont_write_bytecode = True  # a full disk would cut what other processes read
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        for stream, name in ((sys.stdout, "printed.txt"), (sys.stderr, "said.txt")):
            stream.flush()
            os.dup2(
                os.open(place / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1 if stream is sys.stdout else 2
            )
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), encoding="utf-8")
        sys.stderr = io.TextIOWrapper(
            io.FileIO(2, "w", closefd=False), encoding="utf-8", errors="backslashreplace"
        )
        if case.installs:
            sys.path.insert(0, str(place / "in" / "site"))
            installed_plugins.cache_clear()
        if case.file_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (case.file_bytes, case.file_bytes))
        warnings.resetwarnings()
        warnings.showwarning = _show  # as the interpreter does, whatever a test runner has put in its place
        code = main(case.command(place))
    except SystemExit as stop:  # argparse
        code = stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _show(message: object, category: type, filename: str, line: int, *_: object) -> None:
    if issubclass(category, DeprecationWarning | ResourceWarning):
        return
    print(f"{filename}:{line}: {category.__name__}: {message}", file=sys.stderr)


def _digests(folder: Path) -> dict[str, str]:
    """Of everything below a folder, by relative path; nothing is opened that could block."""
    found = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        text = f"{status.st_mode:o} {status.st_size if stat.S_ISREG(status.st_mode) else ''}"
        if stat.S_ISLNK(status.st_mode):
            text += os.readlink(path)
        elif stat.S_ISREG(status.st_mode) and status.st_size <= _HASHED_BYTES:
            text += hashlib.sha256(path.read_bytes()).hexdigest()
        found[os.fsencode(path.relative_to(folder)).decode("utf-8", "backslashreplace")] = text
    return found
