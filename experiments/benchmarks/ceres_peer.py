"""Ceres on the whole smoothing problem, from the trial by Levenberg-Marquardt, with landmarks eliminated first (SPARSE_SCHUR).

The text for it is `ceres_peer.cpp`, built here once where Ceres and a C++ compiler are installed. Derivatives of observations are
written out in C++. The whitened rows of prior and motion are the project's own for all steps at once, in which Ceres has a fast
part that it need not differentiate; their time is counted apart as "python". Costs are twice those that Ceres prints.
"""

import ctypes
import hashlib
import os
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.gtsam_chart import CENTRE, RATES
from experiments.benchmarks.smoother_workload import PIXEL_STD, PeerResult, Workload, whitened_cost
from experiments.benchmarks.stopwatch import now
from spinfilters.core.errors import InputError
from spinfilters.smoother.motion_factors import prior_rows
from spinfilters.smoother.problem import with_common_constants

SOURCE: Final = Path(__file__).with_suffix(".cpp")
FOLDER: Final = Path("build/benchmarks")
FLAGS: Final = ("-O3", "-march=native", "-DNDEBUG", "-std=c++17", "-shared", "-fPIC", "-fvisibility=hidden")
EIGEN: Final = ("/usr/include/eigen3", "/usr/local/include/eigen3", "/opt/homebrew/include/eigen3")
MISSING: Final = (
    "the peer Ceres is not installed; on Debian and Ubuntu type 'sudo apt-get install g++ libceres-dev libopenblas0-serial' "
    "(2.1 was measured), or leave this peer out"
)
RELATIVE_TOLERANCE: Final = 1e-6
"""Of the cost, by which an iteration must improve it: as for GTSAM."""
ITERATIONS: Final = 200
TIMED_ITERATIONS: Final = 6
"""Of one solution whose single iterations are timed."""
POSE: Final = slice(0, 7)
_MAKE_ROWS = ctypes.CFUNCTYPE(None)


class _Data(ctypes.Structure):
    """`Data` of the C++ text."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("epochs", "landmarks", "observations")),
        *((name, ctypes.c_void_p) for name in ("epoch", "landmark", "pixels", "camera")),
        *((name, ctypes.c_double) for name in ("pixel_std", "tolerance")),
        ("iterations", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("poses", "rates", "constants", "points", "prior", "steps")),
        ("make_rows", _MAKE_ROWS),
    )


class _Found(ctypes.Structure):
    """`Found` of the C++ text."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("iterations", "steps", "usable")),
        *((name, ctypes.c_double) for name in ("initial_cost", "final_cost")),
        *((name, ctypes.c_double) for name in ("jacobian_seconds", "residual_seconds", "linear_seconds")),
    )


@cache
def ceres_library() -> ctypes.PyDLL | None:
    """The compiled text, built where that was not done before; None where Ceres or a C++ compiler is missing."""
    compiler = shutil.which(os.environ.get("CXX", "c++"))
    if compiler is None:
        return None
    key = hashlib.sha256("\0".join((SOURCE.read_text(), compiler, *FLAGS)).encode()).hexdigest()[:24]
    built = FOLDER / f"{SOURCE.stem}-{key}.so"
    if not built.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        scratch = built.with_suffix(f".{os.getpid()}")
        folders = [f"-I{folder}" for folder in EIGEN]
        command = [compiler, *FLAGS, *folders, str(SOURCE), "-o", str(scratch), "-lceres", "-lglog"]
        if subprocess.run(command, check=False, capture_output=True).returncode:
            return None
        scratch.replace(built)
    library = ctypes.PyDLL(str(built.resolve()))
    library.ceres_version.restype = ctypes.c_char_p
    return library


def ceres_name() -> str:
    """Version of the library, and the BLAS that its sparse solver has."""
    library = _required()
    mapped = Path("/proc/self/maps")
    lines = mapped.read_text().splitlines() if mapped.exists() else []
    blas = {line.split()[-1] for line in lines if "/libblas.so" in line}
    return f"Ceres {library.ceres_version().decode()}, BLAS {', '.join(sorted(blas)) or 'unknown'}"


