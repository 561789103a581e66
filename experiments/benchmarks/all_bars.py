"""All speeds that are wanted, measured once on this machine: a table with the bar of each, and the command that gives it alone.

    python -m experiments.benchmarks.all_bars [--only batch filters] [--rounds 3] [--packages FOLDER] [--images FOLDER]

Solvers take turns, and ratios are of medians of processor times on one thread. Rates on two cores are runs per second of processor
time, twice; the campaign's own start is among it. Wall times need quiet cores. All of it takes a quarter of an hour on such a
machine. `--packages` is a folder with an installed wheel, see `first_picture`; without it the first picture is not measured.
"""

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np

from experiments.benchmarks.campaign import campaign_cost
from experiments.benchmarks.ceres_peer import MISSING as CERES_MISSING
from experiments.benchmarks.ceres_peer import ceres_batch, ceres_library
from experiments.benchmarks.filter_speed import PAIRS, speed_ratio, time_frames
from experiments.benchmarks.first_picture import picture_times, warm_times
from experiments.benchmarks.front_end import front_end_seconds
from experiments.benchmarks.gtsam_chart import MISSING as GTSAM_MISSING
from experiments.benchmarks.gtsam_chart import gtsam
from experiments.benchmarks.gtsam_incremental import fixed_lag, isam2
from experiments.benchmarks.gtsam_peer import levenberg_marquardt
from experiments.benchmarks.landmark_filters import BLOCKS, measure
from experiments.benchmarks.lidar_tracer import DISTANCES, MESHES, embreex_scene, tracing_times
from experiments.benchmarks.lidar_tracer import MISSING as EMBREE_MISSING
from experiments.benchmarks.live_frames import frame_seconds
from experiments.benchmarks.long_gyro import gyro_cost
from experiments.benchmarks.own_smoother import own_batch, own_resolved, own_window
from experiments.benchmarks.scipy_peer import scipy_least_squares
from experiments.benchmarks.smoother_batch import FLOOR, FLOOR_BARS, iteration_times
from experiments.benchmarks.smoother_checks import Solver, in_turn, ratio, ratio_of
from experiments.benchmarks.smoother_stream import LAG
from experiments.benchmarks.smoother_workload import disam115_workload
from experiments.benchmarks.stopwatch import begin_benchmark
from experiments.command_line import run_study
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate

STUDIES: Final = Path("experiments/studies")
CORES: Final = 2


@dataclass(frozen=True)
class Bar:
    """A speed beside what it is to be.

    Attributes
    ----------
    unit: of both numbers; "x" and "/s" are to be reached, all others not to be exceeded, except as `most` says.
    alone: command that measures it alone, behind ``python -m experiments.benchmarks.``.
    most: whether the number is not to be exceeded.
    """

    work: str
    value: float
    bar: float
    unit: str
    alone: str
    most: bool = False

    @property
    def met(self) -> bool:
        """Whether it is what it is to be."""
        return self.value <= self.bar if self.most else self.value >= self.bar

    def __str__(self) -> str:
        space = "" if self.unit == "x" else " "
        return (
            f"| {self.work} | {self.value:.3g}{space}{self.unit} | {self.bar:g}{space}{self.unit} | {'yes' if self.met else 'no'} "
            f"| `{self.alone}` |"
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=tuple(SECTIONS), default=tuple(SECTIONS))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--packages", type=Path, help="folder with an installed wheel")
    parser.add_argument("--images", type=Path, help="folder for the rendered images, kept")
    options = parser.parse_args()
    begin_benchmark("experiments.benchmarks.all_bars")
    absent = (
        (ceres_library() is None, CERES_MISSING),
        (gtsam is None, GTSAM_MISSING),
        (embreex_scene is None, EMBREE_MISSING),
    )
    for missing, what in absent:
        if missing:
            print(what)
    print("| work | measured | bar | met | `python -m experiments.benchmarks.` |\n|---|---|---|---|---|")
    for name in options.only:
        for bar in SECTIONS[name](options):
            print(bar, flush=True)


def batch(options: argparse.Namespace) -> Iterator[Bar]:
    """Batch solutions of 115 epochs from the closed form, and iterations over the floor."""
    workload, alone = disam115_workload("rich", 0), "smoother --motion rich"
    solvers: dict[str, Solver] = {"ours": lambda: own_batch(workload)}
    if ceres_library() is not None:
        solvers["Ceres"] = lambda: ceres_batch(workload)
        ceres_batch(workload)
    if gtsam is not None:
        solvers["GTSAM"] = lambda: levenberg_marquardt(workload)
    solvers["SciPy"] = lambda: scipy_least_squares(workload)
    own_batch(workload)
    found, bars = in_turn(solvers, options.rounds), {"Ceres": 8.0, "GTSAM": 24.0, "SciPy": 65.0}
    for name in list(solvers)[1:]:
        value = ratio_of(found[name], found["ours"]).value
        yield Bar(f"batch, 115 epochs, over {name}", value, bars[name], "x", alone)
    for epochs, most in sorted(FLOOR_BARS.items(), reverse=True):
        times = iteration_times(workload.first(epochs), 3 * options.rounds, peers=False)
        if FLOOR in times:
            value = ratio(times["ours"][0], times[FLOOR][0]).value
            yield Bar(f"iteration over the floor, {epochs} epochs", value, most, "x", alone, most=True)


