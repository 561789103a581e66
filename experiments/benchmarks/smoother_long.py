"""The sliding smoother over ten thousand frames.

Time of a frame and memory, from beginning to end.
"""

import gc
from collections.abc import Iterator
from typing import Final

import numpy as np

from experiments.benchmarks.endless_scene import LAYOUT, EndlessScene
from experiments.benchmarks.smoother_checks import BenchmarkCheck
from experiments.benchmarks.smoother_workload import NOISE
from experiments.benchmarks.stopwatch import now
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.smoother.sliding_smoother import SlidingSmoother, SmootherOptions
from spinfilters.smoother.window import FixedLag, LandmarkMarginalization, WindowPolicy

STARTUP: Final = 200
"""Frames before the clock starts: windows are full, nothing is left to compile."""
BLOCKS: Final = 10
MODES: Final[dict[str, WindowPolicy]] = {
    "fixed lag of 20": FixedLag(20),
    "frozen vision": LandmarkMarginalization(),
}
SAME_TIME: Final = 1.1
"""Last block over the first."""
SAME_MEMORY: Final = 0.05
"""Growth of what is resident."""


def long_run(epochs: int) -> Iterator[BenchmarkCheck]:
    """Both modes, one after the other, each over the same scene."""
    for name, mode in MODES.items():
        scene, smoother = EndlessScene(0), _smoother(mode)
        _block(scene, smoother, STARTUP)
        seconds, resident = [], []
        for _ in range(BLOCKS):
            times, megabytes = _block(scene, smoother, epochs // BLOCKS)
            seconds.append(times)
            resident.append(np.median(megabytes))  # it rises and falls as frames gather and leave
        yield from _checks(name, np.array(seconds), np.array(resident))
        error = LAYOUT.local(scene.truth, smoother.window.trajectory[-1])
        deg = np.degrees(np.linalg.norm(error[LAYOUT.slice("a")]))
        mass = np.linalg.norm(error[LAYOUT.slice("s")])
        yield BenchmarkCheck("  latest frame off the truth", f"attitude {deg:.3f} deg, body {mass:.4f}")


def _smoother(mode: WindowPolicy) -> SlidingSmoother:
    process = TorqueFreeProcess(LAYOUT, NOISE)
    return SlidingSmoother(process, EndlessScene(0).prior, SmootherOptions(mode), has_landmarks=True)


def _checks(name: str, seconds: np.ndarray, resident: np.ndarray) -> Iterator[BenchmarkCheck]:
    means = 1e3 * np.mean(seconds, axis=1)  # frames leave a window together: a median would not see it
    change, growth = means[-1] / means[0], resident[-1] / resident[0] - 1
    half, high = 1e3 * np.quantile(seconds, [0.5, 0.99])
    times = f"{means[0]:8.2f} ms per frame at first, at last {means[-1]:.2f} ms: {change:.3f}"
    note = (
        f"blocks {means.min():.2f} .. {means.max():.2f} ms; median {half:.2f}, 99th percentile {high:.2f} ms"
    )
    what = f"{seconds.size} frames, {name}"
    yield BenchmarkCheck(what, times, f"at most {SAME_TIME:g}", bool(change <= SAME_TIME), note)
    memory = f"{resident[0]:8.1f} MB -> {resident[-1]:.1f} MB"
    yield BenchmarkCheck(
        "  resident memory", memory, f"at most +{SAME_MEMORY:.0%}", bool(growth <= SAME_MEMORY)
    )


def _block(scene: EndlessScene, smoother: SlidingSmoother, count: int) -> tuple[list[float], list[float]]:
    """Seconds of each frame, and megabytes that are resident after it."""
    seconds, resident = [], []
    gc.collect()
    for frame in scene.epochs(count):
        begin = now()
        smoother.add(frame)
        seconds.append(now() - begin)
        resident.append(_resident_mb())
    return seconds, resident


def _resident_mb() -> float:
    """VmRSS."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024
