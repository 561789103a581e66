"""A tumbling body whose landmarks nobody knows: small recordings, and filters started near the truth."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, Measurement
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.timeline import CameraView, Epoch, SensorNoise, Timeline, build_timeline
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map

LAYOUT = StateLayout(FULL_BLOCKS)
NOISE = ProcessNoise(force_psd=1e-6, torque_psd=1e-6)
PROCESS = TorqueFreeProcess(LAYOUT, NOISE, 1e-8)
START_STD = np.repeat([1e-6, 1e-6, 0.002, 0.003, 0.002, 0.01], [3, 3, 3, 3, 3, 5])
"""Of the belief at the first epoch, whose pose defines g."""
FILTERS: dict[str, Callable[..., MultiplicativeFilter]] = {
    "mekf": MultiplicativeEkf,
    "ukf": MultiplicativeUkf,
}


@dataclass(frozen=True)
class Recording:
    """Truth and measurements: states (n, m) in the truth's g, one epoch of observations each; the true map."""

    dataset: Dataset
    states: np.ndarray
    timeline: Timeline
    points: np.ndarray


@cache
def recording(seed: int = 0, epochs: int = 30, landmarks: int = 150, pixel_std: float = 1.0) -> Recording:
    """A richly tumbling body."""
    scenario = Scenario.simplified(
        rate_rpm=RICH_RPM, seed=seed, epochs=epochs, landmarks=landmarks, pixel_std=pixel_std, noise=NOISE
    )
    whole = simulate(scenario)
    dataset = without_map(whole)
    assert whole.truth is not None
    assert whole.known_map is not None
    return Recording(dataset, true_states(whole.truth, LAYOUT), timeline_of(dataset), whole.known_map.points)


def timeline_of(dataset: Dataset, pixel_std: float = 1.0) -> Timeline:
    """Epochs of observations whose landmarks are left to the filter."""
    assert dataset.rig is not None
    view = CameraView(None, dataset.rig.calibration)
    return build_timeline(dataset.log, LAYOUT, SensorNoise(pixel_std=pixel_std), view)


def first_belief(states: np.ndarray, seed: int = 0) -> Gaussian:
    """A belief about the first state whose error is drawn from its covariance; the pose, which defines g, is exact."""
    error = START_STD * np.random.default_rng(1000 + seed).standard_normal(20)
    error[:6] = 0
    return Gaussian(LAYOUT, LAYOUT.retract(states[0], error), np.diag(START_STD))


def started(name: str = "mekf", seed: int = 0, epochs: int = 30, **options: Any) -> MultiplicativeFilter:
    """A filter that stands at the first epoch of a recording, before its observations."""
    estimator = FILTERS[name](PROCESS, **options)
    estimator.start(first_belief(recording(seed, epochs).states, seed))
    return estimator


def run_through(estimator: Estimator, timeline: Timeline, first: int = 0) -> list[Gaussian]:
    """Beliefs after every epoch from this one on; the filter stands at the epoch before."""
    beliefs = []
    for k in range(first, len(timeline)):
        if k:
            estimator.predict(timeline[k].time - timeline[k - 1].time)
        for measurement in timeline[k].measurements:
            estimator.update(measurement)
        beliefs.append(estimator.belief)
    return beliefs


def nees(beliefs: list[Gaussian], states: np.ndarray) -> np.ndarray:
    """Of every epoch, 20 degrees of freedom, in the tangent at the estimate."""
    errors = [LAYOUT.local(belief.mean, x) for belief, x in zip(beliefs, states, strict=True)]
    whitened = [np.linalg.solve(belief.factor, e) for belief, e in zip(beliefs, errors, strict=True)]
    return np.array([w @ w for w in whitened])


def with_values(epoch: Epoch, values: np.ndarray) -> Epoch:
    """The epoch with other measured values."""
    old = epoch.measurements[0]
    return Epoch(epoch.time, (Measurement(old.model, values, old.parameters, old.ids),))
