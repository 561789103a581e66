"""Frame after frame, ours beside GTSAM: everything solved again, and a window of fixed lag."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from experiments.benchmarks.gtsam_chart import gtsam
from experiments.benchmarks.gtsam_incremental import fixed_lag, isam2, resolved_every_frame
from experiments.benchmarks.own_smoother import own_batch, own_resolved, own_window
from experiments.benchmarks.smoother_checks import BenchmarkCheck, Solver, in_turn, ratio_of
from experiments.benchmarks.smoother_workload import PeerResult, Workload
from spinfilters.smoother.window import smallest_batch

NEAR_OPTIMUM: Final = 0.5
"""Of the cost."""
WHOLE_SECONDS: Final = 3.0
"""For all frames."""
OVER_RESOLVED: Final = 15.0
OVER_ISAM2: Final = 16.0
LAG: Final = 20
OVER_WINDOW: Final = 100.0


def resolved(workload: Workload, rounds: int, peers: bool) -> Iterator[BenchmarkCheck]:
    """Re-solving of everything after each epoch."""
    solvers: dict[str, Solver] = {"ours": lambda: own_resolved(workload)}
    if peers and gtsam is not None:
        solvers["lm"] = lambda: resolved_every_frame(workload)
        solvers["isam2"] = lambda: isam2(workload)
    own_resolved(workload)
    optimum = own_batch(workload).cost
    found = in_turn(solvers, rounds)
    ours, epochs = found["ours"], len(workload.timeline)
    what = f"solved again after each of {epochs} frames"
    seconds = float(np.median([result.seconds for result in ours]))
    note = f"{ours[0].linearisations:.0f} linearisations"
    yield BenchmarkCheck(
        what, f"{seconds:8.3f} s", f"at most {WHOLE_SECONDS:g} s", seconds <= WHOLE_SECONDS, note
    )
    above = ours[0].cost - optimum
    yield BenchmarkCheck(
        "  final cost over the batch's", f"{above:+.4f}", f"within {NEAR_OPTIMUM}", above <= NEAR_OPTIMUM
    )
    bars = {"lm": ("GTSAM LM per frame", OVER_RESOLVED), "isam2": ("ISAM2, 1 update", OVER_ISAM2)}
    for name, (title, bar) in bars.items():
        if name in found:
            more = f"final cost {found[name][0].cost - optimum:+.3f}"
            yield ratio_of(found[name], ours).check(f"  over {title}", bar, more)


def window(workload: Workload, rounds: int, peers: bool) -> Iterator[BenchmarkCheck]:
    """Fixed-lag smoothing of the latest epochs alone."""
    solvers: dict[str, Solver] = {"ours": lambda: own_window(workload, LAG)}
    if peers and gtsam is not None:
        solvers["gtsam"] = lambda: fixed_lag(workload, LAG)
    own_window(workload, LAG)
    best = own_batch(workload)
    found = in_turn(solvers, rounds)
    ours = found["ours"]
    what, off = f"window of {LAG} frames, all frames", _off(workload, ours[0], best)
    if "gtsam" not in found:
        yield BenchmarkCheck(what, f"{ours[0].seconds:8.3f} s", note=off)
        return
    told = own_window(workload, LAG, marginalized=True).seconds
    note = f"ours keeps up to {smallest_batch(LAG) - 1} more; with the covariance of frames that leave {1e3 * told:.0f} ms"
    yield ratio_of(found["gtsam"], ours).check(what, OVER_WINDOW, note)
    theirs = _off(workload, found["gtsam"][0], best)
    yield BenchmarkCheck("  latest frame off the batch", f"ours {off}; IncrementalFixedLag {theirs}")


def _off(workload: Workload, result: PeerResult, best: PeerResult) -> str:
    """Error of the last epoch: attitude, and the logarithm of second moments."""
    layout = workload.layout
    error = layout.local(best.trajectory[-1], result.trajectory[-1])
    turn = np.degrees(np.linalg.norm(error[layout.slice("a")]))
    return f"{turn:.3f} deg, body {np.linalg.norm(error[layout.slice('s')]):.4f}"
