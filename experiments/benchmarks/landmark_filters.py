"""Filters with 150 landmarks in their state, every one seen in every frame: time of a frame and memory over 10,000 frames.

    python -m experiments.benchmarks.landmark_filters [--frames 10000] [-o runs/benchmark]

The body is transparent and stays where it is, so that no landmark ever leaves the view: the dearest frame of this size, 470
errors and 450 measured numbers. One thread. MEKF and UKF take turns by blocks, each going on from where it was. Beside them
stands filterpy's extended Kalman filter with the same compiled models on dense matrices of the same size, for a few frames: the
ratio outlives machines. Times are those of the processor, so that other programs that wait for it do not count; those of the
clock are printed too.
"""

import argparse
import gc
import os
import platform
import resource
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, thread_time

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from rich.progress import track

from experiments.benchmarks.stopwatch import use_one_thread
from spinfilters.conventions import RPM
from spinfilters.dynamics.mass_distribution import from_inertia
from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.landmarks.approximation import FirstOrder
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_filter import LandmarkFilter
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.landmarks.unscented import Unscented
from spinfilters.logs.atomic_write import make_folder, write_json
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.stereo_landmark import StereoLandmark, stereo_parameters
from spinfilters.plots.style import BLUE, GREY, RED, save_figure, tidy
from spinfilters.simulation.motion import simulate_motion
from spinfilters.simulation.scenario import RICH_RPM
from spinfilters.simulation.stereo_tracks import RIG, ball
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

LANDMARKS = 150
BLOCKS = 10
INTERVAL = 0.5
DENSE_FRAMES = 8
WARM_FRAMES = 3
"""Before the clock starts: compiling, buffers."""
LAYOUT = StateLayout(FULL_BLOCKS)
PROCESS = TorqueFreeProcess(LAYOUT, ProcessNoise(force_psd=1e-6, torque_psd=1e-6), 1e-8)
CAMERA = StereoLandmark(LAYOUT)
START_STD = np.repeat([1e-6, 1e-6, 0.002, 0.003, 0.002, 0.01], [3, 3, 3, 3, 3, 5])
ALLOWED_MS = {"mekf": 15.0, "ukf": 60.0}
TICKS_MS = (10, 15, 20, 30, 40, 60, 100)
COLOURS = {"mekf": BLUE, "ukf": RED}


@dataclass(frozen=True)
class Speed:
    """Of one filter, by block: seconds (b, n) of the processor and of the clock for each frame; resident set (b,) after it, MB."""

    seconds: Float[np.ndarray, "b n"]
    elapsed: Float[np.ndarray, "b n"]
    resident_mb: Float[np.ndarray, " b"]

    @property
    def medians_ms(self) -> Float[np.ndarray, " b"]:
        """Of every block."""
        return 1e3 * np.median(self.seconds, axis=1)


