"""What cannot be put in its place is left out, counted and said; memory stays bounded."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, Measurement, Snapshot, UpdateReport
from spinfilters.filters.late_measurements import Outcome, OutOfSequenceUpdates
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import Verdict
from tests.filters.linear_samples import LinearProcess, linear_belief, linear_process, linear_sensor
from tests.filters.out_of_sequence_samples import (
    arrivals,
    assert_same_bits,
    gyro_arrivals,
    online,
    received,
)


def test_what_is_older_than_the_horizon_changes_nothing_and_is_counted() -> None:
    updates, gyro = online(horizon_s=0.5), gyro_arrivals()
    received(updates, [*gyro[:2], *gyro[3:12]])
    before = updates.belief
    result = updates.receive(*gyro[2])
    assert result.outcome is Outcome.TOO_LATE
    assert "0.900 s older than the latest epoch, the horizon is 0.5 s" in result.reason
    assert result.report is None
    assert_same_bits(updates.belief, before)
    assert updates.counts[Outcome.TOO_LATE] == 1
    assert updates.status.verdict is Verdict.DEGRADED
    assert updates.status.reasons == ("1 measurements came too late and were left out",)


def test_what_is_as_old_as_the_horizon_still_goes_in() -> None:
    gyro = arrivals()[0][1]
    updates = online(horizon_s=0.5)
    assert received(updates, [(1.0, gyro), (2.0, gyro), (1.5, gyro)])[-1] is Outcome.INSERTED
    assert received(updates, [(1.499, gyro)]) == [Outcome.TOO_LATE]


def test_what_is_of_a_time_before_the_start_is_left_out() -> None:
    result = online().receive(-0.1, arrivals()[0][1])
    assert result.outcome is Outcome.TOO_LATE
    assert "begins at 0.0 s" in result.reason


def test_the_capacity_bounds_what_can_be_gone_back_to() -> None:
    updates, gyro = online(capacity=4), gyro_arrivals()
    received(updates, [*gyro[:5], *gyro[6:12]])
    assert updates.kept_epochs == 4
    result = updates.receive(*gyro[5])
    assert result.outcome is Outcome.TOO_LATE
    assert "only the 4 epochs" in result.reason


def test_an_epoch_whose_own_stamp_was_forgotten_is_not_entered_twice() -> None:
    """A second sensor at a stamp that can no longer be gone back to would come out of its order."""
    updates = online(capacity=2)
    gyro = gyro_arrivals()
    received(updates, gyro[:4])
    pose = next(a for a in arrivals() if a[1].model.name == "pose" and a[0] == gyro[1][0])
    assert updates.receive(*pose).outcome is Outcome.TOO_LATE


def test_a_duplicate_is_dropped_and_another_value_at_the_same_stamp_is_not() -> None:
    updates = online()
    received(updates, arrivals()[:30])
    before = updates.belief
    assert set(received(updates, [(t, replace(m, values=m.values.copy())) for t, m in arrivals()[:30]])) == {
        Outcome.DUPLICATE
    }
    assert_same_bits(updates.belief, before)
    assert updates.counts[Outcome.DUPLICATE] == 30
    time, measurement = arrivals()[12]
    assert received(updates, [(time, replace(measurement, values=np.nextafter(measurement.values, 9)))]) == [
        Outcome.INSERTED
    ]


@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf])
def test_a_time_that_is_not_finite_is_refused(time: float) -> None:
    updates = online()
    with pytest.raises(InputError, match="finite"):
        updates.receive(time, arrivals()[0][1])
    with pytest.raises(InputError):
        updates.belief_at(time)
    assert sum(updates.counts.values()) == 0


@pytest.mark.parametrize(("horizon_s", "capacity"), [(-1.0, 3), (np.nan, 3), (np.inf, 3), (1.0, 0)])
def test_a_horizon_or_capacity_that_keeps_nothing_is_refused(horizon_s: float, capacity: int) -> None:
    with pytest.raises(InputError):
        online(horizon_s=horizon_s, capacity=capacity)


def test_a_measurement_that_breaks_the_estimate_is_taken_back() -> None:
    generator = np.random.default_rng(3)
    sensor, calm = linear_sensor(2, generator), linear_process(generator)
    explosive = LinearProcess(1e150 * np.eye(len(calm.A)), calm.noise)
    estimator = MultiplicativeEkf(explosive)
    estimator.start(linear_belief(generator))
    updates = OutOfSequenceUpdates(estimator, 0.0)
    updates.receive(0.0, sensor.measurement(np.zeros((1, 2))))
    before = updates.belief
    with np.errstate(all="ignore"):
        results = [updates.receive(0.1 * k, sensor.measurement(np.zeros((1, 2)))) for k in (10, 20, 30)]
    outcomes = [result.outcome for result in results]
    assert Outcome.UNUSABLE in outcomes
    assert np.isfinite(updates.belief.factor).all()
    if outcomes[0] is Outcome.UNUSABLE:
        assert_same_bits(updates.belief, before)
    assert "were removed" in updates.status.reasons[-1]


def test_a_measurement_that_does_not_suit_the_estimator_changes_nothing() -> None:
    updates = online()
    received(updates, arrivals()[:12])
    before, (time, measurement) = updates.belief, arrivals()[5]
    with pytest.raises((ShapeError, ValueError)):
        updates.receive(time, replace(measurement, values=measurement.values[:, :1]))
    assert_same_bits(updates.belief, before)
    reference = online()
    received(reference, arrivals())
    received(updates, arrivals()[12:])
    assert_same_bits(updates.belief, reference.belief)


class LightEstimator(Estimator):
    """Forgets and adds up: enough to see memory, and what order does."""

    name = "light"

    def start(self, belief: Gaussian) -> None:
        self._mean, self._factor = belief.mean, belief.factor

    @property
    def belief(self) -> Gaussian:
        return Gaussian(self.layout, self._mean, self._factor)

    def predict(self, dt: float) -> None:
        self._mean = self._mean * (1 - dt)

    def update(self, measurement: Measurement) -> UpdateReport:
        self._mean = self._mean + measurement.values[0, 0]
        return UpdateReport(0.0, 0, 1, 0)

    def snapshot(self) -> Snapshot:
        return {"mean": self._mean.copy()}

    def restore(self, snapshot: Snapshot) -> None:
        self._mean = snapshot["mean"].copy()


def test_memory_stays_flat_over_three_thousand_epochs() -> None:
    generator = np.random.default_rng(4)
    sensor, estimator = linear_sensor(2, generator), LightEstimator(linear_process(generator))
    estimator.start(linear_belief(generator))
    updates, sizes = OutOfSequenceUpdates(estimator, 0.0, horizon_s=0.5, capacity=32), []
    tracemalloc.start()
    try:
        for k in range(3200):  # every eighth pair in reverse
            updates.receive(0.01 * (k ^ (k % 16 < 2)), sensor.measurement(generator.standard_normal((1, 2))))
            if k % 320 == 319:
                sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert updates.kept_epochs == 32
    assert updates.counts == dict.fromkeys(Outcome, 0) | {Outcome.TAKEN: 3000, Outcome.INSERTED: 200}
    assert max(sizes[7:]) < 1.05 * sizes[6]  # Python keeps tuples and tables until then
