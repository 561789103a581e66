"""Out-of-sequence measurements: late, repeated or unordered ones, applied at their own times.

`EpochTrack` is an estimator with its latest epochs and the state after each: what comes late goes to its place, and what follows
is done again. `OutOfSequenceUpdates` puts single measurements on it, online; the live run puts whole epochs on it, and smoothed
beliefs (`spinfilters.live.filter_track`).
"""

import hashlib
from bisect import bisect_left
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.filters.estimator import Estimator, Measurement, Snapshot, UpdateReport
from spinfilters.filters.timeline import Epoch, advance, finite
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import EstimatorStatus


@dataclass(frozen=True)
class KeptEpoch:
    """An epoch and the estimator's state after it."""

    epoch: Epoch
    after: Snapshot

    @property
    def time(self) -> float:
        """Time of the epoch, s."""
        return self.epoch.time


class PlacedEpoch(NamedTuple):
    """Reports of an epoch's measurements, and how many epochs after it were done again."""

    reports: list[UpdateReport]
    replayed: int


class BrokenEstimateError(Exception):
    """The estimate would not have stayed finite."""


class EpochTrack:
    """A started estimator, and what it takes to go back.

    Every measurement is in the estimator's state once: to change an epoch is to go on from the state before it.

    Parameters
    ----------
    estimator : Estimator
        Started at ``time`` (s); it belongs to this object from now on.
    """

    def __init__(self, estimator: Estimator, time: float) -> None:
        self.estimator = estimator
        self._kept = [KeptEpoch(Epoch(time, ()), estimator.snapshot())]  # the first cannot be changed

    def __len__(self) -> int:
        """Number of epochs that can be changed."""
        return len(self._kept) - 1

    @property
    def time(self) -> float:
        """Time of the latest epoch, s."""
        return self._kept[-1].time

    @property
    def oldest(self) -> float:
        """Time to which one can go back, s."""
        return self._kept[0].time

    @property
    def belief(self) -> Gaussian:
        """Belief at the latest epoch."""
        return self.estimator.belief

    def epoch_at(self, time: float) -> Epoch | None:
        """The epoch of this time (s) that can be changed, None where there is none."""
        index = self._index(time)
        there = index < len(self._kept) and self._kept[index].time == time
        return self._kept[index].epoch if there else None

    def place(self, epoch: Epoch) -> PlacedEpoch:
        """Do an epoch at its time, instead of one that is there, and all later ones again.

        Raises
        ------
        BrokenEstimateError
            The estimate would not stay finite, here or in a later epoch; nothing has changed. Nor has it after another error.
        """
        index = self._index(epoch.time)
        later = [kept.epoch for kept in self._kept[index:] if kept.time > epoch.time]
        before, reports = self._kept[index - 1], list[list[UpdateReport]]()
        done = [before]
        try:
            if before is not self._kept[-1]:
                self.estimator.restore(before.after)
            for each in (epoch, *later):
                kept, found = advance_by(self.estimator, done[-1].time, each)
                done.append(kept)
                reports.append(found)
        except BaseException:  # Ctrl-C, or a measurement that does not suit the estimator, too
            self.estimator.restore(self._kept[-1].after)
            raise
        self._kept[index:] = done[1:]
        return PlacedEpoch(reports[0], len(later))

    def forget(self, count: int) -> None:
        """Drop the oldest epochs, so many; the last of them is what one can go back to."""
        if count > 0:
            del self._kept[:count]

    def times(self) -> list[float]:
        """Times of the epochs that can be changed, s."""
        return [kept.time for kept in self._kept[1:]]

    def _index(self, time: float) -> int:
        """Of the first epoch that can be changed and is not before a time."""
        return bisect_left(self._kept, time, lo=1, key=lambda kept: kept.time)


