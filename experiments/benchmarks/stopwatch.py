"""Clock, threads and first line of all benchmarks, the same for all solvers."""

import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter, process_time, sleep
from typing import Final, NamedTuple

from spinfilters.core.c_library import LANES, compiler, compiler_version
from spinfilters.core.errors import InputError

CLOCKS: Final[dict[str, Callable[[], float]]] = {"wall": perf_counter, "processor": process_time}
"""Processor time leaves out what else a machine does. Wall time is what a user waits for; it needs quiet cores."""
_chosen = ["processor"]
BETWEEN_LOOKS: Final = 0.01
"""Time between two looks at a command that runs, s."""


def begin_benchmark(module: str, clock: str = "processor", threads: str = "one thread") -> None:
    """Restart a benchmark with one thread per library, choose its clock, and print on what it runs.

    Parameters
    ----------
    module: its full name.
    clock: of `CLOCKS`; another name is that of a benchmark that has clocks of its own, and is printed alone.
    threads: how the printed line calls them; a benchmark that starts processes has some of one thread each.
    """
    use_one_thread(module)
    if clock in CLOCKS:
        _chosen[0] = clock
    print(f"{machine()}; {threads}, {clock} time", flush=True)


def now() -> float:
    """Seconds; only differences mean anything."""
    return CLOCKS[_chosen[0]]()


ONE_THREAD: Final[dict[str, str]] = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)


def users_environment() -> dict[str, str]:
    """Environment variables but the one that forbids Python to keep its compiled modules, which every installation has."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


class CommandCost(NamedTuple):
    """What a command took.

    Attributes
    ----------
    wall, processor: s; of the processor its children too, as far as it has waited for them.
    peak_mb: largest resident memory of one process, MB.
    """

    wall: float
    processor: float
    peak_mb: float


def cost_of_command(command: Sequence[str], **environment: str) -> CommandCost:
    """Run a command without its output, in the folder of temporary files: no module of this folder is taken for an installed one.

    Raises
    ------
    InputError: it fails.
    """
    begin = perf_counter()
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=tempfile.gettempdir(),
        env={**users_environment(), **environment},
    )
    peak = 0.0
    done, status, used = os.wait4(process.pid, os.WNOHANG)
    while not done:
        peak = max(peak, _peak_mb(process.pid))
        sleep(BETWEEN_LOOKS)
        done, status, used = os.wait4(process.pid, os.WNOHANG)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise InputError(f"'{' '.join(command)}' ends with exit code {process.returncode}; run it by itself")
    # the system counts what this process held when it started the command among the command's own largest set
    return CommandCost(perf_counter() - begin, used.ru_utime + used.ru_stime, peak or used.ru_maxrss / 1024)


def _peak_mb(pid: int) -> float:
    """Largest resident set so far of a process that runs, MB; 0 where the system does not say."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), 0.0)


def use_one_thread(module: str) -> None:
    """Restart a module with one thread per library.

    Linear algebra libraries read these variables only when they are loaded.
    """
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        os.environ.update(ONE_THREAD)
        os.execv(sys.executable, [sys.executable, "-m", module, *sys.argv[1:]])


def machine() -> str:
    """Processor, vector width, compiler and Python, on which times depend."""
    vectors = f"vectors of {LANES} numbers ({64 * LANES} bits)"
    return f"{_processor_name()}, {os.cpu_count()} cores, {vectors}, {_compiler()}, Python {platform.python_version()}"


def _processor_name() -> str:
    """What the system calls the processor, else the architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def _compiler() -> str:
    """First line that the C compiler prints of itself."""
    command = compiler()
    return "no compiler" if command is None else compiler_version(command)
