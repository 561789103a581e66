"""The contract of a recursive estimator, the same for every one: time moves by predictions, values count, states come back."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.filters.estimator import Estimator
from spinfilters.filters.joint_ekf import JointEkf
from spinfilters.filters.late_measurements import Outcome
from spinfilters.smoother.recursive_smoother import RecursiveSmoother
from tests.filters.out_of_sequence_samples import (
    FULL,
    INTERVAL,
    OURS,
    PROCESS,
    Build,
    arrivals,
    assert_same_bits,
    belief,
    late,
    online,
    received,
)

EVERY = (*OURS, JointEkf, RecursiveSmoother)
every_estimator = pytest.mark.parametrize("build", EVERY)


def _started(build: Build, count: int = 0) -> Estimator:
    """After the first measurements, three sensors at every stamp."""
    estimator, time = build(PROCESS), 0.0
    estimator.start(belief())
    for stamp, measurement in arrivals()[:count]:
        if stamp > time:
            estimator.predict(stamp - time)
            time = stamp
        estimator.update(measurement)
    return estimator


def _away(estimator: Estimator, mean: np.ndarray) -> float:
    """Largest distance from a mean in the estimator's standard deviations."""
    present = estimator.belief
    return float(np.abs(FULL.local(mean, present.mean) / present.std).max())


@every_estimator
@pytest.mark.parametrize("count", [0, 6])
def test_a_prediction_moves_the_mean_as_the_process_does_and_widens_the_belief(
    build: Build, count: int
) -> None:
    estimator = _started(build, count)
    before = estimator.belief
    estimator.predict(0.3)
    np.testing.assert_allclose(
        FULL.local(PROCESS.step(before.mean, 0.3), estimator.belief.mean), 0.0, atol=1e-3
    )
    assert _away(estimator, PROCESS.step(before.mean, 0.3)) < 0.2
    assert _away(estimator, before.mean) > 1.0
    assert np.linalg.det(estimator.belief.covariance) > np.linalg.det(before.covariance)


@every_estimator
def test_two_predictions_are_one_of_both_their_times(build: Build) -> None:
    twice, once = _started(build, 6), _started(build, 6)
    twice.predict(0.1)
    twice.predict(0.15)
    once.predict(0.25)
    assert _away(twice, once.belief.mean) < 1e-3
    np.testing.assert_allclose(twice.belief.std, once.belief.std, rtol=1e-3)
    for estimator in (twice, once):
        estimator.update(arrivals()[9][1])
    assert _away(twice, once.belief.mean) < 1e-2


@every_estimator
@pytest.mark.parametrize("sensor", ["gyro", "pose", "stereo"])
def test_other_values_give_another_belief(build: Build, sensor: str) -> None:
    measurement = next(m for _, m in arrivals() if m.model.name == sensor)
    one, other = _started(build), _started(build)
    one.update(measurement)
    other.update(replace(measurement, values=measurement.values + 0.003))
    assert np.abs(FULL.local(one.belief.mean, other.belief.mean)).max() > 1e-7


@every_estimator
def test_a_measurement_makes_the_belief_narrower_and_every_sensor_of_an_instant_counts(build: Build) -> None:
    estimator, (_, gyro), (_, pose) = _started(build), arrivals()[0], arrivals()[1]
    assert {gyro.model.name, pose.model.name} == {"gyro", "pose"}
    before = estimator.belief.std
    assert estimator.update(gyro).accepted == 1
    rates = FULL.slice("w")
    assert (estimator.belief.std[rates] < before[rates]).all()
    after_gyro = estimator.belief.std
    assert estimator.update(pose).accepted == 1
    places = FULL.slice("t")
    assert (estimator.belief.std[places] < after_gyro[places]).all()


@every_estimator
def test_measurements_of_one_instant_may_come_together_or_one_by_one(build: Build) -> None:
    smallest_batch, one_by_one = _started(build, 3), _started(build, 3)
    measurements = [m for _, m in arrivals()[3:6]]
    for estimator in (smallest_batch, one_by_one):
        estimator.predict(INTERVAL)
    reports = smallest_batch.update_all(measurements)
    others = [one_by_one.update(measurement) for measurement in measurements]
    assert [report.accepted for report in reports] == [report.accepted for report in others]
    assert _away(smallest_batch, one_by_one.belief.mean) < 0.1
    np.testing.assert_allclose(smallest_batch.belief.std, one_by_one.belief.std, rtol=0.02)


@every_estimator
@pytest.mark.parametrize("count", [0, 1, 5, 6])
def test_a_snapshot_leads_on_to_the_same_bits(build: Build, count: int) -> None:
    estimator = _started(build, count)
    kept = {name: array.copy() for name, array in estimator.snapshot().items()}
    now = estimator.belief

    def go_on() -> tuple[np.ndarray, np.ndarray]:
        for _, measurement in arrivals()[6:9]:
            estimator.update(measurement)
        estimator.predict(0.07)
        estimator.update(arrivals()[12][1])
        return estimator.belief.mean, estimator.belief.factor

    first = go_on()
    estimator.restore(kept)
    assert_same_bits(estimator.belief, now)
    for one, other in zip(first, go_on(), strict=True):
        np.testing.assert_array_equal(one, other)


@every_estimator
def test_a_late_measurement_gives_what_it_gives_in_order(build: Build) -> None:
    in_order, shuffled = online(build), online(build)
    received(in_order, arrivals()[:30])
    order = [arrival for arrival in late(4, 0.4) if arrival[0] <= arrivals()[29][0]]
    outcomes = received(shuffled, order)
    assert Outcome.INSERTED in outcomes
    assert set(outcomes) <= {Outcome.TAKEN, Outcome.INSERTED}
    assert_same_bits(shuffled.belief, in_order.belief)


@every_estimator
def test_the_belief_may_be_asked_for_past_the_last_measurement(build: Build) -> None:
    updates = online(build)
    received(updates, arrivals()[:9])
    ahead = updates.belief_at(updates.time + 0.7)
    expected = PROCESS.step(updates.belief.mean, 0.7)
    assert np.abs(FULL.local(expected, ahead.mean) / ahead.std).max() < 0.2
    received(updates, arrivals()[9:12])
    assert updates.time == arrivals()[11][0]
