"""Batch solutions from one trial: optima, times and single iterations, ours and peers'."""

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from experiments.benchmarks.ceres_peer import ceres_batch, ceres_iterations, ceres_library
from experiments.benchmarks.floor import floor_seconds, least_multiply_adds
from experiments.benchmarks.gtsam_chart import gtsam
from experiments.benchmarks.gtsam_peer import GtsamLinearSystem, LinearTime, dogleg, levenberg_marquardt
from experiments.benchmarks.own_smoother import OwnIterations, own_batch
from experiments.benchmarks.scipy_peer import scipy_least_squares
from experiments.benchmarks.smoother_checks import BenchmarkCheck, Ratio, Solver, in_turn, ratio, ratio_of
from experiments.benchmarks.smoother_workload import PeerResult, Workload
from spinfilters.core.c_library import compiler

SAME_OPTIMUM: Final = 0.05
"""Of the cost."""
OVER_CERES: Final = 8.0
OVER_GTSAM: Final = 24.0
OVER_SCIPY: Final = 65.0
FLOOR_BARS: Final = {20: 3.0, 115: 1.8}
"""At most, by number of frames."""
CERES, GTSAM, FLOOR = "ceres", "gtsam", "floor"
FLOOR_RUNS: Final = 5
ITERATION_BARS: Final = {10: 10.0, 20: 10.0, 40: 10.0, 115: 7.0}
"""By number of frames."""
ITERATION_RUNS: Final = 5
"""Of ours in a turn; GTSAM, which takes longer, has `PEER_RUNS`."""
PEER_RUNS: Final = 2


def optimum(make: Callable[[int], Workload], seeds: int, what: str) -> BenchmarkCheck:
    """Final costs on some seeds against the better of two GTSAM solvers."""
    above, damped = [], []
    for seed in range(seeds):
        workload = make(seed)
        ours, lm = own_batch(workload).cost, levenberg_marquardt(workload).cost
        above.append(ours - min(lm, dogleg(workload).cost))
        damped.append(ours - lm)
    spread = f"ours - GTSAM's best of LM and dogleg: {min(above):+.4f} .. {max(above):+.4f}"
    note = f"LM alone: {min(damped):+.4f} .. {max(damped):+.4f}"
    return BenchmarkCheck(what, spread, f"at most {SAME_OPTIMUM}", max(above) <= SAME_OPTIMUM, note)


def batch(workload: Workload, rounds: int, what: str, peers: bool) -> Iterator[BenchmarkCheck]:
    """Times to the optimum."""
    solvers: dict[str, Solver] = {"ours": lambda: own_batch(workload)}
    if peers and ceres_library() is not None:
        solvers["ceres"] = lambda: ceres_batch(workload)
        ceres_batch(workload)
    if peers:
        solvers["scipy"] = lambda: scipy_least_squares(workload)
    if peers and gtsam is not None:
        solvers["gtsam"] = lambda: levenberg_marquardt(workload)
        solvers["dogleg"] = lambda: dogleg(workload)
    own_batch(workload)
    found = in_turn(solvers, rounds)
    ours = found.pop("ours")
    yield BenchmarkCheck(what, f"{1e3 * ours[0].seconds:8.2f} ms", note=_where(ours[0]))
    bars = {
        "ceres": ("Ceres SPARSE_SCHUR", OVER_CERES),
        "gtsam": ("GTSAM LM", OVER_GTSAM),
        "scipy": ("SciPy analytic", OVER_SCIPY),
    }
    for name, (title, bar) in bars.items():
        if name in found:
            yield ratio_of(found[name], ours).check(f"  over {title}", bar, _where(found[name][0]))
    if "dogleg" in found:
        speed = ratio_of(found["dogleg"], ours)
        yield BenchmarkCheck("  over GTSAM dogleg", str(speed), note=_where(found["dogleg"][0]))


def iterations(workload: Workload, rounds: int, peers: bool) -> Iterator[BenchmarkCheck]:
    """One iteration, linearising and solving, by number of frames; of Ceres one with the cost of its trial."""
    for epochs, bar in ITERATION_BARS.items():
        if epochs > len(workload.timeline):
            return
        part = workload.first(epochs)
        times = iteration_times(part, rounds, peers)
        ours, what = times.pop("ours"), f"one iteration, {epochs} frames"
        if GTSAM in times:
            yield _over(times[GTSAM], ours).check(what, bar, "GTSAM's fastest ordering")
        else:
            yield BenchmarkCheck(what, f"{1e3 * float(np.median(ours[0])):8.2f} ms")
        if CERES in times:
            yield BenchmarkCheck("  over Ceres", str(_over(times[CERES], ours)))
        if FLOOR in times:
            floor, most = ratio(ours[0], times[FLOOR][0]), FLOOR_BARS.get(epochs)
            spread = f"{floor.value:.1f}x ({floor.least:.1f} .. {floor.greatest:.1f})"
            told = f"{1e3 * floor.ours:8.2f} ms, ours {1e3 * floor.theirs:8.2f} ms: {spread}"
            note = f"{2e-6 * least_multiply_adds(part):.1f} Mflop"
            bars = ("", None) if most is None else (f"at most {most:g}x", floor.value <= most)
            yield BenchmarkCheck("  over the floor", told, *bars, note)


Times = tuple[list[float], list[float]]
"""Seconds of an iteration, and of these in our Python, by round."""


def iteration_times(part: Workload, rounds: int, peers: bool) -> dict[str, Times]:
    """Of "ours", `GTSAM`, `CERES` and `FLOOR`, as far as they run here."""
    mine, adds = OwnIterations(part), least_multiply_adds(part)
    runs: dict[str, Callable[[], tuple[float, float]]] = {"ours": lambda: (mine.seconds(ITERATION_RUNS), 0.0)}
    if compiler() is not None:
        runs[FLOOR] = lambda: (floor_seconds(adds, FLOOR_RUNS), 0.0)
    if peers and gtsam is not None:
        system = GtsamLinearSystem(part)
        system.times(1)
        runs[GTSAM] = lambda: _fastest(system.times(PEER_RUNS))
    if peers and ceres_library() is not None:
        runs[CERES] = lambda: ceres_iterations(part)
    times: dict[str, Times] = {name: ([], []) for name in runs}
    for number in range(rounds):
        for name in list(runs)[:: 1 if number % 2 == 0 else -1]:
            for row, seconds in zip(times[name], runs[name](), strict=True):
                row.append(seconds)
    return times


def _over(theirs: Times, ours: Times) -> Ratio:
    return ratio(theirs[0], ours[0], theirs[1])


def _fastest(times: list[LinearTime]) -> tuple[float, float]:
    best = min(times, key=lambda time: time.total)
    return best.total, best.python


def _where(result: PeerResult) -> str:
    return f"{result.linearisations:.0f} lin., cost {result.cost:.3f}"
