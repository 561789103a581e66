"""Epochs of a measurement log, bound to sensor models, and the only loop over time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import overload

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.core.working_time import working_seconds
from spinfilters.filters.estimator import EpochRun, Estimator, Measurement, SensorTimeline, UpdateReport
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.io.input_file import reason
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import SensorNoise
from spinfilters.models.rotation_integrator import IntegrationError
from spinfilters.models.sensor import CameraView
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.models.status import EstimatorStatus


@dataclass(frozen=True, slots=True)
class Epoch:
    """All measurements of one instant (s)."""

    time: float
    measurements: tuple[Measurement, ...]


Timeline = Sequence[Epoch]
"""Epochs in the order of time."""
OnEpoch = Callable[[int, int], None]
"""Called with epochs done and epochs in all."""


@dataclass(frozen=True, eq=False)
class SensorEpochs:
    """All measurements of one sensor in some epochs, with the epoch of each value."""

    measurement: Measurement
    epoch: Int[np.ndarray, " r"]

    @classmethod
    def of(cls, part: SensorTimeline) -> "SensorEpochs":
        """The measurements of all epochs of a timeline."""
        counts = part.end - part.first
        epoch = np.repeat(np.arange(len(counts)), counts)
        every, rows = part.every, slice(int(part.first[0]), int(part.end[-1])) if len(counts) else slice(0)
        if not np.array_equal(part.first[1:], part.end[:-1]):  # epochs do not lie one behind the other
            before = np.cumsum(counts) - counts
            rows = np.repeat(part.first - before, counts) + np.arange(len(epoch))
        ids = None if every.ids is None else every.ids[rows]
        return cls(Measurement(every.model, every.values[rows], every.parameters[rows], ids), epoch)


@dataclass(frozen=True, eq=False)
class LogTimeline(Sequence[Epoch]):
    """Epochs of a log, each made when it is asked for, so that a long recording stays a few arrays in memory.

    Attributes
    ----------
    time : ndarray of float, shape (k,)
        Time of each epoch, s.
    sensors : tuple[SensorTimeline, ...]
        In the order in which each epoch takes them in.
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
    return [_join_measurements(*part) for part in parts.values()]


@by_sensor.register
def _(epochs: LogTimeline) -> list[SensorEpochs]:
    """Without making any epoch."""
    return [found for part in epochs.sensors if len((found := SensorEpochs.of(part)).epoch)]


def _join_measurements(measurements: Sequence[Measurement], numbers: Sequence[int]) -> SensorEpochs:
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
    InputError
        Rows of a camera without a view, or a log without any usable measurement.
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


MOST_TOGETHER = 512
"""Epochs in one call at most: milliseconds, so that Ctrl-C, progress and checkpoints need not wait."""
MOST_VALUES = 50_000
"""Values of all sensors in one call, likewise."""
REHEARSED = 3
"""Epochs of a rehearsal: the third is predicted and updated from what the second left."""

NO_EPOCH_LEFT = (
    "no epoch is left after the start; give a longer recording or a shorter start (initialisation.epochs)"
)


def run(
    estimator: Estimator,
    time: float,
    timeline: Timeline,
    on_epoch: Callable[[int], None] | None = None,
    rows: GrowingHistory | None = None,
) -> EstimateHistory:
    """Take an estimator through a timeline.

    It is started or restored at ``time`` (s); the timeline begins then or later.
    A belief or likelihood that stops being finite, or numbers that a library cannot go on with (`NUMERICAL_ERRORS`), end the run
    with the status ``failed``; what was estimated up to there is returned. Ctrl-C passes through: what part of a run is worth,
    `run_interruptible` knows.

    Parameters
    ----------
    on_epoch : Callable[[int], None] or None
        Called with the index of the last epoch after one, or several in one call, are done; estimator and rows then belong
        together.
    rows : GrowingHistory or None
        Epochs done before, up to ``time``; those of the timeline are added to it.

    Raises
    ------
    InputError
        When the timeline is empty and no epoch was done before, or when it does not run forwards from ``time``.
    """
    rows = GrowingHistory(estimator.layout, time) if rows is None else rows
    _check(time, timeline, rows)
    status = EstimatorStatus()
    rows.reserve(len(rows) + len(timeline))
    try:
        index, together = 0, ends_of_runs(timeline)
        while index < len(timeline):
            done = _taken_together(estimator, timeline, slice(index, int(together[index])), rows)
            if not done:
                epoch, done = timeline[index], 1
                if not _take_in_epoch(estimator, epoch, rows):
                    where = f"epoch {len(rows)}, t = {epoch.time:.3f} s"
                    status = status.failed(f"the estimate stopped being finite at {where}")
                    break
            index += done
            if on_epoch is not None:
                on_epoch(index - 1)
    except IntegrationError as error:
        status = status.failed(f"the motion could not be integrated to epoch {len(rows)}: {error}")
    except np.linalg.LinAlgError as error:
        status = status.failed(f"the covariance could not be factorised at epoch {len(rows)} ({error})")
    except NUMERICAL_ERRORS as error:
        status = status.failed(f"epoch {len(rows)} could not be computed ({reason(numerical(error))})")
    return rows.ended(estimator.name, status)


