"""Quick self-checks of this installation; each returns its measurement, or raises."""

from collections.abc import Callable
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Final, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core import attitude_conversions as conversions
from spinfilters.core.c_library import UNFINISHED, compiler, is_own_library, private_folder
from spinfilters.core.compiled import Compiled
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.timeline import SensorNoise, build_timeline, run
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import Verdict
from spinfilters.simulation.scenario import Scenario, simulate

REINSTALL: Final[str] = "install again (make clean, then make compare); if it stays, report it with this page"
CACHE_CURE: Final[str] = (
    "works without compiled code, but slower; for speed name a folder that only you can write to: "
    "mkdir -m 700 ~/spinfilters-cache; export SPINFILTERS_CACHE=~/spinfilters-cache"
)
ROUND_TRIP_TOLERANCE: Final[float] = 1e-13
"""A few hundred roundings of unit numbers, over four conversions."""
DIFFERENCE_STEP: Final[float] = 1e-5
DERIVATIVE_TOLERANCE: Final[float] = 1e-6
"""Central differences at that step miss by its square and by rounding over it: some 1e-10."""


class CheckError(Exception):
    """Check with a wrong result; the text holds the numbers."""


@dataclass(frozen=True)
class InstallationCheck:
    """One self-check.

    ``measure`` returns a short text of numbers or raises; ``cure`` is what to do then.
    """

    name: str
    measure: Callable[[], str]
    cure: str


def attitude_round_trip() -> str:
    """Quaternion to matrix, 4 x MRP, rotation vector and back, half turns included."""
    generator = np.random.default_rng(0)
    vectors = generator.standard_normal((50, 3))
    vectors *= np.concatenate([np.full(5, np.pi), generator.uniform(1e-9, 3.1, 45)])[:, None] / _norm(vectors)
    q = conversions.quaternion_from_rotation_vector(vectors)
    p = conversions.quaternion_from_matrix(conversions.matrix_from_quaternion(q))
    p = conversions.quaternion_from_mrp(conversions.mrp_from_quaternion(p))
    p = conversions.quaternion_from_rotation_vector(conversions.rotation_vector_from_quaternion(p))
    error = float(np.abs(p * np.sign(np.sum(p * q, axis=1, keepdims=True)) - q).max())
    return _describe_error(error, ROUND_TRIP_TOLERANCE, "largest error of a component")


def process_linearisation() -> str:
    """The process model's error transition against central differences of its own steps."""
    process, dt = TorqueFreeProcess(StateLayout(ROTATION_BLOCKS), ProcessNoise()), 0.1
    layout = process.layout
    x = layout.origin()
    x[layout.mean_slice("w")] = [0.4, 1.0, -0.3]
    x[layout.mean_slice("s")] = [0.3, -0.1, 0.05, -0.2, 0.1]
    after, transition, _ = process.linearise(x, dt)
    offsets = DIFFERENCE_STEP * np.eye(layout.error_dim)
    ahead = layout.local(after, process.step(layout.retract(x, offsets), dt))
    behind = layout.local(after, process.step(layout.retract(x, -offsets), dt))
    differences = ((ahead - behind) / (2 * DIFFERENCE_STEP)).T
    error = float(np.abs(transition - differences).max())
    return _describe_error(error, DERIVATIVE_TOLERANCE, "largest difference of an entry")


def filters_run() -> str:
    """Run both filters on two seconds of a simulated gyro, from a sphere at the first measured rate."""
    process = TorqueFreeProcess(StateLayout(ROTATION_BLOCKS), ProcessNoise())
    log = simulate(Scenario.simplified(kind="gyro", epochs=20, interval=0.1)).log
    timeline = build_timeline(log, process.layout, SensorNoise())
    mean = process.layout.origin()
    mean[process.layout.mean_slice("w")] = log.streams[0].values[0]
    belief = Gaussian(process.layout, mean, 0.1 * np.eye(process.layout.error_dim))
    filters: tuple[Estimator, ...] = (MultiplicativeEkf(process), MultiplicativeUkf(process))
    texts = []
    for estimator in filters:
        estimator.start(belief)
        history = run(estimator, timeline[0].time, timeline)
        finite = bool(np.isfinite(history.mean).all() and np.isfinite(history.factor).all())
        if history.status.verdict is not Verdict.OK or not finite:
            raise CheckError(f"{history.name}: {'; '.join(history.status.reasons) or 'not finite'}")
        texts.append(f"{history.name} {1e6 * float(np.median(history.runtime)):.0f} us")
    return f"per epoch: {', '.join(texts)}"