def advance_by(estimator: Estimator, time: float, epoch: Epoch) -> tuple[KeptEpoch, list[UpdateReport]]:
    """Predict from ``time`` (s) to an epoch and update by it. BrokenEstimateError: the estimate does not stay finite."""
    try:
        reports = advance(estimator, epoch, epoch.time - time)
        if not finite(estimator.belief, reports):
            raise BrokenEstimateError(f"epoch at {epoch.time} s")
    except NUMERICAL_ERRORS as error:
        raise BrokenEstimateError(str(numerical(error))) from error
    return KeptEpoch(epoch, estimator.snapshot()), reports


class MeasurementKey(NamedTuple):
    """Sensor and digest of all numbers of a measurement.

    The same for the same bits only, and an order that does not depend on arrival.
    """

    sensor: str
    digest: bytes

    @classmethod
    def of(cls, measurement: Measurement) -> "MeasurementKey":
        """Key of a measurement."""
        digest = hashlib.blake2b(digest_size=16)
        for array in (measurement.values, measurement.parameters, measurement.ids):
            digest.update(b"none" if array is None else f"{array.shape}".encode() + array.tobytes())
        return cls(measurement.model.name, digest.digest())


class Outcome(StrEnum):
    """Outcome of an out-of-sequence measurement."""

    TAKEN = "taken"
    """In, as the latest."""
    INSERTED = "inserted"
    """Applied at its own time, among the epochs or within one that were there before it."""
    DUPLICATE = "duplicate"
    """Left out: it is there already, bit for bit."""
    TOO_LATE = "too late"
    """Left out: older than what can be gone back to."""
    UNUSABLE = "unusable"
    """Left out: the estimate would not have stayed finite with it."""


@dataclass(frozen=True)
class OutOfSequenceResult:
    """Outcome of a measurement, with the epochs done again.

    Attributes
    ----------
    reason : str
        In words, empty where it went in.
    report : UpdateReport or None
        Of its update, None where it was left out.
    replayed : int
        How many epochs after it were done again.
    """

    outcome: Outcome
    reason: str = ""
    report: UpdateReport | None = None
    replayed: int = 0


