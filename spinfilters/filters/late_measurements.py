"""Out-of-sequence measurements: late, repeated or unordered ones, applied at their own times."""

import hashlib
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import Estimator, Measurement, Snapshot, UpdateReport
from spinfilters.filters.timeline import Epoch, advance, finite
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import EstimatorStatus


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


@dataclass(frozen=True)
class _KeptEpoch:
    """An epoch, its time (s) and the state before it; ``keys`` name its measurements and give their order."""

    epoch: Epoch
    keys: tuple[MeasurementKey, ...]
    before: Snapshot
    time_before: float

    @property
    def time(self) -> float:
        """Time of the epoch, s."""
        return self.epoch.time


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
        self._estimator, self._horizon, self._capacity = estimator, horizon_s, capacity
        self._time, self._begin, self._closed = time, time, -np.inf
        self._epochs: list[_KeptEpoch] = []
        self._counts = dict.fromkeys(Outcome, 0)
        self._replayed = 0
        self._last_unusable = ""

    @property
    def time(self) -> float:
        """Time of the latest epoch, s."""
        return self._time

    @property
    def belief(self) -> Gaussian:
        """The belief at the latest epoch, after everything that came."""
        return self._estimator.belief

    @property
    def counts(self) -> dict[Outcome, int]:
        """Number of measurements by outcome."""
        return dict(self._counts)

    @property
    def kept_epochs(self) -> int:
        """Number of epochs that late measurements can go back to."""
        return len(self._epochs)

    @property
    def replayed_epochs(self) -> int:
        """Number of epochs done again because of late measurements."""
        return self._replayed

    @property
    def status(self) -> EstimatorStatus:
        """Estimator's status; ``degraded`` when late or unusable measurements were left out."""
        status, late = self._estimator.status, self._counts[Outcome.TOO_LATE]
        if late:
            status = status.degraded(
                f"{late} measurements came too late and were left out", "late-measurements"
            )
        if self._last_unusable:
            count = self._counts[Outcome.UNUSABLE]
            status = status.degraded(
                f"{count} measurements broke the estimate and were taken back, the last {self._last_unusable}",
                "broken-measurements",
            )
        return status

    def receive(self, time: float, measurement: Measurement) -> OutOfSequenceResult:
        """Process one sensor's values of ``time`` (s), which may be out of sequence.

        Raises
        ------
        InputError
            A time that is not finite.
        """
        if not np.isfinite(time):
            raise InputError(
                f"a measurement of {measurement.model.name} has the time {time} s; give a finite one"
            )
        result = self._received(float(time), _copied(measurement))
        self._counts[result.outcome] += 1
        self._replayed += result.replayed
        return result

    def belief_at(self, time: float) -> Gaussian:
        """Belief predicted to a time (s) at or after the latest epoch, without changing the estimator.

        Raises
        ------
        InputError
            A time before the latest epoch, or not finite.
        """
        if not (np.isfinite(time) and time >= self._time):
            raise InputError(
                f"the belief at {time} s was asked for, the latest epoch is at {self._time} s; ask for a time from there on"
            )
        if time == self._time:
            return self.belief
        now = self._estimator.snapshot()
        try:
            self._estimator.predict(time - self._time)
            return self._estimator.belief
        finally:
            self._estimator.restore(now)

    def _received(self, time: float, measurement: Measurement) -> OutOfSequenceResult:
        if reason := self._too_late(time):
            return OutOfSequenceResult(Outcome.TOO_LATE, reason)
        key, index = (
            MeasurementKey.of(measurement),
            bisect_left(self._epochs, time, key=lambda kept: kept.time),
        )
        there = (
            self._epochs[index] if index < len(self._epochs) and self._epochs[index].time == time else None
        )
        if there is not None and key in there.keys:
            return OutOfSequenceResult(
                Outcome.DUPLICATE, f"the same {key[0]} measurement of {time} s is there already"
            )
        after = self._epochs[index + (there is not None) :]
        epoch, keys = _joined(there, time, measurement, key)
        outcome = Outcome.INSERTED if there is not None or after else Outcome.TAKEN
        return self._placed(index, _Placing(epoch, keys, keys.index(key), after, outcome))

    def _too_late(self, time: float) -> str:
        """Why a time cannot be gone back to; empty where it can."""
        if time < self._begin:
            return f"it is of {time} s, the estimate begins at {self._begin} s"
        if time < self._time - self._horizon:
            return f"it is {self._time - time:.3f} s older than the latest epoch, the horizon is {self._horizon} s"
        if time <= self._closed:
            return f"it is of {time} s, and only the {len(self._epochs)} epochs after {self._closed} s are kept (capacity)"
        return ""

    def _placed(self, index: int, placing: "_Placing") -> OutOfSequenceResult:
        """Replay from before an epoch, or restore everything if that fails."""
        now = self._estimator.snapshot()
        before, time_before = now, self._time
        if index < len(self._epochs):
            before, time_before = self._epochs[index].before, self._epochs[index].time_before
            self._estimator.restore(before)
        try:
            report, done = self._replay(placing, before, time_before)
        except (np.linalg.LinAlgError, _NotFiniteError) as error:
            self._estimator.restore(now)
            self._last_unusable = f"{placing.keys[placing.position].sensor} at {placing.epoch.time} s"
            return OutOfSequenceResult(
                Outcome.UNUSABLE, f"the estimate does not stay finite with it ({error})"
            )
        except (
            BaseException
        ):  # Ctrl-C, or a measurement that does not suit the estimator: the caller's, and nothing has changed
            self._estimator.restore(now)
            raise
        self._epochs[index:] = done
        self._time = done[-1].time
        self._forget()
        return OutOfSequenceResult(placing.outcome, report=report, replayed=len(placing.after))

    def _replay(
        self, placing: "_Placing", before: Snapshot, time_before: float
    ) -> tuple[UpdateReport, list[_KeptEpoch]]:
        """Replay epochs from the present state.

        Returns the report of the inserted measurement, and the epochs with the states before them.
        """
        first = _KeptEpoch(placing.epoch, placing.keys, before, time_before)
        reports = self._advance(first)
        done = [first]
        for kept in placing.after:
            done.append(replace(kept, before=self._estimator.snapshot(), time_before=done[-1].time))
            self._advance(done[-1])
        return reports[placing.position], done

    def _advance(self, kept: _KeptEpoch) -> list[UpdateReport]:
        reports = advance(self._estimator, kept.epoch, kept.time - kept.time_before)
        if not finite(self._estimator.belief, reports):
            raise _NotFiniteError(f"epoch at {kept.time} s")
        return reports

    def _forget(self) -> None:
        """Drop epochs beyond the horizon or the capacity, but for the latest."""
        oldest = self._time - self._horizon
        count = bisect_left(self._epochs, oldest, key=lambda kept: kept.time)
        count = max(count, len(self._epochs) - self._capacity)
        if count > 0:
            self._closed = self._epochs[count - 1].time
            del self._epochs[:count]


@dataclass(frozen=True)
class _Placing:
    """Epoch with a newly inserted measurement, and the epochs after it."""

    epoch: Epoch
    keys: tuple[MeasurementKey, ...]
    position: int
    after: Sequence[_KeptEpoch]
    outcome: Outcome


class _NotFiniteError(Exception):
    """The estimate stopped being finite."""


def _copied(measurement: Measurement) -> Measurement:
    """Copy of a measurement with arrays of its own: on line, buffers are used again."""
    ids = None if measurement.ids is None else measurement.ids.copy()
    return Measurement(measurement.model, measurement.values.copy(), measurement.parameters.copy(), ids)


def _joined(
    there: _KeptEpoch | None, time: float, measurement: Measurement, key: MeasurementKey
) -> tuple[Epoch, tuple[MeasurementKey, ...]]:
    """An epoch with one more measurement, in the order of the keys, and those keys."""
    if there is None:
        return Epoch(time, (measurement,)), (key,)
    pairs = [*zip(there.keys, there.epoch.measurements, strict=True), (key, measurement)]
    pairs.sort(key=lambda pair: pair[0])
    return Epoch(time, tuple(m for _, m in pairs)), tuple(k for k, _ in pairs)