def main() -> None:
    """Measure, print, and write ``landmark_filters.json`` and ``landmark_filters.png``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=10_000, help="of each filter")
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/benchmark"))
    options = parser.parse_args()
    use_one_thread("experiments.benchmarks.landmark_filters")
    make_folder(options.output)
    speeds, joint, measured = measure(options.frames // BLOCKS)
    dense_ms = 1e3 * float(np.median(dense_seconds(joint, measured)))
    for name, speed in speeds.items():
        print(described(name, speed, dense_ms))
    print(f"filterpy's dense EKF: {dense_ms:.0f} ms (median of {DENSE_FRAMES - WARM_FRAMES})")
    write_json(options.output / "landmark_filters.json", document(speeds, dense_ms))
    save_figure(figure(speeds, dense_ms), options.output / "landmark_filters.png")
    print(f"picture: {options.output / 'landmark_filters.png'}")


def measure(block: int) -> tuple[dict[str, Speed], LandmarkBelief, list[Measurement]]:
    """Both filters over blocks of so many frames; a belief with its next frames of sightings for the dense filter."""
    filters, scene = _filters(), Scene()
    times: dict[str, list[Float[np.ndarray, "n 2"]]] = {name: [] for name in filters}
    resident: dict[str, list[float]] = {name: [] for name in filters}
    start = scene.go_on(WARM_FRAMES)
    for estimator in filters.values():
        estimator.start(_first_belief(scene.first))
        estimator.update(scene.sightings(0, scene.first))
        _block_times(estimator, scene, 1, start)
    joint, after = filters["mekf"].landmark_belief, []
    for k in track(range(BLOCKS), description="blocks"):
        first, states = 1 + WARM_FRAMES + k * block, scene.go_on(block)
        after = after or [scene.sightings(first + j, x) for j, x in enumerate(states[:DENSE_FRAMES])]
        for name in (list(filters), list(filters)[::-1])[k % 2]:
            times[name].append(_block_times(filters[name], scene, first, states))
            resident[name].append(_resident_mb())
            assert len(filters[name].held) == LANDMARKS
            assert np.isfinite(filters[name].belief.factor).all()
    speeds = {}
    for name in filters:
        seconds = np.array(times[name])
        speeds[name] = Speed(seconds[..., 0], seconds[..., 1], np.array(resident[name]))
    return speeds, joint, after


class Scene:
    """A motion that goes on for ever, and what the camera sees of it: made frame by frame, so that it takes no memory."""

    def __init__(self) -> None:
        self._generator = np.random.default_rng(0)
        points = ball(LANDMARKS, 0.11, self._generator).points
        self._parameters = stereo_parameters(points, RIG.calibration, 1.0)
        self._process = TorqueFreeProcess(LAYOUT, ProcessNoise(force_psd=0.0, torque_psd=1e-7))
        self.first = _first_state()
        self._last = self.first

    def go_on(self, frames: int) -> Float[np.ndarray, "n m"]:
        """The next states."""
        time = INTERVAL * np.arange(frames + 1)
        states = simulate_motion(self._process, self._last, time, self._generator)[1:]
        self._last = states[-1].copy()
        return states

    def sightings(self, frame: int, x: Float[np.ndarray, " m"]) -> Measurement:
        """All landmarks from this state, with the noise of this frame."""
        pixels = CAMERA.predict(x, self._parameters)
        noise = np.random.default_rng([1, frame]).standard_normal(pixels.shape)
        return Measurement(CAMERA, pixels + noise, self._parameters, np.arange(LANDMARKS))


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


def _filters() -> dict[str, LandmarkFilter]:
    approximations = {"mekf": FirstOrder, "ukf": Unscented}
    options = LandmarkOptions(capacity=LANDMARKS)
    return {name: LandmarkFilter(PROCESS, made(), options) for name, made in approximations.items()}


def _block_times(
    estimator: LandmarkFilter, scene: Scene, first: int, states: Float[np.ndarray, "n m"]
) -> Float[np.ndarray, "n 2"]:
    """Seconds of the processor and of the clock for one prediction and update in every frame from number ``first`` on."""
    times = np.empty((len(states), 2))
    for k, x in enumerate(states):
        measured = scene.sightings(first + k, x)
        begin = thread_time(), perf_counter()
        estimator.predict(INTERVAL)
        estimator.update(measured)
        times[k] = thread_time() - begin[0], perf_counter() - begin[1]
    return times


def _resident_mb() -> float:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def dense_seconds(joint: LandmarkBelief, measured: list[Measurement]) -> Float[np.ndarray, " n"]:
    """Seconds of every frame of filterpy's extended Kalman filter on the errors of state and points, dense as it holds them."""
    size = len(joint.factor)
    dense = ExtendedKalmanFilter(dim_x=size, dim_z=3 * LANDMARKS)
    dense.x, dense.P, dense.R = np.zeros(size), joint.factor @ joint.factor.T, np.eye(3 * LANDMARKS)
    dense.F, dense.Q = np.eye(size), np.zeros((size, size))
    mean, points, seconds = joint.mean, joint.points.copy(), []
    for frame in measured:
        begin = thread_time()
        mean, dense.F[:20, :20], noise = PROCESS.linearise(mean, INTERVAL)
        dense.Q[:20, :20] = noise @ noise.T
        dense.predict()
        H, innovation = _dense_rows(mean, points, joint, frame)
        dense.update(innovation, lambda _, H=H: H, lambda x, H=H: H @ x)
        mean, points = LAYOUT.retract(mean, dense.x[:20]), points + dense.x[20:].reshape(-1, 3)
        dense.x = np.zeros(size)
        seconds.append(thread_time() - begin)
    return np.array(seconds[WARM_FRAMES:])