class OutOfSequenceUpdates:
    """A started estimator that takes measurements as they come.

    Parameters
    ----------
    estimator : Estimator
        Started at ``time`` (s); it belongs to this object from now on.
    horizon_s : float
        How much older than the latest epoch a measurement may be.
    capacity : int
        Epochs that are kept at most, at least 1; where they span less than the horizon, that is what can be gone back to.
    """

    def __init__(
        self, estimator: Estimator, time: float, horizon_s: float = 2.0, capacity: int = 256
    ) -> None:
        if not np.isfinite(time):
            raise InputError(f"the estimator's time is {time} s; give a finite one")
        if not (np.isfinite(horizon_s) and horizon_s >= 0):
            raise InputError(f"horizon_s is {horizon_s}; give a finite number of seconds of at least 0")
        if capacity < 1:
            raise InputError(f"capacity is {capacity}; keep at least 1 epoch")
        self._horizon, self._capacity = horizon_s, capacity
        self._track, self._begin, self._closed = EpochTrack(estimator, time), time, -np.inf
        self._counts = dict.fromkeys(Outcome, 0)
        self._replayed = 0
        self._last_unusable = ""

    @property
    def time(self) -> float:
        """Time of the latest epoch, s."""
        return self._track.time

    @property
    def belief(self) -> Gaussian:
        """The belief at the latest epoch, after everything that came."""
        return self._track.belief

    @property
    def counts(self) -> dict[Outcome, int]:
        """Number of measurements by outcome."""
        return dict(self._counts)

    @property
    def kept_epochs(self) -> int:
        """Number of epochs that late measurements can go back to."""
        return len(self._track)

    @property
    def replayed_epochs(self) -> int:
        """Number of epochs done again because of late measurements."""
        return self._replayed

    @property
    def status(self) -> EstimatorStatus:
        """Estimator's status; ``degraded`` when late or unusable measurements were left out."""
        status, late = self._track.estimator.status, self._counts[Outcome.TOO_LATE]
        if late:
            status = status.degraded(
                f"{late} measurements came too late and were left out", "late-measurements"
            )
        if self._last_unusable:
            count = self._counts[Outcome.UNUSABLE]
            status = status.degraded(
                f"{count} measurements made the estimate infinite and were removed, the last {self._last_unusable}",
                "broken-measurements",
            )
        return status

    def receive(self, time: float, measurement: Measurement) -> OutOfSequenceResult:
        """Process one sensor's values of ``time`` (s), which may be out of sequence.

        Parameters
        ----------
        time : float
            Of the measurement, s; it may lie before the latest epoch.
        measurement : Measurement
            One sensor's values.

        Returns
        -------
        OutOfSequenceResult
            What became of it, with the estimator's report.

        Raises
        ------
        InputError
            A time that is not finite.
        """
        if not np.isfinite(time):
            raise InputError(
                f"a measurement of {measurement.model.name} has the time {time} s; give a finite one"
            )
        result = self._receive(float(time), _copy_measurement(measurement))
        self._counts[result.outcome] += 1
        self._replayed += result.replayed
        return result

    def belief_at(self, time: float) -> Gaussian:
        """Belief predicted to a time (s) at or after the latest epoch, without changing the estimator.

        Parameters
        ----------
        time : float
            At or after the latest epoch, s.

        Returns
        -------
        Gaussian
            Belief of that time.

        Raises
        ------
        InputError
            A time before the latest epoch, or not finite.
        """
        track = self._track
        if not (np.isfinite(time) and time >= track.time):
            raise InputError(
                f"the belief at {time} s was requested, the latest epoch is at {track.time} s; ask for a time from there on"
            )
        if time == track.time:
            return self.belief
        now = track.estimator.snapshot()
        try:
            track.estimator.predict(time - track.time)
            return track.belief
        finally:
            track.estimator.restore(now)

    def _receive(self, time: float, measurement: Measurement) -> OutOfSequenceResult:
        if reason := self._reject_late(time):
            return OutOfSequenceResult(Outcome.TOO_LATE, reason)
        key, there = MeasurementKey.of(measurement), self._track.epoch_at(time)
        # Measurements of one time go in in the order of their keys, whichever came first.
        joined = {MeasurementKey.of(m): m for m in (() if there is None else there.measurements)}
        if key in joined:
            reason = f"the same {key.sensor} measurement of {time} s is there already"
            return OutOfSequenceResult(Outcome.DUPLICATE, reason)
        joined[key] = measurement
        order = sorted(joined)
        outcome = Outcome.TAKEN if there is None and not time < self.time else Outcome.INSERTED
        try:
            placed = self._track.place(Epoch(time, tuple(joined[each] for each in order)))
        except BrokenEstimateError as error:
            self._last_unusable = f"{key.sensor} at {time} s"
            return OutOfSequenceResult(
                Outcome.UNUSABLE, f"the estimate does not stay finite with it ({error})"
            )
        self._forget()
        return OutOfSequenceResult(outcome, report=placed.reports[order.index(key)], replayed=placed.replayed)

    def _reject_late(self, time: float) -> str:
        """Why a time cannot be gone back to; empty where it can."""
        if time < self._begin:
            return f"it is of {time} s, the estimate begins at {self._begin} s"
        if time < self.time - self._horizon:
            return f"it is {self.time - time:.3f} s older than the latest epoch, the horizon is {self._horizon} s"
        if time <= self._closed:
            return f"it is of {time} s, and only the {len(self._track)} epochs after {self._closed} s are kept (capacity)"
        return ""

    def _forget(self) -> None:
        """Drop epochs beyond the horizon or the capacity, but for the latest."""
        times = self._track.times()
        count = max(bisect_left(times, self.time - self._horizon), len(times) - self._capacity)
        self._track.forget(count)
        if count > 0:
            self._closed = self._track.oldest


def _copy_measurement(measurement: Measurement) -> Measurement:
    """Copy of a measurement with arrays of its own: on line, buffers are used again."""
    ids = None if measurement.ids is None else measurement.ids.copy()
    return Measurement(measurement.model, measurement.values.copy(), measurement.parameters.copy(), ids)
