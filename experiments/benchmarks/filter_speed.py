"""Our filters against filterpy's on the same frames.

Time of one prediction and update, interleaved by blocks in one run.
    python -m experiments.benchmarks.filter_speed --frames 24 --out /tmp/benchmark

Both sides get the same compiled models, the same stacked, whitened rows of the simulated default (about 215
landmarks a frame, known map), and the loop over time of every run, in which a filter may take in several epochs by
one call. `--single` times each epoch by itself, as in live use. Machines differ and get busy, so the result is a
ratio. The filters take turns by blocks of frames, and the ratio's range over blocks is printed beside it. They do
not take turns by single frames: filterpy's dense matrices of some megabytes then sweep the processor's caches before
each of our frames, which makes those three times as long.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.benchmarks.stopwatch import begin_benchmark, machine, now
from experiments.command_line import run_study
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.timeline import Epoch, Timeline, run
from spinfilters.inference.setup import Setup
from spinfilters.io.output_files import write_json
from spinfilters.plots.style import BLUE, GREY, RED, save_figure, tidy
from spinfilters.run.estimation import build_estimator
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate

PAIRS: Final = (("mekf", "filterpy-ekf"), ("ukf", "filterpy-ukf"))
NAMES: Final = tuple(name for pair in PAIRS for name in pair)
WARM_FRAMES: Final = 3
"""Frames of every block before the clock starts: compiling, buffers, caches."""
PASSES: Final = {"mekf": 50, "ukf": 25, "filterpy-ekf": 1, "filterpy-ukf": 1}
"""Over the frames of a block: as many as give each filter about the same share of the clock, and of its disturbances."""


@dataclass(frozen=True)
class SpeedRatio:
    """Speed ratio of one of ours to one of filterpy's.

    Medians in ms per frame, their ratio, its least and greatest over blocks.
    """

    ours: str
    theirs: str
    ours_ms: float
    theirs_ms: float
    ratio: float
    least: float
    greatest: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write ``filters.json`` and ``filters.png``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=24, help="timed frames of a block")
    parser.add_argument("--blocks", type=int, default=5, help="blocks, each from the same start")
    parser.add_argument("--single", action="store_true", help="every epoch by itself, as in live use")
    parser.add_argument("--out", type=Path, help="folder for filters.json and filters.png")
    options = parser.parse_args(arguments)
    begin_benchmark("experiments.benchmarks.filter_speed")
    setup = prepare(simulate(Scenario.simplified()), Settings())
    seconds = time_frames(
        setup, options.frames, options.blocks, single_seconds if options.single else run_seconds
    )
    ratios = [speed_ratio(seconds, *pair) for pair in PAIRS]
    landmarks = float(np.mean([len(frame.measurements[0].values) for frame in setup.timeline]))
    _print(ratios, landmarks, seconds.shape)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        document = {
            "machine": machine(),
            "landmarks_per_frame": round(landmarks, 1),
            "blocks": seconds.shape[0],
            "frames_per_block": seconds.shape[1],
            "ratios": [asdict(ratio) for ratio in ratios],
        }
        write_json(options.out / "filters.json", document)
        save_figure(speed_figure(ratios, landmarks), options.out / "filters.png")


Pass = Callable[[Estimator, Timeline], Sequence[float]]
"""Seconds of each epoch behind the first, which an estimator was started at."""


def time_frames(
    setup: Setup, epochs: int, blocks: int, seconds_of: Pass | None = None
) -> Float[np.ndarray, "b n 4"]:
    """Seconds per frame of every filter in `NAMES`, by default in a run.

    Each from the same start over the same frames, in every block.
    """
    filters = [build_estimator(name, setup, Settings()) for name in NAMES]
    first = len(setup.initial.mean)
    timeline, chosen = setup.timeline[first - 1 : first + WARM_FRAMES + epochs], seconds_of or run_seconds
    rows = [[_passes(estimator, setup, timeline, chosen) for estimator in filters] for _ in range(blocks)]
    return np.moveaxis(np.array(rows), 1, 2)


def _passes(
    estimator: Estimator, setup: Setup, timeline: Timeline, seconds_of: Pass
) -> Float[np.ndarray, " n"]:
    """Median seconds of one filter for each step but the first ones."""
    rows = []
    for _ in range(PASSES[estimator.name]):
        estimator.start(setup.initial.belief)
        rows.append(seconds_of(estimator, timeline))
    return np.median(rows, axis=0)[WARM_FRAMES:]


def run_seconds(estimator: Estimator, timeline: Timeline) -> Sequence[float]:
    """Of the epochs of a run; those that one call takes in share its time."""
    chosen = timeline[1:]
    ends: dict[int, float] = {0: now()}
    times: list[float] = []

    def note(last: int) -> None:
        """Time when the epochs up to this one are done."""
        ends[last + 1] = now()

    run(estimator, timeline[0].time, chosen, note)
    for before, after in pairwise(sorted(ends)):
        times += [(ends[after] - ends[before]) / (after - before)] * (after - before)
    return times


def single_seconds(estimator: Estimator, timeline: Timeline) -> Sequence[float]:
    """Of the prediction and updates of every epoch."""
    return [_seconds(estimator, after, after.time - before.time) for before, after in pairwise(timeline)]


def speed_ratio(seconds: Float[np.ndarray, "b n 4"], ours: str, theirs: str) -> SpeedRatio:
    """Ratio of the medians of two columns of `time_frames`, and its range over blocks."""
    pair = seconds[..., [NAMES.index(ours), NAMES.index(theirs)]]
    medians = np.median(pair, axis=1)
    over_blocks = medians[:, 1] / medians[:, 0]
    mine, other = np.median(pair, axis=(0, 1)).tolist()
    return SpeedRatio(
        ours,
        theirs,
        1e3 * mine,
        1e3 * other,
        other / mine,
        float(over_blocks.min()),
        float(over_blocks.max()),
    )


def speed_figure(ratios: Sequence[SpeedRatio], landmarks: float) -> Figure:
    """Milliseconds per frame as bars on a logarithmic axis, each of ours beside its counterpart."""
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.add_subplot()
    names = [name for ratio in ratios for name in (ratio.ours, ratio.theirs)]
    times = [time for ratio in ratios for time in (ratio.ours_ms, ratio.theirs_ms)]
    bars = axes.bar(names, times, color=[BLUE, GREY, RED, GREY][: len(names)], width=0.65)
    labels = [
        text
        for r in ratios
        for text in (f"{r.ours_ms:.2f} ms\n{r.ratio:.0f}x faster", f"{r.theirs_ms:.1f} ms")
    ]
    axes.bar_label(bars, labels, padding=3)
    axes.set_yscale("log")
    axes.set_ylim(min(times) / 3, max(times) * 4)
    axes.set_ylabel("time per frame  [ms]")
    axes.set_title(f"Prediction and update with {landmarks:.0f} stereo landmarks, one thread")
    tidy(axes)
    axes.grid(visible=False, axis="x")
    return figure


def _seconds(estimator: Estimator, frame: Epoch, dt: float) -> float:
    begin = now()
    estimator.predict(dt)
    for measurement in frame.measurements:
        estimator.update(measurement)
    return now() - begin


def _print(ratios: Sequence[SpeedRatio], landmarks: float, shape: tuple[int, ...]) -> None:
    print(
        f"{shape[0]} blocks of {shape[1]} frames, {landmarks:.0f} stereo landmarks a frame, one thread, medians"
    )
    for r in ratios:
        print(
            f"{r.ours:>5} {r.ours_ms:7.3f} ms   {r.theirs:>12} {r.theirs_ms:7.2f} ms   "
            f"ratio {r.ratio:5.1f} ({r.least:.1f} to {r.greatest:.1f} over blocks)"
        )


if __name__ == "__main__":
    run_study(main)
