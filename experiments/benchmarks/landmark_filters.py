"""Filters beside an unknown map of 208 visible landmarks.

Time of a frame and memory over 10,000 frames.
    python -m experiments.benchmarks.landmark_filters [--frames 10000] [-o runs/benchmark]

The body is transparent and stays where it is; of 2,000 landmarks every frame shows 208, 16 others from frame to frame, so that
in every frame some come back that were not seen for a minute or two. One thread. MEKF and UKF take turns by blocks, each going on
from where it was. Times are those of the processor, so that other programs that wait for it do not count; those of the clock are
printed too. Beside them a known map of as many landmarks, with the same filters: what not knowing it costs.
"""

import argparse
import gc
import resource
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, thread_time

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from rich.progress import track

from experiments.benchmarks.stopwatch import begin_benchmark, machine
from experiments.command_line import run_study
from spinfilters.core.conventions import RPM
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.io.output_files import make_folder, write_json
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG, ball
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.plots.style import BLUE, GREY, ORANGE, RED, save_figure, tidy
from spinfilters.simulation.scenario import RICH_RPM, simulate_motion

LANDMARKS, SEEN, OTHERS = 2000, 208, 16
"""Of the body, of a frame, and of these that the frame before did not show."""
BLOCKS = 10
INTERVAL = 0.5
WARM_FRAMES = 3
"""Before the clock starts: compiling, buffers."""
LAYOUT = StateLayout(FULL_BLOCKS)
PROCESS = TorqueFreeProcess(LAYOUT, ProcessNoise(force_psd=1e-6, torque_psd=1e-6), 1e-8)
CAMERA = StereoLandmark(LAYOUT)
START_STD = np.repeat([1e-6, 1e-6, 0.002, 0.003, 0.002, 0.01], [3, 3, 3, 3, 3, 5])
ALLOWED_MS, UKF_RATIO = 0.5, 4.0
"""Of a frame of the MEKF, and of the UKF the times of the MEKF in the same run, which took turns with it."""
TICKS_MS = (0.1, 0.2, 0.5, 1, 2, 5)
KNOWN = ", known map"
COLOURS = {"mekf": BLUE, "ukf": RED, "mekf" + KNOWN: GREY, "ukf" + KNOWN: ORANGE}


@dataclass(frozen=True)
class Speed:
    """Times and memory of one filter, by block.

    Seconds (b, n) of the processor and of the clock for each frame; resident set (b,) after it, MB.
    """

    seconds: Float[np.ndarray, "b n"]
    elapsed: Float[np.ndarray, "b n"]
    resident_mb: Float[np.ndarray, " b"]

    @property
    def medians_ms(self) -> Float[np.ndarray, " b"]:
        """Median of every block, ms."""
        return 1e3 * np.median(self.seconds, axis=1)

    @property
    def median_ms(self) -> float:
        """Median of all epochs, ms."""
        return 1e3 * float(np.median(self.seconds))


