"""Time to the first picture: `spinfilters compare` of the bundled example in a new process.

    python -m experiments.benchmarks.first_picture [--runs 3] [--packages FOLDER] [--no-fresh]

A fresh run has an empty cache of compiled code, a warm one what the fresh one left there. Both write all figures. Wall time is what
a user waits for and needs two quiet cores; processor time is printed beside it. For a wheel with compiled libraries give the folder
that `pip install --no-deps --target FOLDER WHEEL` has filled.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

from experiments.benchmarks.stopwatch import CommandCost, begin_benchmark, cost_of_command
from experiments.command_line import run_study


class PictureTimes(NamedTuple):
    """A run's cost, and seconds of the clock until its first figure was written."""

    first: float
    whole: CommandCost

    def __str__(self) -> str:
        return f"first picture {self.first:.1f} s, all {self.whole.wall:.1f} s, processor {self.whole.processor:.1f} s"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3, help="warm ones, of which the median is taken")
    parser.add_argument("--packages", type=Path, help="folder with an installed wheel")
    parser.add_argument("--fresh", action=argparse.BooleanOptionalAction, default=True)
    given = parser.parse_args()
    begin_benchmark("experiments.benchmarks.first_picture", "wall and processor", "processes of one thread")
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        if given.fresh:
            print(f"fresh: {picture_times(cache, given.packages)}", flush=True)
        else:
            picture_times(cache, given.packages)
        print(f"warm: {warm_times(cache, given.packages, given.runs)}")


def warm_times(cache: Path, packages: Path | None, runs: int) -> PictureTimes:
    """Medians over some runs with a cache that another run has filled."""
    first, whole = zip(*[picture_times(cache, packages) for _ in range(runs)], strict=True)
    return PictureTimes(median(first), CommandCost(*map(median, zip(*whole, strict=True))))


def picture_times(cache: Path, packages: Path | None) -> PictureTimes:
    """One run with a cache folder."""
    where = {} if packages is None else {"PYTHONPATH": str(packages.resolve())}
    with tempfile.TemporaryDirectory() as folder:
        run, begin = Path(folder) / "run", time.time()
        command = [sys.executable, "-m", "spinfilters", "compare", "-q", "-o", str(run)]
        whole = cost_of_command(command, SPINFILTERS_CACHE=str(cache.resolve()), **where)
        return PictureTimes(min(file.stat().st_mtime for file in run.rglob("*.png")) - begin, whole)


if __name__ == "__main__":
    run_study(main)
