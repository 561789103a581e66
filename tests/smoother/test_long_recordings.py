"""A long recording: flat in memory, and the same numbers however it is cut into stretches."""

import tracemalloc
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest

from spinfilters.core.robust_losses import Gate
from spinfilters.filters.estimator import UpdateReport
from spinfilters.filters.history import GrowingHistory
from spinfilters.filters.timeline import SensorNoise, Timeline, build_timeline, times_of
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import EstimatorStatus
from spinfilters.smoother import linear_system as marginals
from spinfilters.smoother import linear_system as schur_system
from spinfilters.smoother import motion_factors
from spinfilters.smoother import problem as least_squares
from spinfilters.smoother.batch_smoother import BatchSmoothing, smooth_recording
from spinfilters.smoother.priors import FirstStatePrior

LAYOUT = StateLayout(ROTATION_BLOCKS)
MANY = 20_000
Made = TypeVar("Made")
REPORT = UpdateReport(nis=3.0, dof=3, accepted=1, rejected=0)


def gyro(count: int) -> MeasurementStream:
    """A steady rotation about x, with noise."""
    rates = np.array([0.5, 0.1, 0.0]) + 0.01 * np.random.default_rng(0).standard_normal((count, 3))
    return MeasurementStream("gyro", 0.05 * np.arange(count), rates)


def timeline(count: int) -> Timeline:
    """Epochs of the gyro alone."""
    return build_timeline(MeasurementLog((gyro(count),)), LAYOUT, SensorNoise(gyro_noise_std=0.01))


def held(make: Callable[[], Made]) -> tuple[Made, int]:
    """What is made, and the bytes that it holds."""
    tracemalloc.start()
    made = make()
    held_bytes = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return made, held_bytes


def test_a_timeline_holds_a_few_numbers_for_each_sample() -> None:
    log = MeasurementLog((gyro(MANY),))
    epochs, size = held(lambda: build_timeline(log, LAYOUT, SensorNoise()))
    assert len(epochs) == MANY
    assert size < 100 * MANY


def test_epochs_are_cut_and_counted_like_a_tuple() -> None:
    epochs = timeline(10)
    assert epochs[-1].time == epochs[9].time == tuple(epochs)[-1].time
    assert np.array_equal(times_of(epochs[2:5]), [epoch.time for epoch in epochs][2:5])
    assert len(epochs[7:][1:]) == 2
    with pytest.raises(IndexError):
        epochs[10]


def test_sensors_share_the_epochs_of_their_common_times() -> None:
    whole = gyro(6)
    pose = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (3, 1))
    poses = MeasurementStream("pose", np.array([0.05, 0.06, 0.25]), pose)
    layout = StateLayout(("t", "a", "v", "w", "c", "s"))
    epochs = build_timeline(MeasurementLog((whole, poses)), layout, SensorNoise())
    names = [[m.model.name for m in epoch.measurements] for epoch in epochs]
    assert names == [["gyro"], ["gyro", "pose"], ["pose"], ["gyro"], ["gyro"], ["gyro"], ["gyro", "pose"]]
    assert np.array_equal(epochs[3].measurements[0].values, whole.values[2:3])


def test_a_history_holds_little_more_than_its_arrays() -> None:
    belief = Gaussian(LAYOUT, LAYOUT.origin(), np.eye(LAYOUT.error_dim))

    def grown() -> GrowingHistory:
        rows = GrowingHistory(LAYOUT, 0.0)
        rows.reserve(MANY // 10)
        for k in range(MANY // 10):
            rows.append(float(k), belief, [REPORT], 0.0)
        return rows

    rows, size = held(grown)
    assert size < 1.1 * sum(array.nbytes for array in rows.arrays().values())


def test_a_history_takes_epochs_in_front_without_touching_its_own() -> None:
    belief = Gaussian(LAYOUT, LAYOUT.origin(), np.eye(LAYOUT.error_dim))
    rows = GrowingHistory(LAYOUT, 0.0)
    rows.reserve(3, before=2)
    for k in range(200):
        rows.append(1.0 + k, belief, [REPORT], 0.5)
    before = {name: array[:2] - array[:2] for name, array in rows.arrays().items()}
    whole = rows.ended("mekf", EstimatorStatus(), before)
    assert np.array_equal(whole.time, [0.0, 0.0, *(1.0 + np.arange(200))])
    assert np.array_equal(whole.accepted, [0, 0, *np.ones(200)])
    assert np.array_equal(rows.arrays()["mean"], whole.mean[2:])
    assert len(rows) == 200


@pytest.mark.parametrize("length", [7, 16, 59, 60])
def test_a_chain_is_smoothed_to_the_same_numbers_stretch_by_stretch(
    monkeypatch: pytest.MonkeyPatch, length: int
) -> None:
    whole = smoothed()
    for module in (marginals, motion_factors, least_squares, schur_system):
        monkeypatch.setattr(module, "STRETCH", length)
    cut = smoothed()
    deviations = np.sqrt(np.einsum("kij,kij->ki", whole.factor, whole.factor))
    # sums are taken in another order: a millionth of what is stated
    assert np.allclose(cut.mean, whole.mean, rtol=0, atol=1e-6 * deviations.min())
    assert np.all(np.abs(cut.factor - whole.factor) <= 1e-6 * deviations[..., None])
    assert np.array_equal(cut.accepted, whole.accepted)
    assert np.array_equal(cut.rejected, whole.rejected)
    assert cut.unobservable == whole.unobservable
    assert np.allclose(cut.solved.costs, whole.solved.costs, rtol=1e-8)


def smoothed() -> BatchSmoothing:
    """60 epochs from a poor trajectory; the gate refuses some."""
    process = TorqueFreeProcess(LAYOUT, ProcessNoise(0.0, 1e-6))
    first = LAYOUT.origin()
    first[LAYOUT.mean_slice("w")] = 0.5, 0.1, 0.0
    prior = FirstStatePrior(first, np.repeat([1e-3, 1.0, 1.0], [3, 3, LAYOUT.error_dim - 6]))
    return smooth_recording(process, timeline(60), np.tile(first, (60, 1)), prior, Gate(2.5, 2.5))
