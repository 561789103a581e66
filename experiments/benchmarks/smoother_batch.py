"""Batch solutions from one trial: optima, times and single iterations, ours and peers'."""

from collections.abc import Callable, Iterator
from typing import Final

from experiments.benchmarks.gtsam_chart import gtsam
from experiments.benchmarks.gtsam_peer import GtsamLinearSystem, LinearTime, dogleg, levenberg_marquardt
from experiments.benchmarks.own_smoother import OwnIterations, own_batch
from experiments.benchmarks.scipy_peer import scipy_least_squares
from experiments.benchmarks.smoother_checks import BenchmarkCheck, Solver, in_turn, ratio, ratio_of
from experiments.benchmarks.smoother_workload import PeerResult, Workload

SAME_OPTIMUM: Final = 0.05
"""Of the cost."""
OVER_GTSAM: Final = 8.0
OVER_SCIPY: Final = 16.0
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
    if peers:
        solvers["scipy"] = lambda: scipy_least_squares(workload)
    if peers and gtsam is not None:
        solvers["gtsam"] = lambda: levenberg_marquardt(workload)
        solvers["dogleg"] = lambda: dogleg(workload)
    own_batch(workload)
    found = in_turn(solvers, rounds)
    ours = found.pop("ours")
    yield BenchmarkCheck(what, f"{1e3 * ours[0].seconds:8.2f} ms", note=_where(ours[0]))
    bars = {"gtsam": ("GTSAM LM", OVER_GTSAM), "scipy": ("SciPy analytic", OVER_SCIPY)}
    for name, (title, bar) in bars.items():
        if name in found:
            yield ratio_of(found[name], ours).check(f"  over {title}", bar, _where(found[name][0]))
    if "dogleg" in found:
        speed = ratio_of(found["dogleg"], ours)
        yield BenchmarkCheck("  over GTSAM dogleg", str(speed), note=_where(found["dogleg"][0]))


def iterations(workload: Workload, rounds: int, peers: bool) -> Iterator[BenchmarkCheck]:
    """One iteration, linearising and solving, by number of frames; of GTSAM's orderings the fastest."""
    for epochs, bar in ITERATION_BARS.items():
        if epochs > len(workload.timeline):
            return
        part = workload.first(epochs)
        what = f"one iteration, {epochs} frames"
        mine = OwnIterations(part)
        if not peers or gtsam is None:
            yield BenchmarkCheck(what, f"{1e3 * mine.seconds(ITERATION_RUNS):8.2f} ms")
            continue
        system = GtsamLinearSystem(part)
        system.times(1)
        ours, theirs = [], []
        for _ in range(rounds):
            ours.append(mine.seconds(ITERATION_RUNS))
            theirs.append(min(system.times(PEER_RUNS), key=lambda time: time.total))
        found = ratio([t.total for t in theirs], ours, [t.python for t in theirs])
        yield found.check(what, bar, _split(theirs[-1]))


def _split(time: LinearTime) -> str:
    return f"linearise {1e3 * time.linearise:.1f}, solve {1e3 * time.solve:.1f} ({time.ordering})"


def _where(result: PeerResult) -> str:
    return f"{result.linearisations:.0f} lin., cost {result.cost:.3f}"