def ceres_batch(workload: Workload) -> PeerResult:
    """Batch solution from the trial."""
    solver = CeresProblem(workload)
    solution = solver.solve(ITERATIONS, RELATIVE_TOLERANCE)
    trajectory, points = solver.trajectory(), solver.points
    cost = whitened_cost(workload, trajectory, points)
    iterations, steps = solution.iterations, 1.0 + solution.steps
    return PeerResult(
        "Ceres SPARSE_SCHUR", trajectory, points, cost, solution.seconds, solver.seconds, iterations, steps
    )


def ceres_iterations(workload: Workload) -> tuple[float, float]:
    """Median seconds of an iteration, and what our Python has of it: solve, evaluate, linearise at the new point."""
    solver = CeresProblem(workload)
    solution = solver.solve(TIMED_ITERATIONS, 0.0)
    return float(np.median(solution.each)), solver.seconds / (1 + len(solution.each))


@dataclass(frozen=True)
class CeresSolution:
    """What a call of Ceres found, and how long it took.

    Attributes
    ----------
    seconds: of the whole call, by the clock of `stopwatch`.
    each: of single iterations, processor time.
    """

    seconds: float
    each: Float[np.ndarray, " i"]
    iterations: int
    steps: int


class CeresProblem:
    """A workload's parameters, whose memory Ceres writes to, and the rows of its motion about them.

    Constants are errors about those of the trial: Ceres adds to them, and the reset Jacobian stands between rows and errors.
    """

    def __init__(self, workload: Workload) -> None:
        self.seconds = 0.0
        self._library = _required()
        self._workload, self._factors = workload, workload.problem().motion
        start = with_common_constants(workload.layout, workload.trial.trajectory)
        seen = workload.observations
        self._start = start[0].copy()
        self._poses, self._rates = start[:, POSE].copy(), start[:, RATES].copy()
        self._errors, self.points = np.zeros(8), workload.trial.points.copy()
        self._prior, self._steps = np.zeros((20, 21)), np.zeros((len(start) - 1, 12, 33))
        self._inputs = [
            np.ascontiguousarray(seen.epoch, dtype=np.int64),
            np.ascontiguousarray(seen.landmark, dtype=np.int64),
            np.ascontiguousarray(workload.values),
            np.ascontiguousarray(workload.calibration),
        ]

    def trajectory(self) -> Float[np.ndarray, "k m"]:
        """States at the present parameters."""
        errors = np.zeros(self._workload.layout.error_dim)
        errors[12:] = self._errors
        constants = self._workload.layout.retract(self._start, errors)[CENTRE.start :]
        return np.hstack([self._poses, self._rates, np.tile(constants, (len(self._poses), 1))])

    def solve(self, iterations: int, tolerance: float) -> CeresSolution:
        """Iterations from the present parameters on."""
        own = (self._poses, self._rates, self._errors, self.points, self._prior, self._steps)
        sizes = (len(self._poses), len(self.points), len(self._inputs[0]))
        addresses = [array.ctypes.data for array in self._inputs]
        make = _MAKE_ROWS(self._make_rows)
        places = [array.ctypes.data for array in own]
        data = _Data(*sizes, *addresses, PIXEL_STD, tolerance, iterations, *places, make)
        found, times = _Found(), np.full(iterations + 1, np.nan)
        begin = now()
        self._library.ceres_solve(ctypes.byref(data), ctypes.byref(found), ctypes.c_void_p(times.ctypes.data))
        seconds = now() - begin
        if not found.usable:
            raise InputError("Ceres found no solution that it calls usable; this problem cannot be compared")
        each = np.diff(times[np.isfinite(times)])
        return CeresSolution(seconds, each, int(found.iterations), int(found.steps))

    def _make_rows(self) -> None:
        """Rows of prior and steps at the present parameters."""
        begin = now()
        trajectory, layout = self.trajectory(), self._workload.layout
        errors = np.zeros(layout.error_dim)
        errors[12:] = self._errors
        reset = layout.reset_jacobian(errors)[12:, 12:]
        self._prior[:] = prior_rows(self._factors.ordering, trajectory[0], self._workload.prior)
        self._steps[:] = self._factors.dynamics(trajectory).rows
        self._prior[:, 12:-1] = self._prior[:, 12:-1] @ reset
        self._steps[:, :, 24:-1] = self._steps[:, :, 24:-1] @ reset
        self.seconds += now() - begin


def _required() -> Any:
    """The library.

    Raises
    ------
    InputError: it cannot be built here.
    """
    library = ceres_library()
    if library is None:
        raise InputError(MISSING)
    return library
