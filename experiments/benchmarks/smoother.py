"""Our smoother against Ceres, GTSAM and SciPy on the same problem, and one iteration against the floor.

In turn in one process with one thread, beside what it is to show.
    python -m experiments.benchmarks.smoother [--motion rich] [--repeats 5] [--no-peers] [--quick] [--long]

Every ratio is that of medians over rounds in which the solvers take turns; in brackets stand the least and greatest of one round,
and the "bare" ratio when the time is taken away that the peer spends in our own Python, from which it has the rows of the motion.
GTSAM's stereo factors, orderings and solvers are its own; `ceres_peer` and `floor` say what Ceres is given, and what the floor is.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version

from experiments.benchmarks import ceres_peer
from experiments.benchmarks.cold_start import cold_start
from experiments.benchmarks.gtsam_chart import MISSING, gtsam
from experiments.benchmarks.smoother_batch import batch, iterations, optimum
from experiments.benchmarks.smoother_checks import BenchmarkCheck
from experiments.benchmarks.smoother_long import long_run
from experiments.benchmarks.smoother_stream import resolved, window
from experiments.benchmarks.smoother_workload import MOTIONS, Workload, simulated_workload
from experiments.benchmarks.stopwatch import CLOCKS, begin_benchmark
from experiments.command_line import run_study
from spinfilters.simulation.scenario import Scenario

SEEDS = 5
"""Of the optima."""
STREAM_ROUNDS = 3
"""At most: a round of what goes frame by frame takes a minute."""
QUICK_FRAMES = 40
LONG_FRAMES = 10_000


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _options(arguments)
    begin_benchmark("experiments.benchmarks.smoother", options.clock)
    begin, missed = time.perf_counter(), 0
    if options.peers:
        print(MISSING if gtsam is None else f"GTSAM {version('gtsam')}")
        print(ceres_peer.MISSING if ceres_peer.ceres_library() is None else ceres_peer.ceres_name())
    for check in checks(options):
        print(check, flush=True)
        missed += check.passed is False
    print(f"\n{missed} bars missed; {time.perf_counter() - begin:.0f} s")


def checks(options: argparse.Namespace) -> Iterator[BenchmarkCheck]:
    """Benchmark checks one after the other."""
    if options.long:
        yield from long_run(options.long)
        return
    for motion in sorted(MOTIONS) if options.motion == "both" else [options.motion]:
        yield from of_motion(motion, options)
    yield from cold_start(_workload("rich", 0, options.quick))


def of_motion(motion: str, options: argparse.Namespace) -> Iterator[BenchmarkCheck]:
    """Checks of a motion without new processes and long runs."""
    peers, rounds = options.peers, 1 if options.quick else options.repeats
    workload = _workload(motion, 0, options.quick)
    yield BenchmarkCheck(f"\n{motion} motion", _size(workload), "bar")
    if peers and gtsam is not None:
        seeds = 1 if options.quick else SEEDS
        yield optimum(lambda seed: _workload(motion, seed, options.quick), seeds, f"optimum, {seeds} seeds")
    yield from batch(workload, rounds, "batch from the closed form", peers)
    if motion == "thesis":
        yield from batch(workload.nearer_to_a_sphere(0.0), rounds, "batch from a sphere", peers)
    yield from iterations(workload, rounds, peers)
    yield from resolved(workload, min(rounds, STREAM_ROUNDS), peers)
    yield from window(workload, min(rounds, STREAM_ROUNDS), peers)


def _workload(motion: str, seed: int, quick: bool) -> Workload:
    scenario = Scenario.common_workload(MOTIONS[motion], seed)
    return simulated_workload(replace(scenario, epochs=QUICK_FRAMES) if quick else scenario)


def _size(workload: Workload) -> str:
    return (
        f"{len(workload.timeline)} frames, {len(workload.trial.ids)} landmarks, "
        f"{len(workload.observations)} observations"
    )


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--motion", choices=[*sorted(MOTIONS), "both"], default="both")
    parser.add_argument("--repeats", type=int, default=5, help="rounds")
    parser.add_argument("--peers", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument(
        "--clock", choices=sorted(CLOCKS), default="processor", help="the wall's on quiet cores alone"
    )
    parser.add_argument("--quick", action="store_true", help="one round of a short recording: does it run?")
    parser.add_argument(
        "--long", type=int, nargs="?", const=LONG_FRAMES, help="only a run of so many frames: takes minutes"
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    run_study(main)
