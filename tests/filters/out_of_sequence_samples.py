"""Gyro, poses and tracks of one motion as they arrive, for the tests of measurements that come late."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.ekf import InvariantEkf, MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, Measurement, ProcessModel
from spinfilters.filters.late_measurements import Outcome, OutOfSequenceUpdates
from spinfilters.filters.timeline import SensorNoise, Timeline, build_timeline
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.simulation.scenario import Scenario, simulate
from tests.filters.filter_samples import stereo_timeline

FULL = StateLayout(FULL_BLOCKS)
PROCESS = TorqueFreeProcess(FULL, ProcessNoise())
FRAMES, INTERVAL = 24, 0.1
Arrival = tuple[float, Measurement]
Build = Callable[[ProcessModel], Estimator]
OURS = (MultiplicativeEkf, MultiplicativeUkf, InvariantEkf)


def one_by_one(timeline: Timeline) -> list[Arrival]:
    """Measurements with their times."""
    return [(epoch.time, measurement) for epoch in timeline for measurement in epoch.measurements]


@cache
def arrivals() -> tuple[Arrival, ...]:
    """Gyro, poses and tracks of a known map of one motion, three sensors at every stamp, in the order of time."""
    every: list[Arrival] = []
    for kind in ("gyro", "pose", "stereo-tracks"):
        dataset = simulate(Scenario.simplified(kind=kind, epochs=FRAMES, interval=INTERVAL, landmarks=40))
        if kind == "stereo-tracks":
            every += one_by_one(stereo_timeline(dataset, 1.0))
        else:
            every += one_by_one(build_timeline(dataset.log, FULL, SensorNoise()))
    return tuple(sorted(every, key=lambda arrival: arrival[0]))


@cache
def belief() -> Gaussian:
    """About the true first state."""
    truth = simulate(Scenario.simplified(epochs=FRAMES, interval=INTERVAL, landmarks=40)).truth
    assert truth is not None
    return Gaussian(FULL, true_states(truth, FULL)[0], 0.01 * np.eye(FULL.error_dim))


def online(
    build: Build = MultiplicativeEkf, horizon_s: float = 2.0, capacity: int = 256
) -> OutOfSequenceUpdates:
    """A filter at time 0."""
    estimator = build(PROCESS)
    estimator.start(belief())
    return OutOfSequenceUpdates(estimator, 0.0, horizon_s, capacity)


def received(updates: OutOfSequenceUpdates, order: Sequence[Arrival]) -> list[Outcome]:
    """What became of measurements that came in this order."""
    return [updates.receive(time, measurement).outcome for time, measurement in order]


def late(seed: int, latency: float) -> list[Arrival]:
    """The arrivals in the order in which they come when each is late by up to ``latency`` seconds."""
    delay = np.random.default_rng(seed).uniform(0.0, latency, len(arrivals()))
    order = np.argsort([time + d for (time, _), d in zip(arrivals(), delay, strict=True)])
    return [arrivals()[k] for k in order]


def assert_same_bits(one: Gaussian, other: Gaussian) -> None:
    np.testing.assert_array_equal(one.mean, other.mean)
    np.testing.assert_array_equal(one.factor, other.factor)


def gyro_arrivals() -> list[Arrival]:
    """Of the gyro alone."""
    return [arrival for arrival in arrivals() if arrival[1].model.name == "gyro"]
