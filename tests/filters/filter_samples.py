"""The known-map example and its starts, made once for all tests of estimators."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import CameraView, SensorNoise, Timeline, build_timeline, run
from spinfilters.inference.initial_estimate import InitialEstimate, initialise
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.simulation.scenario import Scenario, simulate

FULL = StateLayout(FULL_BLOCKS)
PROCESS = TorqueFreeProcess(FULL, ProcessNoise())
START = InitialisationOptions(epochs=60)


@dataclass(frozen=True)
class Embedded:
    """A simulated data set with its epochs of measurements and true states (k, m)."""

    dataset: Dataset
    timeline: Timeline
    truth: Float[np.ndarray, "k m"]


@cache
def embedded(seed: int) -> Embedded:
    """Tracks of a known map, an easy motion noise."""
    dataset = simulate(Scenario.simplified(seed=seed))
    assert dataset.truth is not None
    return Embedded(dataset, stereo_timeline(dataset, 1.0), true_states(dataset.truth, FULL))


def stereo_timeline(dataset: Dataset, pixel_std: float) -> Timeline:
    """Epochs of a stereo data set with its known map."""
    assert dataset.known_map is not None
    assert dataset.rig is not None
    view = CameraView(dataset.known_map, dataset.rig.calibration)
    return build_timeline(dataset.log, FULL, SensorNoise(pixel_std=pixel_std), view)


@cache
def started(seed: int) -> InitialEstimate:
    """The start that filters go on from; the smoother sets out from the true attitudes and rates, which saves fitting poses."""
    sample = embedded(seed)
    truth = sample.truth[: START.epochs]
    time = np.array([epoch.time for epoch in sample.timeline[: START.epochs]])
    attitude, rates, positions = (truth[:, FULL.mean_slice(block)] for block in ("a", "w", "t"))
    return initialise(PROCESS, sample.timeline, MotionSamples(time, attitude, rates, positions), START)


def run_on(estimator: Estimator, seed: int, timeline: Timeline | None = None) -> EstimateHistory:
    """An estimator over the epochs after the start."""
    timeline = embedded(seed).timeline if timeline is None else timeline
    estimator.start(started(seed).belief)
    return run(estimator, timeline[START.epochs - 1].time, timeline[START.epochs :])


def nees(history: EstimateHistory, seed: int) -> Float[np.ndarray, " n"]:
    """Normalised estimation error squared of every epoch, the error in the tangent space at the estimate."""
    error = FULL.local(history.mean, embedded(seed).truth[START.epochs :][: len(history.mean)])
    whitened = np.linalg.solve(history.factor, error[..., np.newaxis])[..., 0]
    return np.square(whitened).sum(axis=1)
