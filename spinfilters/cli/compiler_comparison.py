"""C compilers of this machine side by side: the same small comparison with kernels and models that each of them built.

    python -m spinfilters.cli.compiler_comparison

computes that comparison with the compiler of ``$CC`` and prints its times and estimates as JSON. `measure` runs it in a process and
an empty cache folder of its own, since a process loads libraries once.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from spinfilters.core.c_library import COMPILERS, compiler_version
from spinfilters.core.shipped_libraries import has_libraries

EPOCHS: Final[int] = 20
WARM_RUNS: Final[int] = 2
MOST_SECONDS: Final[float] = 600.0
TOLERANCE: Final[float] = 0.01
"""Of the standard deviation: kernels of linear algebra may add in another order, and iterations amplify that."""


@dataclass(frozen=True)
class CompilerTimes:
    """What one compiler's code took.

    Attributes
    ----------
    command : str
        Path of the compiler; empty where nothing is compiled.
    version : str
        First line that it prints of itself.
    first, warm : float
        Processor time of the first comparison, compiling included, and the least of the later ones, s.
    estimates : ndarray, (n,)
        Last state of each estimator from the layout's origin, in standard deviations of the smoother.
    failure : str
        Why there are no times, else empty.
    """

    command: str
    version: str
    first: float
    warm: float
    estimates: np.ndarray
    failure: str = ""


def installed_compilers() -> list[str]:
    """Paths of the different C compilers of this machine, that of ``$CC`` first."""
    found: dict[Path, str] = {}
    for name in (os.environ.get("CC"), *COMPILERS, "icx"):
        if name and (path := shutil.which(name)):
            found.setdefault(Path(path).resolve(), path)
    return list(found.values())


def compare_compilers() -> Iterator[CompilerTimes]:
    """Times of the wheel's libraries where it has any, of each compiler, and of nothing compiled, one after another."""
    if has_libraries():
        yield measure("", "on", "libraries of this installation")
    for command in installed_compilers():
        yield measure(command, "here", _version(command))
    yield measure("", "off", "nothing compiled")


def measure(command: str, mode: str, version: str) -> CompilerTimes:
    """Run the comparison with this compiler as ``$CC`` and this ``$SPINFILTERS_COMPILE``."""
    with TemporaryDirectory() as folder:
        own = {"SPINFILTERS_CACHE": folder, "SPINFILTERS_COMPILE": mode, "CC": command}
        call = [sys.executable, "-P", "-m", "spinfilters.cli.compiler_comparison"]
        try:
            done = subprocess.run(
                call,
                env={**os.environ, **own, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                capture_output=True,
                text=True,
                errors="replace",
                timeout=MOST_SECONDS,
                check=True,
            )
            found = json.loads(done.stdout)
        except subprocess.CalledProcessError as error:
            lines = error.stderr.strip().splitlines() or [f"exit code {error.returncode}"]
            return CompilerTimes(command, version, np.nan, np.nan, np.zeros(0), lines[-1])
        except (OSError, subprocess.SubprocessError, ValueError) as error:
            return CompilerTimes(command, version, np.nan, np.nan, np.zeros(0), str(error)[:200])
    failure = "" if found["compiled"] or mode == "off" else "its libraries cannot be built or loaded"
    return CompilerTimes(
        command, version, found["first"], found["warm"], np.array(found["estimates"]), failure
    )


def agree(one: CompilerTimes, other: CompilerTimes) -> bool:
    """Whether two compilers' estimates are equal to rounding, as a hundredth of their standard deviations counts."""
    return one.estimates.shape == other.estimates.shape and bool(
        np.all(np.abs(one.estimates - other.estimates) <= TOLERANCE)
    )


def _version(command: str) -> str:
    try:
        return compiler_version(command)
    except (OSError, subprocess.SubprocessError):
        return "does not run"


def _processor_time() -> float:
    """Of this process and of the compilers that it started, s."""
    return sum(os.times()[:4])


def compare_here() -> Mapping[str, object]:
    """Times and estimates of a small comparison with stereo tracks in this process."""
    from spinfilters.api.comparison import compare
    from spinfilters.simulation.scenario import Scenario, simulate
    from spinfilters.smoother.kernels import kernels

    dataset = simulate(Scenario.simplified(kind="stereo-tracks", epochs=EPOCHS))
    times, run = [], None
    for _ in range(1 + WARM_RUNS):
        begin = _processor_time()
        run = compare(dataset, ("mekf", "smoother"), no_figures=True)
        times.append(_processor_time() - begin)
    assert run is not None
    histories = [each.evaluation.history for each in run.values()]
    deviations = np.linalg.norm(histories[-1].factor[-1], axis=1)
    layout = histories[-1].layout
    estimates = [layout.local(layout.origin(), each.mean[-1]) / deviations for each in histories]
    return {
        "compiled": kernels() is not None,
        "first": times[0],
        "warm": min(times[1:]),
        "estimates": np.concatenate(estimates).tolist(),
    }


if __name__ == "__main__":
    print(json.dumps(compare_here()))
