"""Frames of the smoother on line: median and 99th percentile of their times, with the settings that a run has by default.

    python -m experiments.benchmarks.live_frames [--epochs 300] [--rounds 3] [--window 20]

The recording is the common workload in rich motion, tracks without a map. The smoother begins with the epochs of its
initialisation; every frame after these is predicted, added and solved. A frame's time is the median over rounds, so that the
percentile is of frames that are slow every time. With `--window` it keeps so many epochs at least, not what a run keeps by default.
"""

import argparse
import gc
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.stopwatch import begin_benchmark, now
from experiments.command_line import run_study
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import begin_after_initialisation, sliding_smoother
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings, SmootherSettings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

DEFAULT: Final = SmootherSettings()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--epochs", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--window", type=int, help="fewest epochs that are kept, in the mode of that name")
    given = parser.parse_args()
    begin_benchmark("experiments.benchmarks.live_frames")
    window = DEFAULT if given.window is None else SmootherSettings("window", given.window)
    seconds = frame_seconds(given.epochs, given.rounds, window)
    half, high, most = 1e3 * np.quantile(seconds, [0.5, 0.99, 1.0])
    print(
        f"{len(seconds)} frames: median {half:.1f} ms, 99th percentile {high:.1f} ms, longest {most:.1f} ms"
    )


def frame_seconds(epochs: int, rounds: int, options: SmootherSettings = DEFAULT) -> Float[np.ndarray, " n"]:
    """Median seconds of every frame behind the initialisation."""
    settings = Settings(estimators=("smoother",), smoother=options)
    dataset = simulate(replace(Scenario.common_workload(RICH_RPM), epochs=epochs))
    setup = prepare(dataset, settings)
    _pass(setup, settings)  # compiles
    return np.median([_pass(setup, settings) for _ in range(rounds)], axis=0)


def _pass(setup: Setup, settings: Settings) -> list[float]:
    """Seconds of every frame in one pass."""
    smoother, first = sliding_smoother(setup, settings), len(setup.initial.mean)
    begin_after_initialisation(smoother, setup)
    gc.collect()
    seconds = []
    for before, epoch in pairwise(setup.timeline[first - 1 :]):
        begin = now()
        smoother.predict(epoch.time - before.time)
        smoother.update_all(epoch.measurements)
        seconds.append(now() - begin)
    return seconds


if __name__ == "__main__":
    run_study(main)
