"""Schedules: everything arrives, when and as often as the faults of its way say."""

from itertools import pairwise

import numpy as np
import pytest

from spinfilters.data.sensor_format import dataset_kinds
from spinfilters.errors import InputError
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.simulation.transport_faults import (
    Delivery,
    DuplicateMeasurements,
    LateMeasurements,
    Latency,
    Schedule,
    schedule_of,
    with_transport_faults,
)

TRACKS = simulate(Scenario(epochs=40))
PUNCTUAL = schedule_of(TRACKS)
FAULTS = (Latency(0.3, 1.2), LateMeasurements(0.25, 1.6), DuplicateMeasurements(0.2, 0.1))


def arrivals(schedule: Schedule) -> list[float]:
    return [delivery.arrival for delivery in schedule]


def stamps(schedule: Schedule) -> list[float]:
    return [delivery.time for delivery in schedule]


def bits(delivery: Delivery) -> tuple[bytes, ...]:
    """Stamps, values and ids."""
    rows = delivery.rows
    assert rows.ids is not None
    return rows.time.tobytes(), rows.values.tobytes(), rows.ids.tobytes()


@pytest.mark.parametrize("kind", dataset_kinds())
def test_without_faults_every_epoch_arrives_at_its_stamp(kind: str) -> None:
    dataset = simulate(Scenario(kind=kind, epochs=10))
    schedule, stream = schedule_of(dataset), dataset.log.streams[0]
    assert arrivals(schedule) == stamps(schedule) == stream.epoch_times.tolist()
    np.testing.assert_array_equal(np.concatenate([d.rows.values for d in schedule]), stream.values)
    assert all(len(d.rows.epoch_times) == 1 for d in schedule)
    assert schedule[3].log.sensors == dataset.log.sensors


@pytest.mark.parametrize("fault", FAULTS, ids=str)
def test_a_fault_is_seeded_and_keeps_the_order_of_arrival(
    fault: Latency | LateMeasurements | DuplicateMeasurements,
) -> None:
    once, again, other = (with_transport_faults(PUNCTUAL, [fault], seed) for seed in (1, 1, 2))
    assert list(map(bits, once)) == list(map(bits, again))
    assert arrivals(once) == arrivals(again) == sorted(arrivals(once))
    assert arrivals(once) != arrivals(other)
    assert set(map(bits, once)) == set(map(bits, PUNCTUAL))


def test_latency_delays_all_alike_and_its_jitter_disorders() -> None:
    late = with_transport_faults(PUNCTUAL, [Latency(0.7)], 0)
    assert stamps(late) == stamps(PUNCTUAL)
    np.testing.assert_allclose(np.subtract(arrivals(late), stamps(late)), 0.7)
    uneven = with_transport_faults(PUNCTUAL, [Latency(0.7, 2.0)], 0)
    wait = np.subtract(arrivals(uneven), stamps(uneven))
    assert wait.min() >= 0.7
    assert wait.max() <= 2.7
    assert stamps(uneven) != sorted(stamps(uneven))
    assert sorted(stamps(uneven)) == stamps(PUNCTUAL)


def test_held_up_epochs_arrive_behind_those_that_follow() -> None:
    schedule = with_transport_faults(PUNCTUAL, [LateMeasurements(0.25, 1.6)], 0)
    wait = np.subtract(arrivals(schedule), stamps(schedule))
    assert np.count_nonzero(wait) == 10
    np.testing.assert_allclose(wait[wait > 0], 1.6)
    assert stamps(schedule) != sorted(stamps(schedule))


def test_an_epoch_that_is_sent_twice_is_bit_by_bit_the_same_and_follows_at_once() -> None:
    schedule = with_transport_faults(PUNCTUAL, [DuplicateMeasurements(0.2)], 0)
    assert len(schedule) == 48
    twins = [(a, b) for a, b in pairwise(schedule) if a.time == b.time]
    assert len(twins) == 8
    assert all(bits(a) == bits(b) and a.arrival == b.arrival for a, b in twins)


def test_faults_of_delivery_add_up() -> None:
    schedule = with_transport_faults(PUNCTUAL, [DuplicateMeasurements(1.0, 0.2), Latency(0.3)], 0)
    assert len(schedule) == 80
    np.testing.assert_allclose(
        sorted(np.subtract(arrivals(schedule), stamps(schedule)).tolist()), [0.3] * 40 + [0.5] * 40
    )


@pytest.mark.parametrize("delay", [-0.1, np.inf, np.nan])
def test_a_delay_that_cannot_be_is_refused(delay: float) -> None:
    for make in (
        lambda: Latency(delay),
        lambda: LateMeasurements(0.1, delay),
        lambda: DuplicateMeasurements(0.1, delay),
    ):
        with pytest.raises(InputError, match="delay"):
            make()
    with pytest.raises(InputError, match="fraction"):
        LateMeasurements(1.5, 0.1)
