"""Random runs of the landmark filters for arithmetic tests.

Any time step, any prior, any noise, in either precision.
The truth lies so near the mean that everything stays linear to within the noise, however wide the prior: what is tried is
arithmetic, not linearisation. Observations come from the model itself; some are wrong, so that landmarks go as well as come.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import LandmarkBelief, MapChange, Measurement, Snapshot
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout

LAYOUT = StateLayout(FULL_BLOCKS)
CAMERA, GYRO = StereoLandmark(LAYOUT), Gyro(LAYOUT)
_PROCESS = TorqueFreeProcess(LAYOUT, ProcessNoise(), 1e-8)
CYCLES = 3
SHARE_SEEN, SHARE_WRONG, SHARE_GYRO = 0.7, 0.1, 0.3
WIDEST = {"t": 1.0, "a": 3.0, "v": 3.0, "w": 3.0, "c": 1.0, "s": 1.0}
"""Prior standard deviations, that of t in ranges: drawn from 1e-5 of these up, log-uniformly."""
OUTLIER = 1e7
"""Of a wrong observation, px: beyond the gate of every prior, so that means stay where linear models hold."""
PIXELS_PER_RADIAN = RIG.left.fx


@dataclass(frozen=True)
class RandomRun:
    """One run: filter, first belief, measurements at every step.

    Steps of ``dt`` seconds.
    """

    estimator: str
    precision: str
    dt: float
    process: TorqueFreeProcess
    options: LandmarkOptions
    belief: Gaussian | LandmarkBelief
    epochs: tuple[tuple[Measurement, ...], ...]

    def filter(self, iteration: IterationOptions | None = None) -> MultiplicativeFilter:
        """The filter, not yet started."""
        if self.estimator == "mekf":
            return MultiplicativeEkf(self.process, iteration=iteration, landmarks=self.options)
        return MultiplicativeUkf(self.process, landmarks=self.options)


@dataclass(frozen=True)
class FilterStep:
    """One prediction (``measurement`` is None) or update, and the filter's snapshots around it."""

    before: Snapshot
    after: Snapshot
    measurement: Measurement | None
    change: MapChange | None
    accepted: int


def random_run(seed: int) -> RandomRun:
    """The run of that seed; precisions and estimators take turns."""
    generator = np.random.default_rng(seed)
    estimator, precision = ("mekf", "ukf")[seed % 2], ("float64", "float32")[seed // 2 % 2]
    dt, pixel_std = _log_uniform(generator, 1e-4, 10.0), _log_uniform(generator, 1e-5, 2.0)
    psd = [_log_uniform(generator, 1e-12, 1e-3) for _ in range(2)]
    process = copy(_PROCESS)  # shares its compiled integrator
    process.noise = ProcessNoise(*psd)
    options = LandmarkOptions(
        modes=int(generator.choice([3, 12])), largest_map=int(generator.integers(4, 13)), precision=precision
    )
    mean = _random_state(generator, dt)
    points = 0.1 * mean[2] * generator.standard_normal((int(generator.integers(6, 13)), 3)).clip(-2, 2)
    small = np.sqrt(pixel_std / PIXELS_PER_RADIAN)
    factor = _prior(generator, mean[2])
    limit = small * np.repeat(
        [mean[2], 1.0, mean[2] / max(dt, 1), 1 / max(dt, 1), 0.1, 0.1], [3, 3, 3, 3, 3, 5]
    )
    truth = LAYOUT.retract(mean, (factor @ generator.standard_normal(20)).clip(-0.1 * limit, 0.1 * limit))
    belief = Gaussian(LAYOUT, mean, factor)
    if generator.random() < 0.6:
        belief = _with_map(generator, belief, points, 0.1 * small * mean[2], options.modes)
    epochs = tuple(
        _frames(generator, process, truth, dt, camera_parameters(points, RIG.calibration, pixel_std))
    )
    return RandomRun(estimator, precision, dt, process, options, belief, epochs)


def steps(run: RandomRun, estimator: MultiplicativeFilter) -> Iterator[FilterStep]:
    """Every prediction and update of a run, as it is made."""
    estimator.start(run.belief)
    for k, measurements in enumerate(run.epochs):
        if k:
            before = estimator.snapshot()
            estimator.predict(run.dt)
            yield FilterStep(before, estimator.snapshot(), None, None, 0)
        for measurement in measurements:
            before = estimator.snapshot()
            report = estimator.update(measurement)
            yield FilterStep(before, estimator.snapshot(), measurement, report.map_change, report.accepted)


def _log_uniform(generator: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))


