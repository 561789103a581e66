"""Seeded measurement faults of a data set.

The truth, the map and what was not hit stay as they are.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import InputError
from spinfilters.sensors.sensor_registry import sensor_of


class Fault(ABC):
    """Fault of measurements. A subclass is a frozen dataclass of its parameters."""

    @abstractmethod
    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with this fault; InputError where it cannot have it."""


def with_faults(dataset: Dataset, faults: Sequence[Fault], seed: int) -> Dataset:
    """Data set after all faults, whose draws depend on seed and place."""
    for fault, sequence in zip(faults, np.random.SeedSequence(seed).spawn(len(faults)), strict=True):
        dataset = fault.apply(dataset, np.random.default_rng(sequence))
    return dataset


@dataclass(frozen=True)
class WrongAssociations(Fault):
    """A ``fraction`` of each epoch's landmark rows exchange their landmarks.

    Rounded; at least two, or none; in a ring.
    """

    fraction: float

    def __post_init__(self) -> None:
        _require_fraction(self.fraction)

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with ids exchanged, epoch by epoch."""
        stream = landmark_stream(dataset)
        ids = _ids(stream).copy()
        for rows in epoch_rows(stream):
            count = round(self.fraction * len(rows))
            if count > 1:
                chosen = generator.choice(rows, count, replace=False)
                ids[chosen] = ids[np.roll(chosen, 1)]
        return with_stream(dataset, replace(stream, ids=ids))


@dataclass(frozen=True)
class Outliers(Fault):
    """Replacement of a ``fraction`` of a sensor's rows by outliers.

    Their distribution is the sensor's (`spinfilters.sensors.sensor.Sensor.outliers`).   sensor: None for that of the kind.
    """

    fraction: float
    sensor: str | None = None

    def __post_init__(self) -> None:
        _require_fraction(self.fraction)

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with outliers of the sensor's own distribution."""
        stream = dataset.log.stream(self.sensor or dataset.sensor)
        values = stream.values.copy()
        rows = generator.choice(len(values), round(self.fraction * len(values)), replace=False)
        values[rows] = sensor_of(stream.sensor).outliers(len(rows), dataset.rig, generator)
        return with_stream(dataset, replace(stream, values=values))


@dataclass(frozen=True)
class Dropout(Fault):
    """No sensor says anything from ``start`` to ``end`` (s, both included)."""

    start: float
    end: float

    def __post_init__(self) -> None:
        if not self.start <= self.end:
            raise InputError(f"a dropout from {self.start} s to {self.end} s; give an end after the start")

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set without the gap. InputError: a sensor would have no measurement left."""
        left = []
        for stream in dataset.log.streams:
            kept = np.flatnonzero((stream.time < self.start) | (stream.time > self.end))
            if not kept.size:
                raise InputError(
                    f"a dropout from {self.start} s to {self.end} s leaves no {stream.sensor} measurement; shorten it"
                )
            left.append(stream_rows(stream, kept))
        return replace(dataset, log=MeasurementLog(tuple(left)))


@dataclass(frozen=True)
class FrozenFrames(Fault):
    """A sensor repeats epoch ``frame`` in the ``count`` epochs that follow.

    0 is its first; under their own stamps.
    """

    frame: int
    count: int
    sensor: str | None = None

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with the repeated epochs. InputError: epochs outside the recording."""
        stream = dataset.log.stream(self.sensor or dataset.sensor)
        epochs, times = epoch_rows(stream), stream.epoch_times
        last = self.frame + self.count
        if not 0 <= self.frame <= last < len(epochs):
            raise InputError(
                f"epochs {self.frame} to {last} are not all among the {len(epochs)} of the {stream.sensor} measurements"
            )
        shown = [self.frame if self.frame <= k <= last else k for k in range(len(epochs))]
        repeated = stream_rows(
            stream, np.concatenate([epochs[k] for k in shown]), times.repeat([len(epochs[k]) for k in shown])
        )
        return with_stream(dataset, repeated)


@dataclass(frozen=True)
class PointsAtInfinity(Fault):
    """Every epoch shows ``count`` points at infinity, off the body.

    Fixed pixels, no disparity, white noise on each.
    They bear ids of their own, above all others; ``pixel_std`` in px. Their values are such as track files may hold.
    """

    count: int
    pixel_std: float = 1.0

    def __post_init__(self) -> None:
        if self.count < 1 or not self.pixel_std > 0:
            raise InputError(
                f"{self.count} points with {self.pixel_std} px; give at least 1, and a positive noise"
            )

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with the far points in every epoch."""
        stream = landmark_stream(dataset)
        sensor, times = sensor_of(stream.sensor), stream.epoch_times
        exact = np.tile(sensor.points_at_infinity(self.count, dataset.rig, generator), (len(times), 1))
        far = MeasurementStream(
            stream.sensor,
            times.repeat(self.count),
            sensor.storable(exact + self.pixel_std * generator.standard_normal(exact.shape)),
            np.tile(_ids(stream).max() + 1 + np.arange(self.count), len(times)),
            np.tile(self.pixel_std**2 * np.eye(exact.shape[1]), (len(exact), 1, 1)),
        )
        return with_stream(dataset, _merged(stream, far))


def landmark_stream(dataset: Dataset) -> MeasurementStream:
    """The stream of landmarks. InputError where there is none."""
    for stream in dataset.log.streams:
        if sensor_format(stream.sensor).has_landmarks:
            return stream
    raise InputError(
        f"no landmarks among {', '.join(dataset.log.sensors)} measurements; choose another fault"
    )


def _merged(stream: MeasurementStream, more: MeasurementStream) -> MeasurementStream:
    """Rows of both in the order of time; covariances where the first has them."""
    time = np.concatenate([stream.time, more.time])
    order = np.argsort(time, kind="stable")
    covariance = None
    if stream.covariance is not None and more.covariance is not None:
        covariance = np.concatenate([stream.covariance, more.covariance])[order]
    values = np.concatenate([stream.values, more.values])[order]
    ids = np.concatenate([_ids(stream), _ids(more)])[order]
    return MeasurementStream(stream.sensor, time[order], values, ids, covariance)


def stream_rows(
    stream: MeasurementStream, rows: Int[np.ndarray, " k"], time: Float[np.ndarray, " k"] | None = None
) -> MeasurementStream:
    """These rows, under their own stamps or others."""
    ids = None if stream.ids is None else stream.ids[rows]
    covariance = None if stream.covariance is None else stream.covariance[rows]
    return MeasurementStream(
        stream.sensor, stream.time[rows] if time is None else time, stream.values[rows], ids, covariance
    )


def epoch_rows(stream: MeasurementStream) -> list[Int[np.ndarray, " k"]]:
    """Rows of every epoch."""
    return np.split(np.arange(len(stream)), stream.epoch_offsets[1:-1])


def with_stream(dataset: Dataset, stream: MeasurementStream) -> Dataset:
    """The data set with another stream of that sensor."""
    streams = [stream if old.sensor == stream.sensor else old for old in dataset.log.streams]
    return replace(dataset, log=MeasurementLog(tuple(streams)))


def _ids(stream: MeasurementStream) -> Int[np.ndarray, " n"]:
    assert stream.ids is not None  # a stream of landmarks always has them
    return stream.ids


def _require_fraction(fraction: float) -> None:
    if not 0 <= fraction <= 1:
        raise InputError(f"fraction {fraction} of measurements with a fault must lie in [0, 1]")
