"""Time of a new process to its first result.

Imports, then a first solution with models compiled before, or with none.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from experiments.benchmarks.smoother_checks import BenchmarkCheck
from experiments.benchmarks.smoother_workload import NOISE, Workload
from experiments.benchmarks.stopwatch import users_environment

IMPORT_SECONDS: Final = 0.7
WARM_SECONDS: Final = 2.0
COLD_SECONDS: Final = 15.0
STARTS: Final = 3
"""New processes for each time but the compiling one."""
COMMAND: Final = "spinfilters.run.estimators, spinfilters.run.readers"
"""What ``compare`` imports before it reads a recording."""
ENGINE: Final = "spinfilters.smoother.sliding_smoother"
TIMED_IMPORT: Final = "from time import perf_counter as t; a = t(); import {}; print(t() - a)"


def cold_start(workload: Workload) -> Iterator[BenchmarkCheck]:
    """Import and run times in new processes."""
    for module, title in ((COMMAND, "the command"), (ENGINE, "the smoother")):
        _import_seconds(module)  # writes bytecode and reads files from disk
        seconds = float(np.median([_import_seconds(module) for _ in range(STARTS)]))
        bar = f"below {IMPORT_SECONDS:g} s" if module == COMMAND else ""
        passed = seconds < IMPORT_SECONDS if module == COMMAND else None
        yield BenchmarkCheck(f"import of {title}", f"{seconds:8.3f} s", bar, passed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "workload.npz"
        _write(workload, file)
        _first_solve(file, None)
        warm = np.median([_first_solve(file, None) for _ in range(STARTS)], axis=0)
        yield _check("first solution of a process, compiled before", warm, WARM_SECONDS)
        empty = Path(folder) / "empty"
        yield _check("first solution, nothing compiled", _first_solve(file, empty), COLD_SECONDS)


def _check(what: str, seconds: np.ndarray, bar: float) -> BenchmarkCheck:
    imported, built, solved, slid = seconds
    measured = f"{solved:8.3f} s, of it imports {imported:.3f}, reading frames {built - imported:.3f}"
    return BenchmarkCheck(
        what, f"{measured}; sliding's first 3 frames {slid - solved:.3f}", f"below {bar:g} s", solved < bar
    )


def _import_seconds(module: str) -> float:
    return float(_output([sys.executable, "-c", TIMED_IMPORT.format(module)], users_environment()))


def _first_solve(file: Path, cache: Path | None) -> np.ndarray:
    """Seconds since the first import, after each stage; see `first_solve`."""
    environment = users_environment()
    if cache is not None:
        environment["SPINFILTERS_CACHE"] = str(cache)
    command = [sys.executable, "-m", "experiments.benchmarks.first_solve", str(file)]
    return np.array(json.loads(_output(command, environment).splitlines()[-1])[:4])


def _output(command: list[str], environment: dict[str, str]) -> str:
    """Standard output of a new process."""
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout


def _write(workload: Workload, file: Path) -> None:
    """Write the problem's arrays."""
    measured = [(frame.time, m) for frame in workload.timeline for m in frame.measurements]
    ids = [m.ids for _, m in measured if m.ids is not None]
    np.savez(
        file,
        time=np.concatenate([np.full(len(m.values), time) for time, m in measured]),
        pixels=np.concatenate([m.values for _, m in measured]),
        ids=np.concatenate(ids),
        calibration=workload.calibration,
        psd=np.array([NOISE.force_psd, NOISE.torque_psd]),
        mean=workload.prior.mean,
        std=workload.prior.std,
        trajectory=workload.trial.trajectory,
        landmarks=workload.trial.ids,
        points=workload.trial.points,
    )
