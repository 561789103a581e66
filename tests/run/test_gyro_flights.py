"""Free flights in body rates."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import Acceleration, MeasurementLog, MeasurementStream
from spinfilters.run.free_flight import find_flights
from spinfilters.run.gyro_flights import (
    gyro_flights,
    inertia_tensor,
    momentum_change,
    rotation_history,
    unexplained_force,
)
from tests.run.throws import FLIGHTS, INTERVAL, MOMENTS, Carried, carried


@pytest.fixture(scope="module")
def log() -> Carried:
    """Two throws with the noise of a phone's gyro."""
    return carried(0.005, np.random.default_rng(1))


def test_flights_are_found_with_their_bounds_and_a_hand_is_none(log: Carried) -> None:
    found = gyro_flights(log.time, log.rates)
    assert len(found) == len(FLIGHTS)
    for stretch, (start, end) in zip(found, FLIGHTS, strict=True):
        assert log.time[stretch.start] == pytest.approx(start, abs=6 * INTERVAL)
        assert log.time[stretch.end - 1] == pytest.approx(end, abs=6 * INTERVAL)


def test_the_inertia_of_a_flight_is_that_of_the_body(log: Carried) -> None:
    inside = (log.time >= FLIGHTS[0][0]) & (log.time <= FLIGHTS[0][1])
    history = rotation_history(log.time[inside], log.rates[inside])
    tensor = inertia_tensor(history, 0, len(history.time))
    np.testing.assert_allclose(np.linalg.eigvalsh(tensor), MOMENTS, atol=0.01)
    change = momentum_change(history, tensor)
    assert change.error < 0.01
    assert abs(change.loss) < 0.02


def test_stamps_in_milliseconds_under_a_header_of_seconds_are_refused() -> None:
    time = 0.01 * np.arange(300)
    rates = 4.0 * np.stack([0.2 * np.cos(2 * time), 0.2 * np.sin(2 * time), np.ones(300)], axis=1)
    slow = Dataset(kind="gyro", log=MeasurementLog((MeasurementStream("gyro", 1e3 * time, rates),)))
    with pytest.raises(InputError, match=r"turns by .* from one sample to the next.*--clock ms"):
        find_flights(slow)


def test_a_flight_ends_at_a_gap(log: Carried) -> None:
    gap = FLIGHTS[0][0] + 0.7
    kept = (log.time < gap) | (log.time > gap + 0.12)
    time = log.time[kept]
    first, _second = gyro_flights(time, log.rates[kept])
    assert time[first.end - 1] < gap
    assert time[first.end] > gap + 0.1


def test_a_gyro_at_rest_does_not_fly() -> None:
    generator = np.random.default_rng(2)
    time = np.arange(0, 20, INTERVAL)
    rates = [0.02, -0.01, 0.005] + 0.004 * generator.standard_normal((len(time), 3))
    assert gyro_flights(time, rates) == []
    rates[-200:] += 10 * np.sin(np.arange(200) / 9)[:, None] * [1.0, 0.3, 0.5]
    assert gyro_flights(time, rates) == []


def test_a_steady_spin_is_free_and_what_a_table_turns_is_not_where_an_accelerometer_feels_it() -> None:
    time = np.arange(0, 5, INTERVAL)
    rates = np.tile([0.0, 0.0, 6.0], (len(time), 1))
    (stretch,) = gyro_flights(time, rates)
    assert len(stretch) > 0.9 * len(time)
    place, turning = np.array([0.03, 0.0, 0.0]), 36.0
    flying = np.tile(-turning * place, (len(time), 1))
    free, turned = (
        unexplained_force(Acceleration(time, force), time, rates)
        for force in (flying, np.add(flying, [0.0, 0.0, 9.81]))
    )
    assert free is not None
    assert turned is not None
    assert free < 0.1 < 9.0 < turned


def test_a_motion_that_gains_momentum_is_no_flight(log: Carried) -> None:
    """A torque along the momentum keeps its direction: the motion is free but for its size."""
    inside = (log.time >= FLIGHTS[0][0]) & (log.time <= FLIGHTS[0][1])
    time, rates = log.time[inside], log.rates[inside]
    share = 0.2 / (time[-1] - time[0])
    for sign, count in ((-1.0, 1), (1.0, 0)):
        size = np.exp(sign * share * (time - time[0]))
        # a motion whose rates grow in size runs through the same attitudes in less time
        slow = np.concatenate([[0.0], np.cumsum(np.diff(time) / size[:-1])])
        driven = MeasurementStream("gyro", time[0] + slow, rates * size[:, None])
        assert len(find_flights(Dataset(kind="gyro", log=MeasurementLog((driven,))))) == count


def test_attitudes_are_exact_for_a_constant_rate() -> None:
    time = np.arange(0, 3, 0.05)
    history = rotation_history(time, np.tile([1.0, 2.0, -1.5], (len(time), 1)))
    momentum = history.momentum @ [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(momentum, np.tile([1.0, 2.0, -1.5], (len(time), 1)), atol=1e-12)
    assert history.angle[-1] == pytest.approx(time[-1] * np.sqrt(7.25))