def figure_drawn() -> str:
    """A figure drawn without a screen, as PNG."""
    from matplotlib.figure import Figure  # here: broken drawing must not hide the other checks

    from spinfilters.plots.style import picture_bytes

    figure = Figure(figsize=(2, 1.5))
    figure.add_subplot().plot([0.0, 1.0], [0.0, 1.0])
    content = picture_bytes(figure, "png")
    if not content.startswith(b"\x89PNG"):
        raise CheckError(f"{len(content)} bytes that are no PNG")
    return f"{len(content)} bytes"


def cache_is_private() -> str:
    """Privacy of the cache folder, and loading of what is built there."""
    if compiler() is None:
        return "not needed without a compiler"
    folder = private_folder()
    with TemporaryDirectory(dir=folder, prefix=UNFINISHED):
        libraries = [is_own_library(path) for path in folder.glob("*.so")]
    x = ca.SX.sym("x")
    if not Compiled(ca.Function("cache", [x], [x + 1])).is_c:
        raise CheckError(f"{compiler()} fails, or files in {folder} may not be executed")
    text = f"yours alone, compiled functions: {sum(libraries)}"
    if all(libraries):
        return text
    return f"{text}; not used, for others could have written them: {len(libraries) - sum(libraries)}"


CHECKS: Final[tuple[InstallationCheck, ...]] = (
    InstallationCheck("attitude round trip", attitude_round_trip, REINSTALL),
    InstallationCheck("process linearisation", process_linearisation, REINSTALL),
    InstallationCheck("simulated EKF and UKF run", filters_run, REINSTALL),
    InstallationCheck("figure", figure_drawn, REINSTALL),
    InstallationCheck("cache folder", cache_is_private, CACHE_CURE),
)


class CompiledSpeed(NamedTuple):
    """Compiled code compared with CasADi's virtual machine: a library, equal bits, times as fast."""

    is_c: bool
    equal: bool
    speedup: float


def compare_with_virtual_machine() -> CompiledSpeed:
    """One small expression both ways, compiled where a compiler works (into the cache)."""
    x, A = ca.SX.sym("x", 6), ca.SX.sym("A", 6, 6)
    function = ca.Function("doctor", [x, A], [ca.sin(A @ x) / (1 + ca.sumsqr(x)), A @ A.T])
    compiled, interpreted = Compiled(function), Compiled.interpreted(function)
    generator = np.random.default_rng(0)
    arguments = generator.standard_normal((100, 6)), generator.standard_normal((100, 6, 6))
    equal = all(map(np.array_equal, compiled(*arguments), interpreted(*arguments)))
    single = arguments[0][0], arguments[1][0]
    return CompiledSpeed(compiled.is_c, equal, _seconds(interpreted, *single) / _seconds(compiled, *single))


def _seconds(function: Compiled, *arguments: np.ndarray) -> float:
    """The least of several measurements of 200 calls: whatever else runs on the machine only adds."""
    times = []
    for _ in range(5):
        begin = perf_counter()
        for _ in range(200):
            function(*arguments)
        times.append(perf_counter() - begin)
    return min(times)


def _describe_error(error: float, tolerance: float, what: str) -> str:
    if not error <= tolerance:
        raise CheckError(f"{what} {error:.1e}, allowed {tolerance:.0e}")
    return f"{what} {error:.1e}"


def _norm(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 1"]:
    return np.linalg.norm(vectors, axis=1, keepdims=True)