def _random_state(generator: np.random.Generator, dt: float) -> Float[np.ndarray, " m"]:
    """A body 0.5 to 3 m before the camera that stays there."""
    distance, spin = _log_uniform(generator, 0.5, 3.0), _log_uniform(generator, 1e-3, 2.0)
    speed = min(0.02, 0.05 * distance / (CYCLES * dt))
    std = np.repeat([0.1 * distance, 2.0, speed, spin, 0.02 * distance, 0.2], [3, 3, 3, 3, 3, 5])
    mean = LAYOUT.retract(LAYOUT.origin(), std * generator.standard_normal(20).clip(-2, 2))
    mean[2] = distance
    return mean


def _prior(generator: np.random.Generator, distance: float) -> Float[np.ndarray, "20 20"]:
    """A factor whose standard deviations reach over five decades, block by block, with or without correlations."""
    std = []
    for block in FULL_BLOCKS:
        size = len(range(20)[LAYOUT.slice(block)])
        widest = WIDEST[block] * (distance if block == "t" else 1.0)
        std += [_log_uniform(generator, 1e-5 * widest, widest)] * size
    rows = np.eye(20) + float(generator.random() < 0.5) * np.tril(generator.standard_normal((20, 20)), -1)
    return np.array(std)[:, None] * rows / np.linalg.norm(rows, axis=1, keepdims=True)


def _with_map(
    generator: np.random.Generator,
    belief: Gaussian,
    points: Float[np.ndarray, "k 3"],
    limit: float,
    modes: int,
) -> LandmarkBelief:
    """The belief with landmark errors of at most ``limit`` m.

    Their standard deviations may be larger.
    """
    ids = np.flatnonzero(generator.random(len(points)) < 0.5)[:4]
    std = _log_uniform(generator, 1e-7, 1.0)
    wrong = (std * generator.standard_normal((len(ids), 3))).clip(-limit, limit)
    factor = np.eye(20 + modes)
    factor[:20, :20] = belief.factor
    roots = np.tile(std * np.eye(3), (len(ids), 1, 1))
    shared = np.zeros((len(ids), 3, modes))
    return LandmarkBelief(LAYOUT, belief.mean, ids, points[ids] + wrong, shared, roots, factor, np.zeros(6))


def _frames(
    generator: np.random.Generator,
    process: TorqueFreeProcess,
    x: np.ndarray,
    dt: float,
    parameters: np.ndarray,
) -> Iterator[tuple[Measurement, ...]]:
    pixel_std = parameters[0, -1]
    for k in range(CYCLES):
        x = process.step(x, dt) if k else x
        ids = np.flatnonzero(generator.random(len(parameters)) < SHARE_SEEN)
        values = CAMERA.predict(x, parameters[ids]) + pixel_std * generator.standard_normal((len(ids), 3))
        values += (
            OUTLIER * (generator.random((len(ids), 1)) < SHARE_WRONG) * generator.uniform(-1, 1, values.shape)
        )
        measured = [Measurement(CAMERA, values, parameters[ids], ids)]
        if generator.random() < SHARE_GYRO:
            std = _log_uniform(generator, 1e-6, 1e-2)
            rate = x[LAYOUT.mean_slice("w")] + std * generator.standard_normal(3)
            measured.append(Measurement(GYRO, rate[None], gyro_parameters(1, std, 0.0)))
        yield tuple(measured)