def main() -> None:
    """Measure, print, and write ``landmark_filters.json`` and ``landmark_filters.png``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=10_000, help="of each filter")
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/benchmark"))
    options = parser.parse_args()
    begin_benchmark("experiments.benchmarks.landmark_filters")
    make_folder(options.output)
    speeds = measure(options.frames // BLOCKS)
    for name, speed in speeds.items():
        print(described(name, speed, allowed_ms(speeds).get(name)))
    write_json(options.output / "landmark_filters.json", document(speeds))
    save_figure(figure(speeds), options.output / "landmark_filters.png")
    print(f"picture: {options.output / 'landmark_filters.png'}")


def measure(block: int) -> dict[str, Speed]:
    """All filters over blocks of so many frames."""
    filters, scene = _filters(), EndlessMotion()
    times: dict[str, list[Float[np.ndarray, "n 2"]]] = {name: [] for name in filters}
    resident: dict[str, list[float]] = {name: [] for name in filters}
    start = scene.go_on(WARM_FRAMES)
    for name, estimator in filters.items():
        estimator.start(_first_belief(scene.first))
        estimator.update(scene.measured(name, 0, scene.first))
        _block_times(name, estimator, scene, 1, start)
    for k in track(range(BLOCKS), description="blocks"):
        first, states = 1 + WARM_FRAMES + k * block, scene.go_on(block)
        for name in (list(filters), list(filters)[::-1])[k % 2]:
            times[name].append(_block_times(name, filters[name], scene, first, states))
            resident[name].append(_resident_mb())
            assert np.isfinite(filters[name].belief.factor).all()
    speeds = {}
    for name in filters:
        seconds = np.array(times[name])
        speeds[name] = Speed(seconds[..., 0], seconds[..., 1], np.array(resident[name]))
    return speeds


class EndlessMotion:
    """An endless motion and what the camera sees of it.

    Made frame by frame, so that it takes no memory.
    """

    def __init__(self) -> None:
        self._generator = np.random.default_rng(0)
        points = ball(LANDMARKS, 0.11, self._generator).points
        self._parameters = camera_parameters(points, RIG.calibration, 1.0)
        self._process = TorqueFreeProcess(LAYOUT, ProcessNoise(force_psd=0.0, torque_psd=1e-7))
        self.first = _first_state()
        self._last = self.first

    def go_on(self, epochs: int) -> Float[np.ndarray, "n m"]:
        """The next states."""
        time = INTERVAL * np.arange(epochs + 1)
        states = simulate_motion(self._process, self._last, time, self._generator)[1:]
        self._last = states[-1].copy()
        return states

    def measured(self, name: str, frame: int, x: Float[np.ndarray, " m"]) -> Measurement:
        """The noisy landmarks of this frame from this state.

        A known map for the filters of that name.
        """
        ids = (OTHERS * frame + np.arange(SEEN)) % LANDMARKS
        pixels = CAMERA.predict(x, self._parameters[ids])
        noise = np.random.default_rng([1, frame]).standard_normal(pixels.shape)
        known = None if name.endswith(KNOWN) else ids
        return Measurement(CAMERA, pixels + noise, self._parameters[ids], known)


def _first_state() -> Float[np.ndarray, " m"]:
    x, c = LAYOUT.origin(), np.array([0.02, -0.015, 0.01])
    x[LAYOUT.mean_slice("t")] = np.array([0.0, 0.0, 0.6]) - c
    x[LAYOUT.mean_slice("w")] = np.array(RICH_RPM) * RPM
    x[LAYOUT.mean_slice("c")] = c
    x[LAYOUT.mean_slice("s")] = from_inertia(np.diag([1.0322, 1.0, 0.8596]))
    return x


def _first_belief(x: Float[np.ndarray, " m"]) -> Gaussian:
    error = START_STD * np.random.default_rng(1).standard_normal(20)
    error[:6] = 0
    return Gaussian(LAYOUT, LAYOUT.retract(x, error), np.diag(START_STD))


def _filters() -> dict[str, MultiplicativeFilter]:
    made = {"mekf": MultiplicativeEkf, "ukf": MultiplicativeUkf}
    return {name + kind: build(PROCESS) for name, build in made.items() for kind in ("", KNOWN)}


def _block_times(
    name: str,
    estimator: MultiplicativeFilter,
    scene: EndlessMotion,
    first: int,
    states: Float[np.ndarray, "n m"],
) -> Float[np.ndarray, "n 2"]:
    """Processor and clock seconds of each epoch: one prediction, update and belief."""
    times = np.empty((len(states), 2))
    for k, x in enumerate(states):
        measured = scene.measured(name, first + k, x)
        begin = thread_time(), perf_counter()
        estimator.predict(INTERVAL)
        estimator.update(measured)
        _ = estimator.belief
        times[k] = thread_time() - begin[0], perf_counter() - begin[1]
    return times


def _resident_mb() -> float:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def allowed_ms(speeds: dict[str, Speed]) -> dict[str, float]:
    """Largest allowed median time of an epoch."""
    return {"mekf": ALLOWED_MS, "ukf": UKF_RATIO * speeds["mekf"].median_ms}


def described(name: str, speed: Speed, allowed: float | None) -> str:
    """Line of the report for one filter."""
    median, high = 1e3 * np.quantile(speed.seconds, [0.5, 0.99])
    blocks, memory, verdict = speed.medians_ms, speed.resident_mb, ""
    if allowed is not None:
        verdict = f" ({'within' if median <= allowed else 'BEYOND'} {allowed:.3g} ms)"
    return (
        f"{name}: {speed.seconds.size} frames, median {median:.3f} ms{verdict}, 99th percentile {high:.3f} ms (median of the clock "
        f"{1e3 * np.median(speed.elapsed):.3f} ms), last block / first {blocks[-1] / blocks[0]:.3f}, blocks {blocks.min():.3f} .. "
        f"{blocks.max():.3f} ms, resident {memory[0]:.1f} -> {memory[-1]:.1f} MB"
    )


def document(speeds: dict[str, Speed]) -> dict[str, object]:
    """Measurements as a document for JSON."""
    return {
        "machine": machine(),
        "landmarks": LANDMARKS,
        "seen": SEEN,
        "allowed_ms": allowed_ms(speeds),
        "ukf_over_mekf": speeds["ukf"].median_ms / speeds["mekf"].median_ms,
        "filters": {
            name: {"block_medians_ms": speed.medians_ms.tolist(), "resident_mb": speed.resident_mb.tolist()}
            for name, speed in speeds.items()
        },
    }


def figure(speeds: dict[str, Speed]) -> Figure:
    """Milliseconds of a frame and resident memory, block by block."""
    drawn = Figure(figsize=(10.0, 4.4), layout="constrained")
    left, right = drawn.subplots(1, 2, width_ratios=(3, 2))
    for name, speed in speeds.items():
        _draw(left, right, name, speed)
    for name, allowed in allowed_ms(speeds).items():
        left.axhline(allowed, color=COLOURS[name], linestyle="--", linewidth=1.0)
    left.set_yscale("log")
    left.set_yticks(TICKS_MS, [f"{tick}" for tick in TICKS_MS])
    left.yaxis.set_minor_locator(NullLocator())
    left.set(xlabel="frame [-]", ylabel="processor time per frame [ms], dashed: allowed", ylim=(0.08, 6))
    top = 1.3 * max(speed.resident_mb.max() for speed in speeds.values())
    right.set(xlabel="frame [-]", ylabel="resident memory of the process [MB]", ylim=(0, top))
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False)
    for axes in (left, right):
        tidy(axes)
    drawn.suptitle(f"{SEEN} landmarks of {LANDMARKS} seen in every frame, one thread")
    return drawn


def _draw(left: Axes, right: Axes, name: str, speed: Speed) -> None:
    """Times of one filter, and memory after its blocks."""
    color, count = COLOURS[name], speed.seconds.shape[1]
    at = count * (np.arange(BLOCKS) + 0.5)
    low, high = 1e3 * np.quantile(speed.seconds, [0.01, 0.99], axis=1)
    left.fill_between(at, low, high, color=color, alpha=0.2, linewidth=0)
    left.plot(
        at, speed.medians_ms, "o-", color=color, markersize=4, label=f"{name.upper()}, median and 1 .. 99 %"
    )
    width = 5.0 if name == "mekf" else 1.5
    right.plot(count * np.arange(1, BLOCKS + 1), speed.resident_mb, "-", color=color, linewidth=width)


if __name__ == "__main__":
    run_study(main)