def run_interruptible(
    estimator: Estimator,
    time: float,
    timeline: Timeline,
    on_epoch: Callable[[int], None],
    rows: GrowingHistory,
) -> EstimateHistory:
    """Run for a user who wants what was estimated up to Ctrl-C.

    Parameters and errors as `run`. Ctrl-C ends it as ``degraded``, with fewer epochs: its caller looks for that.
    """
    total = len(rows) + len(timeline)
    try:
        return run(estimator, time, timeline, on_epoch, rows)
    except KeyboardInterrupt:
        status = EstimatorStatus().degraded(f"interrupted after {len(rows)} of {total} epochs", "interrupted")
        return rows.ended(estimator.name, status)


@singledispatch
def ends_of_runs(epochs: Timeline) -> Int[np.ndarray, " k"]:
    """Of each epoch, the end of the run that begins with it and may be taken in by one call; itself for none."""
    return np.arange(len(epochs))


@ends_of_runs.register
def _(epochs: LogTimeline) -> Int[np.ndarray, " k"]:
    """Epochs without landmarks, as many as there may be in one call."""
    numbers, values = np.arange(len(epochs)), np.zeros(len(epochs), dtype=np.int64)
    plain = np.ones(len(epochs), dtype=bool)
    for part in epochs.sensors:
        counts = part.end - part.first
        values += counts
        if part.every.ids is not None:
            plain &= counts == 0
    last = np.where(plain, len(epochs), numbers)
    ends = np.minimum.accumulate(last[::-1])[::-1]
    # an epoch of more values than one call may have is still one
    before = np.cumsum(values) - values
    enough = np.maximum(np.searchsorted(before + values, before + MOST_VALUES, "right"), numbers + 1)
    return np.minimum.reduce([ends, numbers + MOST_TOGETHER, enough])


def _taken_together(estimator: Estimator, timeline: Timeline, chosen: slice, rows: GrowingHistory) -> int:
    """Take in a run of epochs, as many of it as one call can, and add them to the rows; how many."""
    if chosen.start == chosen.stop:
        return 0
    part = timeline[chosen]
    time = times_of(part)
    dt = np.diff(time, prepend=rows.time)
    if not dt[0] > 0:
        return 0
    begin = working_seconds()
    done = estimator.take_in(EpochRun(dt, sensors_of(part)), rows.room(len(dt)))
    spent = working_seconds() - begin
    if done:
        rows.extend(time[:done], spent / done)
    return done


@singledispatch
def sensors_of(epochs: Timeline) -> tuple[SensorTimeline, ...]:
    """Sensors of epochs, none where they were not kept by sensor."""
    return ()


@sensors_of.register
def _(epochs: LogTimeline) -> tuple[SensorTimeline, ...]:
    """As they are kept."""
    return epochs.sensors


def _take_in_epoch(estimator: Estimator, epoch: Epoch, rows: GrowingHistory) -> bool:
    """Take in an epoch and append the belief; False where it is not finite."""
    begin = working_seconds()
    reports = advance(estimator, epoch, epoch.time - rows.time)
    belief = estimator.belief
    if not finite(belief, reports):
        return False
    rows.append(epoch.time, belief, reports, working_seconds() - begin)
    return True


def rehearse(estimator: Estimator, time: float, timeline: Timeline) -> None:
    """Take an estimator through its first epochs beforehand.

    What it computes with is built before a clock runs.
    Functions belong to layouts, sensors and process models, so that another estimator of the same ones finds them built.

    Parameters
    ----------
    estimator : Estimator
        Started at ``time`` (s); of no use afterwards.
    """
    try:
        for epoch in timeline[:REHEARSED]:
            finite(estimator.belief, advance(estimator, epoch, epoch.time - time))
            time = epoch.time
        estimator.build_take_in([part.every.model for part in sensors_of(timeline)])
    except np.linalg.LinAlgError:  # which its run will meet, and report
        return


def advance(estimator: Estimator, epoch: Epoch, dt: float) -> list[UpdateReport]:
    """Predict an estimator ``dt`` >= 0 seconds ahead to an epoch, and update it by the epoch's measurements in order."""
    if dt > 0:
        estimator.predict(dt)
    return estimator.update_all(epoch.measurements)


def finite(belief: Gaussian, reports: list[UpdateReport]) -> bool:
    """Whether everything that an update leaves behind is finite."""
    sums = sum(report.nis + report.log_likelihood for report in reports)
    return bool(np.isfinite(sums) and np.isfinite(belief.mean).all() and np.isfinite(belief.factor).all())


def _check(time: float, timeline: Timeline, rows: GrowingHistory) -> None:
    if not timeline and not len(rows):
        raise InputError(NO_EPOCH_LEFT)
    if rows.time != time:
        raise InputError(f"the earlier epochs end at {rows.time} s; continue from there, not from {time} s")
    times = times_of(timeline)
    if len(times) and not times[0] >= time:
        raise InputError(f"the first epoch, t = {times[0]} s, lies before the belief, t = {time} s")
    bad = np.flatnonzero(~(times[1:] > times[:-1]))
    if bad.size:
        raise InputError(
            f"time goes from {times[bad[0]]} s to {times[bad[0] + 1]} s; epochs must be in the order of time"
        )
