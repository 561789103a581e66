"""Time of initialising and smoothing 115 epochs with a map.

It is measured in a warm process on one thread.
"""

import argparse
from statistics import median
from typing import Final

from experiments.benchmarks.stopwatch import CLOCKS, begin_benchmark, now
from experiments.command_line import run_study
from spinfilters.inference.smoother_run import smooth_at_once
from spinfilters.io.dataset import Dataset
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate

REPEATS: Final = 9
SETTINGS: Final = Settings(estimators=("smoother",))


def main() -> None:
    """Print medians in ms."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--clock", choices=tuple(CLOCKS), default="processor")
    begin_benchmark("experiments.benchmarks.known_map", parser.parse_args().clock)
    dataset = simulate(Scenario.simplified())
    seconds(dataset)  # compiles
    initialise, smooth = zip(*[seconds(dataset) for _ in range(REPEATS)], strict=True)
    print(f"115 epochs, known map: medians of {REPEATS}")
    print(f"initialise {1e3 * median(initialise):.0f} ms, smooth {1e3 * median(smooth):.0f} ms")


def seconds(dataset: Dataset) -> tuple[float, float]:
    """Times of initialising and of smoothing, s."""
    begin = now()
    setup = prepare(dataset, SETTINGS)
    middle = now()
    smooth_at_once(setup, SETTINGS, lambda done, total: None)
    return middle - begin, now() - middle


if __name__ == "__main__":
    run_study(main)