def _dense_rows(
    mean: np.ndarray, points: np.ndarray, joint: LandmarkBelief, frame: Measurement
) -> tuple[Float[np.ndarray, "l N"], Float[np.ndarray, " l"]]:
    """Whitened Jacobian and innovations of all sightings."""
    parameters = np.concatenate([points, frame.parameters[:, 3:]], axis=1)
    at = CAMERA.linearise_landmarks(mean, parameters, frame.values[joint.ids])
    H = np.zeros((LANDMARKS, 3, len(joint.factor)))
    H[:, :, CAMERA.columns] = at.jacobian
    k = np.arange(LANDMARKS)
    H[k[:, None], :, 20 + 3 * k[:, None] + np.arange(3)] = np.swapaxes(at.by_landmark, 1, 2)
    return H.reshape(3 * LANDMARKS, -1), at.innovation.reshape(-1)


def described(name: str, speed: Speed, dense_ms: float) -> str:
    """A line of the report."""
    median, high = 1e3 * np.quantile(speed.seconds, [0.5, 0.99])
    blocks, memory = speed.medians_ms, speed.resident_mb
    verdict = "within" if median <= ALLOWED_MS[name] else "BEYOND"
    return (
        f"{name}: {speed.seconds.size} frames, median {median:.2f} ms ({verdict} {ALLOWED_MS[name]:.0f} ms), 99th percentile "
        f"{high:.2f} ms (median of the clock {1e3 * np.median(speed.elapsed):.2f} ms), last block / first "
        f"{blocks[-1] / blocks[0]:.3f}, blocks {blocks.min():.2f} .. {blocks.max():.2f} ms, "
        f"resident {memory[0]:.1f} -> {memory[-1]:.1f} MB, {dense_ms / median:.1f} x faster than filterpy's dense EKF"
    )


def document(speeds: dict[str, Speed], dense_ms: float) -> dict[str, object]:
    """What was measured, for a file."""
    return {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, one thread used",
        "landmarks": LANDMARKS,
        "dense_ms": dense_ms,
        "filters": {
            name: {"block_medians_ms": speed.medians_ms.tolist(), "resident_mb": speed.resident_mb.tolist()}
            for name, speed in speeds.items()
        },
    }


def figure(speeds: dict[str, Speed], dense_ms: float) -> Figure:
    """Milliseconds of a frame and resident memory, block by block."""
    drawn = Figure(figsize=(10.0, 4.4), layout="constrained")
    left, right = drawn.subplots(1, 2, width_ratios=(3, 2))
    for name, speed in speeds.items():
        _draw(left, right, name, speed)
    left.axhline(dense_ms, color=GREY, linewidth=2.0, label="filterpy's EKF, dense")
    left.set_yscale("log")
    left.set_yticks(TICKS_MS, [f"{tick}" for tick in TICKS_MS])
    left.yaxis.set_minor_locator(NullLocator())
    left.set(xlabel="frame [-]", ylabel="processor time per frame [ms], dashed: allowed", ylim=(8, 110))
    top = 1.3 * max(speed.resident_mb.max() for speed in speeds.values())
    right.set(xlabel="frame [-]", ylabel="resident memory of the process [MB]", ylim=(0, top))
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False)
    for axes in (left, right):
        tidy(axes)
    drawn.suptitle(f"{LANDMARKS} landmarks in the state, all seen in every frame, one thread")
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
    left.axhline(ALLOWED_MS[name], color=color, linestyle="--", linewidth=1.0)
    width = 5.0 if name == "mekf" else 1.5
    right.plot(count * np.arange(1, BLOCKS + 1), speed.resident_mb, "-", color=color, linewidth=width)


if __name__ == "__main__":
    main()
