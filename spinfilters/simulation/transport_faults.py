"""Transport faults: late, duplicate and out-of-order measurements.

A `MeasurementLog` is in the order of time stamps. A schedule is in the order of arrival, so it can hold what a log cannot.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.errors import InputError


@dataclass(frozen=True, eq=False)
class Delivery:
    """One epoch of one sensor on its way.

    Attributes
    ----------
    arrival: s, clock of the stamps, when the estimator gets it.
    rows: the measurements, all with one stamp.
    """

    arrival: float
    rows: MeasurementStream

    @property
    def time(self) -> float:
        """Stamp, s."""
        return float(self.rows.time[0])

    @property
    def log(self) -> MeasurementLog:
        """The rows as a log of their own."""
        return MeasurementLog((self.rows,))


Schedule = tuple[Delivery, ...]
"""Deliveries in the order of their arrival."""


class TransportFault(Protocol):
    """Something that goes wrong on the way."""

    def apply(self, schedule: Schedule, generator: np.random.Generator) -> Schedule:
        """The schedule with this fault, in the order of arrival again."""
        ...


def schedule_of(dataset: Dataset) -> Schedule:
    """Every epoch of every sensor, arriving at the time of its stamp."""
    epochs = [epoch for stream in dataset.log.streams for epoch in _epoch_rows(stream)]
    return _by_arrival([Delivery(float(epoch.time[0]), epoch) for epoch in epochs])


def with_transport_faults(schedule: Schedule, faults: Sequence[TransportFault], seed: int) -> Schedule:
    """Schedule after all faults, whose draws depend on seed and place."""
    for fault, sequence in zip(faults, np.random.SeedSequence(seed).spawn(len(faults)), strict=True):
        schedule = fault.apply(schedule, np.random.default_rng(sequence))
    return schedule


@dataclass(frozen=True)
class Latency:
    """Everything arrives ``delay`` seconds late, and each epoch up to ``jitter`` seconds (uniform) later still.

    A jitter beyond the interval of the epochs brings them out of order.
    """

    delay: float
    jitter: float = 0.0

    def __post_init__(self) -> None:
        _require_delay(self.delay)
        _require_delay(self.jitter)

    def apply(self, schedule: Schedule, generator: np.random.Generator) -> Schedule:
        """Later arrivals, same stamps."""
        late = self.delay + self.jitter * generator.random(len(schedule))
        return _by_arrival(
            [replace(d, arrival=d.arrival + float(s)) for d, s in zip(schedule, late, strict=True)]
        )


@dataclass(frozen=True)
class LateMeasurements:
    """A ``fraction`` of the deliveries arrives ``delay`` seconds late.

    Rounded; they arrive behind others that follow.
    """

    fraction: float
    delay: float

    def __post_init__(self) -> None:
        _require_fraction(self.fraction)
        _require_delay(self.delay)

    def apply(self, schedule: Schedule, generator: np.random.Generator) -> Schedule:
        """Some arrivals later."""
        chosen = _chosen(schedule, self.fraction, generator)
        return _by_arrival(
            [replace(d, arrival=d.arrival + self.delay * (k in chosen)) for k, d in enumerate(schedule)]
        )


@dataclass(frozen=True)
class DuplicateMeasurements:
    """A ``fraction`` of the deliveries comes again, ``delay`` seconds later.

    Rounded; bit by bit the same.
    """

    fraction: float
    delay: float = 0.0

    def __post_init__(self) -> None:
        _require_fraction(self.fraction)
        _require_delay(self.delay)

    def apply(self, schedule: Schedule, generator: np.random.Generator) -> Schedule:
        """More deliveries; with no delay the second follows at once."""
        chosen, sent = _chosen(schedule, self.fraction, generator), []
        for k, delivery in enumerate(schedule):
            again = replace(delivery, arrival=delivery.arrival + self.delay)
            sent += [delivery, again] if k in chosen else [delivery]
        return _by_arrival(sent)


def _epoch_rows(stream: MeasurementStream) -> list[MeasurementStream]:
    """A stream for every stamp."""
    epochs = [stream.slice(time, time) for time in stream.epoch_times.tolist()]
    return [epoch for epoch in epochs if epoch is not None]


def _by_arrival(deliveries: Sequence[Delivery]) -> Schedule:
    """In the order of arrival; what arrives at once keeps its order."""
    return tuple(sorted(deliveries, key=lambda delivery: delivery.arrival))


def _chosen(schedule: Schedule, fraction: float, generator: np.random.Generator) -> set[int]:
    count = round(fraction * len(schedule))
    return set(generator.choice(len(schedule), count, replace=False).tolist())


def _require_fraction(fraction: float) -> None:
    if not 0 <= fraction <= 1:
        raise InputError(f"fraction {fraction} of deliveries with a fault must lie in [0, 1]")


def _require_delay(delay: float) -> None:
    if not (np.isfinite(delay) and delay >= 0):
        raise InputError(f"delay of {delay} s must be finite and at least 0")