def stream(options: argparse.Namespace) -> Iterator[Bar]:
    """Frame after frame over GTSAM; a round takes a minute, so there is one."""
    if gtsam is None:
        return
    workload, alone = disam115_workload("rich", 0), "smoother --motion rich"
    own_resolved(workload.first(20))
    found = in_turn({"ours": lambda: own_resolved(workload), "isam2": lambda: isam2(workload)}, 1)
    value = ratio_of(found["isam2"], found["ours"]).value
    yield Bar("every epoch re-solved, ISAM2 over ours", value, 16.0, "x", alone)
    own_window(workload, LAG)
    found = in_turn({"ours": lambda: own_window(workload, LAG), "lag": lambda: fixed_lag(workload, LAG)}, 1)
    value = ratio_of(found["lag"], found["ours"]).value
    yield Bar(f"window of {LAG}, IncrementalFixedLag over ours", value, 100.0, "x", alone)


def filters(options: argparse.Namespace) -> Iterator[Bar]:
    """Filters with a known map over filterpy's."""
    seconds = time_frames(prepare(simulate(Scenario.simplified()), Settings()), 24, options.rounds)
    for pair, bar in zip(PAIRS, (300.0, 90.0), strict=True):
        value = speed_ratio(seconds, *pair).ratio
        yield Bar(f"{pair[0].upper()}, known map, filterpy over ours", value, bar, "x", "filter_speed")


def landmarks(options: argparse.Namespace) -> Iterator[Bar]:
    """Filters beside an unknown map, 208 landmarks of 2,000."""
    speeds = measure(1000 // BLOCKS)
    for name, bar in (("mekf", 0.35), ("ukf", 0.8)):
        what = f"{name.upper()} with landmarks, 208 of 2,000"
        yield Bar(what, speeds[name].median_ms, bar, "ms", "landmark_filters --frames 1000", most=True)


def live(options: argparse.Namespace) -> Iterator[Bar]:
    """Frames of the smoother on line."""
    high = 1e3 * float(np.quantile(frame_seconds(300, options.rounds), 0.99))
    yield Bar("smoother on line, default, 99th percentile of a frame", high, 60.0, "ms", "live_frames", True)


def picture(options: argparse.Namespace) -> Iterator[Bar]:
    """Seconds until a user sees something."""
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder)
        fresh, alone = picture_times(cache, options.packages), "first_picture"
        if options.packages is not None:
            alone += " --packages FOLDER"
            yield Bar("first picture from a wheel, wall", fresh.first, 10.0, "s", alone, most=True)
            yield Bar("the whole first run from a wheel, wall", fresh.whole.wall, 10.0, "s", alone, most=True)
        warm = warm_times(cache, options.packages, options.rounds)
        yield Bar("warm compare, wall", warm.whole.wall, 6.0, "s", alone, most=True)
        yield Bar("warm compare, processor", warm.whole.processor, 6.0, "s", alone, most=True)


def campaign(options: argparse.Namespace) -> Iterator[Bar]:
    """Runs a second."""
    cases = (
        # seeds of the studies themselves, or as many that the start of the workers, 2.5 s, is a tenth of the whole
        ("drawn", "known-map-drawn.toml", 2000, False, 80.0),
        ("with initialisation", "known-map.toml", 30, False, 8.0),
        ("batch mode", "poses-drawn.toml", 2000, True, 2000.0),
    )
    for what, file, seeds, batched, bar in cases:
        cost = campaign_cost(STUDIES / file, seeds, CORES, batched)
        alone = f"campaign experiments/studies/{file} --seeds {seeds} --workers {CORES}{' --batch' if batched else ''}"
        rate = CORES * cost.runs / cost.processor
        yield Bar(f"campaign runs a second on {CORES} cores, {what}", rate, bar, "/s", alone)


def gyro(options: argparse.Namespace) -> Iterator[Bar]:
    """A million samples of a gyro."""
    cost = gyro_cost(1_000_000)
    yield Bar("a million gyro samples, MEKF", cost.filter, 40.0, "s", "long_gyro", most=True)
    yield Bar("the same, whole command", cost.command.processor, 40.0, "s", "long_gyro", most=True)
    yield Bar("the same, peak memory", cost.command.peak_mb / 1024, 1.0, "GB", "long_gyro", most=True)


def tracer(options: argparse.Namespace) -> Iterator[Bar]:
    """Rays per second of processor time over Embree's, which finds triangles and distances as ours does."""
    if embreex_scene is None:
        return
    for parallels in MESHES:
        seconds, triangles = tracing_times(parallels, 400, 5 * options.rounds)
        value = median(seconds[DISTANCES]) / median(seconds["ours"])
        yield Bar(f"tracer over raw embreex, {triangles} triangles", value, 1.5, "x", "lidar_tracer")


def images(options: argparse.Namespace) -> Iterator[Bar]:
    """Front end."""
    yield Bar(
        "front end, 115 pairs", front_end_seconds(115, options.images), 10.0, "s", "front_end", most=True
    )


SECTIONS: Final[dict[str, Callable[[argparse.Namespace], Iterator[Bar]]]] = {
    section.__name__: section
    for section in (batch, stream, filters, landmarks, live, picture, campaign, gyro, tracer, images)
}

if __name__ == "__main__":
    run_study(main)
