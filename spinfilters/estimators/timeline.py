"""Timeline: epochs of a measurement log, bound to sensor models.

The one place where the two meet; in the order of time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import overload

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.sensor_format import SensorNoise
from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement
from spinfilters.sensors.sensor import CameraView
from spinfilters.sensors.sensor_registry import sensor_of
from spinfilters.state.layout import StateLayout


@dataclass(frozen=True, slots=True)
class Epoch:
    """All measurements of one instant (s)."""

    time: float
    measurements: tuple[Measurement, ...]


Timeline = Sequence[Epoch]
"""Epochs in the order of time."""


@dataclass(frozen=True, eq=False)
class SensorTimeline:
    """All measurements of one sensor, and which of them belong to each epoch.

    Attributes
    ----------
    every: all values as if they were measured at once.   first, end: (k,) epoch k holds the values from first to before end.
    """

    every: Measurement
    first: Int[np.ndarray, " k"]
    end: Int[np.ndarray, " k"]

    def measured(self, epoch: int) -> list[Measurement]:
        """The measurement of an epoch, none where the sensor measured nothing then."""
        every, rows = self.every, slice(int(self.first[epoch]), int(self.end[epoch]))
        if rows.start == rows.stop:
            return []
        ids = None if every.ids is None else every.ids[rows]
        return [Measurement(every.model, every.values[rows], every.parameters[rows], ids)]

    def at_once(self) -> "SensorEpochs":
        """The measurements of all its epochs."""
        counts = self.end - self.first
        epoch = np.repeat(np.arange(len(counts)), counts)
        before = np.cumsum(counts) - counts
        rows = np.repeat(self.first - before, counts) + np.arange(len(epoch))
        every = self.every
        ids = None if every.ids is None else every.ids[rows]
        return SensorEpochs(Measurement(every.model, every.values[rows], every.parameters[rows], ids), epoch)


@dataclass(frozen=True, eq=False)
class SensorEpochs:
    """All measurements of one sensor in some epochs, with the epoch of each value."""

    measurement: Measurement
    epoch: Int[np.ndarray, " r"]


@dataclass(frozen=True, eq=False)
class LogTimeline(Sequence[Epoch]):
    """Epochs of a log, made when they are asked for.

    A long recording stays a few arrays.

    Attributes
    ----------
    time: (k,) s.   sensors: in the order in which each epoch takes them in.
    """

    time: Float[np.ndarray, " k"]
    sensors: tuple[SensorTimeline, ...]

    def __len__(self) -> int:
        return len(self.time)

    @overload
    def __getitem__(self, index: int) -> Epoch: ...

    @overload
    def __getitem__(self, index: slice) -> "LogTimeline": ...

    def __getitem__(self, index: int | slice) -> "Epoch | LogTimeline":
        if isinstance(index, slice):
            parts = (replace(part, first=part.first[index], end=part.end[index]) for part in self.sensors)
            return LogTimeline(self.time[index], tuple(parts))
        return Epoch(float(self.time[index]), tuple(m for part in self.sensors for m in part.measured(index)))


@singledispatch
def times_of(epochs: Timeline) -> Float[np.ndarray, " k"]:
    """Times of epochs, s."""
    return np.fromiter((epoch.time for epoch in epochs), float, len(epochs))


@times_of.register
def _(epochs: LogTimeline) -> Float[np.ndarray, " k"]:
    """Without making any epoch."""
    return epochs.time


@singledispatch
def by_sensor(epochs: Timeline) -> list[SensorEpochs]:
    """Measurements of epochs by sensor, those with and without ids apart."""
    parts: dict[tuple[int, bool], tuple[list[Measurement], list[int]]] = {}
    for k, epoch in enumerate(epochs):
        for m in epoch.measurements:
            measurements, numbers = parts.setdefault((id(m.model), m.ids is None), ([], []))
            measurements.append(m)
            numbers.append(k)
    return [_joined(*part) for part in parts.values()]


@by_sensor.register
def _(epochs: LogTimeline) -> list[SensorEpochs]:
    """Without making any epoch."""
    return [found for part in epochs.sensors if len((found := part.at_once()).epoch)]


def _joined(measurements: Sequence[Measurement], numbers: Sequence[int]) -> SensorEpochs:
    """One sensor's measurements, one epoch after the other."""
    first, counts = measurements[0], [len(m.values) for m in measurements]
    values, parameters = (
        np.concatenate([getattr(m, name) for m in measurements]) for name in ("values", "parameters")
    )
    ids = [m.ids for m in measurements if m.ids is not None]
    every = Measurement(first.model, values, parameters, np.concatenate(ids) if ids else None)
    return SensorEpochs(every, np.repeat(numbers, counts))


def distinct(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
    """Distinct times in ascending order.

    Sorted where need be alone, as one stream's are not.
    """
    step = np.diff(time)
    return time[np.r_[True, step > 0]] if len(time) and (step >= 0).all() else np.unique(time)


def build_timeline(
    log: MeasurementLog, layout: StateLayout, noise: SensorNoise, view: CameraView | None = None
) -> Timeline:
    """Epochs of a log over a state layout.

    Sensors that measure at the same stamp share an epoch.
    Rows whose landmark is not in a known map are left out.

    Raises
    ------
    InputError: rows of a camera without a view, or a log without any usable measurement.
    """
    bound = [sensor_of(stream.sensor).bind(stream, layout, noise, view) for stream in log.streams]
    time = distinct(np.concatenate([each.time for each in bound]))
    if not len(time):
        raise InputError(
            "the log holds no usable measurement; check that landmark ids of the tracks and of the map agree"
        )
    ends = [np.searchsorted(each.time, time, "right") for each in bound]
    parts = [
        SensorTimeline(
            Measurement(each.model, each.values, each.parameters, each.ids),
            np.concatenate([[0], end[:-1]]),
            end,
        )
        for each, end in zip(bound, ends, strict=True)
    ]
    return LogTimeline(time, tuple(parts))
