"""Ceres, GTSAM and SciPy on the smoothing problem.

Optima by one cost, and times of one thread with what our own Python has of them.
    python -m experiments.benchmarks.smoother_peers [--motion rich] [--seeds 1] [--share 1] [--incremental] [--lag 20]

Batch solutions from the closed form's trial, and one Gauss-Newton iteration of GTSAM at several numbers of frames. With
`--incremental` also the solvers that go frame by frame: a minute or two for each seed.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from experiments.benchmarks import ceres_peer
from experiments.benchmarks.ceres_peer import ceres_batch, ceres_library
from experiments.benchmarks.gtsam_chart import MISSING, gtsam
from experiments.benchmarks.gtsam_incremental import fixed_lag, isam2, resolved_every_frame
from experiments.benchmarks.gtsam_peer import (
    LinearTime,
    ceres_like,
    dogleg,
    levenberg_marquardt,
    linear_times,
)
from experiments.benchmarks.scipy_peer import scipy_least_squares
from experiments.benchmarks.smoother_workload import MOTIONS, PeerResult, Workload, disam115_workload
from experiments.benchmarks.stopwatch import begin_benchmark
from experiments.command_line import run_study

Peer = Callable[[Workload], PeerResult]
ITERATION_FRAMES: Final = (10, 20, 40, 115)
FINE_THRESHOLD: Final = 0.01
"""Of ISAM2, beside its default: nearer to the optimum."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--motion", choices=sorted(MOTIONS), default="rich")
    parser.add_argument("--seeds", type=int, default=1, help="recordings, seeds 0, 1 ..")
    parser.add_argument("--share", type=float, default=1.0, help="of the closed form's body in the trial")
    parser.add_argument("--incremental", action="store_true", help="also solvers that go frame by frame")
    parser.add_argument("--lag", type=int, default=20, help="frames of the window of fixed lag")
    options = parser.parse_args(arguments)
    begin_benchmark("experiments.benchmarks.smoother_peers")
    if gtsam is None:
        print(MISSING)
    if ceres_library() is None:
        print(ceres_peer.MISSING)
    for seed in range(options.seeds):
        workload = disam115_workload(options.motion, seed).nearer_to_a_sphere(options.share)
        print(_headline(options.motion, seed, workload))
        for result in results(workload, peers(options.incremental, options.lag)):
            print(described(result), flush=True)
        if gtsam is not None and seed == 0:
            for time in linear_times(workload, ITERATION_FRAMES):
                print(described_iteration(time), flush=True)


def peers(incremental: bool, lag: int) -> list[Peer]:
    """Peer solvers that this machine can run."""
    batch: list[Peer] = [scipy_least_squares]
    if ceres_library() is not None:
        batch.insert(0, ceres_batch)
    if gtsam is not None:
        batch = [levenberg_marquardt, ceres_like, dogleg, *batch]
    if gtsam is None or not incremental:
        return batch
    return [
        *batch,
        resolved_every_frame,
        isam2,
        lambda workload: isam2(workload, FINE_THRESHOLD),
        lambda workload: fixed_lag(workload, lag),
    ]


def results(workload: Workload, chosen: Sequence[Peer]) -> Iterator[PeerResult]:
    """Results of the peers, one after the other.

    The compiled functions are called once before, so that no peer waits for a compiler.
    """
    scipy_least_squares(workload.first(4))
    for peer in chosen:
        yield peer(workload)


def described(result: PeerResult) -> str:
    """Line of the table for one solver."""
    rounds = f"{result.linearisations:6.1f} linearisations" if result.linearisations else " " * 21
    return (
        f"{result.name:30} cost {result.cost:13.3f}   {result.seconds:7.3f} s, "
        f"{result.python:6.3f} s in our Python   {rounds}"
    )


def described_iteration(time: LinearTime) -> str:
    """Line of the table for single iterations."""
    return (
        f"GTSAM, {time.epochs:3} frames, {time.ordering:15}  linearise {1e3 * time.linearise:6.1f} ms "
        f"({1e3 * time.python:5.1f} in our Python), solve {1e3 * time.solve:6.1f}, together {1e3 * time.total:6.1f}"
    )


def _headline(motion: str, seed: int, workload: Workload) -> str:
    return (
        f"{motion} motion, seed {seed}: {len(workload.timeline)} frames, {len(workload.trial.ids)} landmarks, "
        f"{len(workload.observations.epoch)} observations"
    )


if __name__ == "__main__":
    run_study(main)
