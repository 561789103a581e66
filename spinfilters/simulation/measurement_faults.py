"""Faults of measurements: gaps, outliers, gross errors, lost and confused landmarks, and correlated errors."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import StateLayout


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
    """A ``fraction`` of each epoch's landmark rows, rounded, exchange their landmarks in a ring; at least two, or none."""

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

    Their distribution is the sensor's (`spinfilters.models.sensor.Sensor.outliers`).   sensor: None for that of the kind.
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
            left.append(stream.take(kept))
        return replace(dataset, log=MeasurementLog(tuple(left)))


@dataclass(frozen=True)
class FrozenEpochs(Fault):
    """A sensor repeats epoch ``epoch`` (0 is its first) in the ``count`` epochs that follow, under their own stamps."""

    epoch: int
    count: int
    sensor: str | None = None

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with the repeated epochs. InputError: epochs outside the recording."""
        stream = dataset.log.stream(self.sensor or dataset.sensor)
        epochs, times = epoch_rows(stream), stream.epoch_times
        last = self.epoch + self.count
        if not 0 <= self.epoch <= last < len(epochs):
            raise InputError(
                f"epochs {self.epoch} to {last} are not all among the {len(epochs)} of the {stream.sensor} measurements"
            )
        shown = [self.epoch if self.epoch <= k <= last else k for k in range(len(epochs))]
        repeated = stream.take(
            np.concatenate([epochs[k] for k in shown]), times.repeat([len(epochs[k]) for k in shown])
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
        return with_stream(dataset, _merge_streams(stream, far))


def landmark_stream(dataset: Dataset) -> MeasurementStream:
    """The stream of landmarks. InputError where there is none."""
    for stream in dataset.log.streams:
        if sensor_format(stream.sensor).has_landmarks:
            return stream
    raise InputError(
        f"no landmarks among {', '.join(dataset.log.sensors)} measurements; choose another fault"
    )


def _merge_streams(stream: MeasurementStream, more: MeasurementStream) -> MeasurementStream:
    """Rows of both in the order of time; covariances where the first has them."""
    time = np.concatenate([stream.time, more.time])
    order = np.argsort(time, kind="stable")
    covariance = None
    if stream.covariance is not None and more.covariance is not None:
        covariance = np.concatenate([stream.covariance, more.covariance])[order]
    values = np.concatenate([stream.values, more.values])[order]
    ids = np.concatenate([_ids(stream), _ids(more)])[order]
    return MeasurementStream(stream.sensor, time[order], values, ids, covariance)


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


MISSING: Final = "missing"
"""Kind that leaves out the measurement that the others spoil: what is left if an error is refused perfectly."""
KINDS: Final = ("outlier", "flipped", "turned", "identity", MISSING)
TURNED: Final = (0.3, np.pi)
"""Least and largest angle of a pose that is turned, rad."""


@dataclass(frozen=True)
class GrossError(Fault):
    """One measurement of an epoch is wrong altogether.

    Attributes
    ----------
    kind : str
        "outlier" (of the sensor's own distribution), "flipped" (a sign), "turned" (a pose), "identity" (two exchanged), "missing"
        (the measurement that these are of is left out; an epoch that has no other goes too).
    epoch : int
        Its number; negative ones count from the last.
    """

    kind: str
    epoch: int

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"a gross error {self.kind!r}; give one of {', '.join(KINDS)}")

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with the error.

        InputError: an epoch or a kind that it does not have.
        """
        stream = landmark_stream(dataset) if self.kind == "identity" else dataset.log.stream(dataset.sensor)
        epochs = epoch_rows(stream)
        if not -len(epochs) <= self.epoch < len(epochs):
            raise InputError(
                f"epoch {self.epoch} is none of the {len(epochs)} of {stream.sensor} measurements"
            )
        rows = epochs[self.epoch]
        if self.kind == "identity":
            return with_stream(dataset, _exchange_ids(stream, rows, generator))
        values, row = stream.values.copy(), int(generator.choice(rows))
        if self.kind == MISSING:
            return with_stream(dataset, stream.take(np.delete(np.arange(len(stream)), row)))
        values[row] = self._wrong(dataset, stream, row, generator)
        return with_stream(dataset, replace(stream, values=values))

    def _wrong(
        self, dataset: Dataset, stream: MeasurementStream, row: int, generator: np.random.Generator
    ) -> Float[np.ndarray, " v"]:
        """Values in the place of a row's."""
        right, sensor = stream.values[row], sensor_of(stream.sensor)
        if self.kind == "outlier":
            return sensor.outliers(1, dataset.rig, generator)[0]
        if self.kind == "flipped":
            return sensor.flipped(right)
        axis, angle = generator.standard_normal(3), generator.uniform(*TURNED)
        return sensor.turned(right, angle * axis / np.linalg.norm(axis))


def _exchange_ids(
    stream: MeasurementStream, rows: np.ndarray, generator: np.random.Generator
) -> MeasurementStream:
    """Two landmarks of these rows with each other's ids."""
    if len(rows) < 2:
        raise InputError("an epoch of one landmark has no two to exchange; choose another epoch")
    assert stream.ids is not None
    ids, two = stream.ids.copy(), generator.choice(rows, 2, replace=False)
    ids[two] = ids[two[::-1]]
    return replace(stream, ids=ids)


@dataclass(frozen=True)
class NewIds(Fault):
    """Landmarks bear new ids from ``start`` to before ``end`` (s).

    Each bears an id that it bears at no other time.
    """

    start: float
    end: float = np.inf

    def __post_init__(self) -> None:
        if not self.start < self.end:
            raise InputError(f"new ids from {self.start} s to {self.end} s; give an end after the start")

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with other ids in the interval."""
        stream = landmark_stream(dataset)
        assert stream.ids is not None
        hit = (stream.time >= self.start) & (stream.time < self.end)
        return with_stream(dataset, replace(stream, ids=stream.ids + hit * (stream.ids.max() + 1)))


@dataclass(frozen=True)
class FewAtFirst(Fault):
    """Before ``end`` (s) only a ``fraction`` of the landmarks, rounded, is seen; at least one."""

    fraction: float
    end: float

    def __post_init__(self) -> None:
        if not 0 < self.fraction <= 1:
            raise InputError(f"fraction {self.fraction} of landmarks seen at first must lie in (0, 1]")

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with few landmarks before the end."""
        stream = landmark_stream(dataset)
        assert stream.ids is not None
        ids = np.unique(stream.ids)
        seen = generator.choice(ids, max(round(self.fraction * len(ids)), 1), replace=False)
        kept = np.flatnonzero((stream.time >= self.end) | np.isin(stream.ids, seen))
        return with_stream(dataset, stream.take(kept))


def gauss_markov(
    white: Float[np.ndarray, "n k"], correlation: float | Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n k"]:
    """Errors of unit variance from white ones, each correlated with the row before.

    Parameters
    ----------
    white : ndarray of shape (n, k)
        Of unit variance.
    correlation : float or ndarray of shape (n,)
        Of all rows, or of every row; that of the first is not used.
    """
    errors, kept = white.copy(), np.broadcast_to(correlation, len(white))
    for k in range(1, len(errors)):
        errors[k] = kept[k] * errors[k - 1] + np.sqrt(1 - kept[k] ** 2) * white[k]
    return errors


def with_gauss_markov_errors(
    dataset: Dataset, std: Float[np.ndarray, " k"], correlation: float, generator: np.random.Generator
) -> Dataset:
    """The data set with Gauss-Markov errors added to its first stream.

    Parameters
    ----------
    dataset : Dataset
        Of rates, poses or landmarks.
    std : ndarray of shape (k,)
        Of rates, rad/s (3), of poses, m and rad (6), or of observations of landmarks, px, each landmark having errors of its own.
    correlation : float
        From epoch to epoch.
    generator : np.random.Generator
        Of the errors.
    """
    stream = dataset.log.streams[0]
    white = generator.standard_normal((len(stream), len(std)))
    if stream.ids is None:
        errors = std * gauss_markov(white, correlation)
        is_additive = stream.values.shape == errors.shape  # a quaternion has a number more than its error
        moved = StateLayout(("t", "a")).retract
        values = stream.values + errors if is_additive else moved(stream.values, errors)
        return with_stream(dataset, replace(stream, values=values))
    errors = np.zeros_like(stream.values)
    number = np.searchsorted(stream.epoch_times, stream.time).astype(float)  # of the epoch of each row
    for landmark in np.unique(stream.ids):
        rows = np.flatnonzero(stream.ids == landmark)
        kept = correlation ** np.diff(number[rows], prepend=0).astype(float)
        errors[rows] = std * gauss_markov(white[rows], kept)
    return with_stream(dataset, replace(stream, values=stream.values + errors))
