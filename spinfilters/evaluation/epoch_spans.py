"""Epochs over which estimators are evaluated and compared: errors, NEES and used observations within a span of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.conventions import PerRun
from spinfilters.evaluation.consistency import NormalisedErrors
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.stated_errors import stated_errors
from spinfilters.evaluation.trajectory_errors import RmsErrors, TruthErrors, common_stamps, rows_within
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import Timeline, by_sensor, times_of
from spinfilters.io.truth import Truth

ALWAYS: Final = -np.inf
"""Begin of a span that leaves nothing out, s."""
NO_SENSOR: Final = "none"
"""Name of the epochs in which nothing was measured."""
IDENTICAL = "Estimators on identical measurements"
NOT_IDENTICAL = "Estimators on the same recording, each on the observations that it used"


@dataclass(frozen=True)
class ObservationUse:
    """Numbers of used and unused observations of some epochs.

    Attributes
    ----------
    accepted, rejected : (n,) int array
        Numbers of observations used, and rejected; of many runs (r, n).
    available : (n,) int array or None
        All of them, None where unknown.
    """

    accepted: Int[np.ndarray, "*r n"]
    rejected: Int[np.ndarray, "*r n"]
    available: Int[np.ndarray, " n"] | None

    @property
    def used_per_epoch(self) -> PerRun:
        """Mean number of used observations per epoch."""
        return self.accepted.mean(axis=-1)

    @property
    def available_per_epoch(self) -> float | None:
        """Mean number of available observations per epoch; None if unknown."""
        return None if self.available is None else float(self.available.mean())

    @property
    def share(self) -> PerRun | None:
        """Used share of the available observations, 0 to 1; None if unknown."""
        available = self.available
        return None if available is None else self.accepted.sum(axis=-1) / max(available.sum(), 1)

    @property
    def uses_all(self) -> bool:
        """Whether every observation is known to have been used."""
        return self.available is not None and np.array_equal(self.accepted, self.available)


def observation_use(history: EstimateHistory, begin: float, end: float = np.inf) -> ObservationUse | None:
    """Use of observations in the estimator's own epochs from begin to end (s), both within; None without any."""
    within = rows_within(history.time, begin, end)
    rows = slice(max(within.start, history.initialisation), within.stop)
    if rows.start >= rows.stop:
        return None
    available = None if history.observations is None else history.observations[rows]
    return ObservationUse(history.accepted[..., rows], history.rejected[..., rows], available)


def use_by_sensor(history: EstimateHistory, timeline: Timeline) -> dict[str, dict[str, int]]:
    """Measurements used and rejected in an estimator's own epochs, by sensor.

    An estimator counts them by epoch. Where several sensors measured in one epoch and only some of it was used, the epoch counts
    under all of their names, as "gyro, pose".

    Parameters
    ----------
    history : EstimateHistory
        Of the estimator.
    timeline : Timeline
        Of the recording, with its epochs among others.

    Returns
    -------
    dict[str, dict[str, int]]
        By name of the sensor or sensors, "accepted" and "rejected".
    """
    parts, time = by_sensor(timeline), times_of(timeline)
    names = list(dict.fromkeys(part.measurement.model.name for part in parts))
    came = np.zeros((len(time), len(names)), dtype=int)  # values by epoch and sensor
    for part in parts:
        came[:, names.index(part.measurement.model.name)] += np.bincount(part.epoch, minlength=len(time))
    places = np.minimum(np.searchsorted(time, history.time[history.own]), len(time) - 1)
    found: dict[str, dict[str, int]] = {name: {"accepted": 0, "rejected": 0} for name in names}
    kinds = np.column_stack([came[places], history.accepted[history.own], history.rejected[history.own]])
    for kind, epochs in _counted_rows(kinds):
        *values, accepted, rejected = kind
        counts = {name: count for name, count in zip(names, values, strict=True) if count}
        whole = {"accepted": accepted, "rejected": rejected}
        key = next(
            (name for name in whole if whole[name] == sum(counts.values()) == accepted + rejected), None
        )
        if len(counts) == 1 or key is None:
            each = found.setdefault(", ".join(counts) or NO_SENSOR, {"accepted": 0, "rejected": 0})
            for name, count in whole.items():
                each[name] += epochs * count
        else:  # all of the epoch, of several sensors, was used or rejected
            for sensor, count in counts.items():
                found[sensor][key] += epochs * count
    return found


def _counted_rows(rows: Int[np.ndarray, "n k"]) -> list[tuple[list[int], int]]:
    """Different rows in the order of their first appearance, and how often each is there."""
    if not len(rows):
        return []
    number = np.zeros(len(rows), dtype=np.int64)  # of the row among those that differ in the columns so far
    for column in rows.T:
        number = np.unique(number * (column.max() + 1) + column, return_inverse=True)[1]
    _, first, times = np.unique(number, return_index=True, return_counts=True)
    order = np.argsort(first)
    return list(zip(rows[first[order]].tolist(), times[order].tolist(), strict=True))


@dataclass(frozen=True)
class EpochSpan:
    """An evaluation, of one run or of many, within a span of time: what every metric is computed from.

    Attributes
    ----------
    evaluation : Evaluation
        Of one estimator.
    begin, end : float
        First and last time, s, both within; `own_span` leaves out a filter's initialisation.
    """

    evaluation: Evaluation
    begin: float = ALWAYS
    end: float = np.inf

    @cached_property
    def errors(self) -> TruthErrors | None:
        """Errors within the span; None without a truth there."""
        errors = self.evaluation.errors
        return None if errors is None else errors.within(self.begin, self.end)

    @cached_property
    def truth(self) -> Truth | None:
        """The truth at the epochs of `errors`, stamp by stamp, in the estimate's frames i and g.

        None without a truth, and where g was fitted (`Alignment.BODY_FRAME`).
        """
        truth = self.evaluation.truth_in_own_frames
        if truth is None or self.errors is None:
            return None
        return truth.chosen(common_stamps(self.errors.time, truth.time)[1])

    @cached_property
    def states(self) -> Float[np.ndarray, "n m"] | None:
        """Estimated states at the epochs of `errors`; None without a truth there."""
        return None if self.errors is None else self.evaluation.history.mean[self.errors.rows]

    @cached_property
    def rms(self) -> RmsErrors | None:
        """Root mean squares of the errors."""
        return None if self.errors is None else self.errors.rms

    @cached_property
    def bound(self) -> RmsErrors | None:
        """Root mean squares of the Cramer-Rao bound over the same epochs; None where there is no bound."""
        bound = self.evaluation.bound
        return None if bound is None or self.errors is None else bound.over(self.errors.rows)

    @cached_property
    def nees(self) -> NormalisedErrors | None:
        """NEES within the span: of the whole state, or of a gyro's estimate that of rate and mass distribution."""
        evaluation = self.evaluation
        whole = evaluation.rotation_nees if evaluation.nees is None else evaluation.nees
        return None if whole is None else whole.within(self.begin, self.end)

    @cached_property
    def use(self) -> ObservationUse | None:
        """Use of observations in the estimator's own epochs; None without any."""
        return observation_use(self.evaluation.history, self.begin, self.end)

    @cached_property
    def worst_stated_error(self) -> tuple[PerRun, PerRun] | None:
        """Quantity with the largest error after the last epoch, and that in its stated standard deviations."""
        found = stated_errors(self.evaluation)
        if not found:
            return None
        errors = np.array(list(found.values()))
        return np.array(list(found))[errors.argmax(axis=0)], errors.max(axis=0)


def own_span(evaluation: Evaluation) -> EpochSpan:
    """The epochs that an estimator has made itself, which a filter has after its initialisation."""
    begin = evaluation.own_begin
    return EpochSpan(evaluation, np.inf if begin is None else begin)


def shared_begin(evaluations: Sequence[Evaluation]) -> float:
    """Time of the first own epoch common to all estimators that have any, s; `ALWAYS` where none has."""
    begins = [evaluation.own_begin for evaluation in evaluations]
    return max((begin for begin in begins if begin is not None), default=ALWAYS)


def shared_span(evaluation: Evaluation, shared: float) -> EpochSpan:
    """An estimator's own epochs from ``shared`` on, the time of `shared_begin`, s."""
    return EpochSpan(evaluation, max(own_span(evaluation).begin, shared))


def second_half(evaluation: Evaluation) -> EpochSpan:
    """An estimator's own epochs after the middle of the recording, where nothing of the beginning shows."""
    time = evaluation.history.time
    return EpochSpan(evaluation, max(own_span(evaluation).begin, float(time[0] + time[-1]) / 2))


def initialisation_end(evaluations: Sequence[Evaluation]) -> float | None:
    """Time of the last epoch of the filters' initialisation, s; None where no estimator has one."""
    ends = [evaluation.history.initialisation_end for evaluation in evaluations]
    return max((end for end in ends if end is not None), default=None)


def on_identical_measurements(evaluations: Sequence[Evaluation]) -> bool:
    """Whether every estimator used every observation of the epochs that all of them have."""
    begin = shared_begin(evaluations)
    uses = [observation_use(evaluation.history, begin) for evaluation in evaluations]
    epochs = {len(use.accepted) for use in uses if use is not None}
    return len(epochs) == 1 and all(use is not None and use.uses_all for use in uses)


def title_sentences(evaluations: Sequence[Evaluation]) -> list[str]:
    """Title sentences of a comparison; empty for a single estimator."""
    if len(evaluations) == 1:
        return []
    return [IDENTICAL if on_identical_measurements(evaluations) else NOT_IDENTICAL]


FAR_ORIGIN: Final = 1e4
"""Time of the first epoch, s, from which a clock counts from something else than the recording, such as 1970."""


def clock_text(time: float) -> str:
    """Digits of a time, s, of any clock: milliseconds where its origin is far."""
    return f"{time:.6g}" if abs(time) < FAR_ORIGIN else f"{time:.3f}"


def time_text(time: float, first: float) -> str:
    """A time, s, of a clock that shows ``first`` at the first epoch.

    As it is, or after that epoch where the clock's origin is far.
    """
    if abs(first) < FAR_ORIGIN:
        return f"t = {time:.6g} s"
    return f"{time - first:.6g} s after the first epoch (t = {clock_text(first)} s)"


def epoch_sentences(evaluations: Sequence[Evaluation]) -> list[str]:
    """Sentence on the epochs of the errors; none without an initialisation."""
    history = max((e.history for e in evaluations), key=lambda history: history.initialisation)
    begin, count = shared_begin(evaluations), history.initialisation
    if not count or begin == ALWAYS:
        return []
    since = time_text(begin, float(history.time[0]))
    own = {e.name: int(np.count_nonzero(e.history.time[e.history.own] >= begin)) for e in evaluations}
    if len(set(own.values())) == 1:
        epochs = (
            f"the {next(iter(own.values()))} epochs from {since} on, which every estimator computed itself"
        )
    else:
        each = ", ".join(f"{name.upper()} {number}" for name, number in own.items())
        epochs = f"every estimator's own epochs from {since} on ({each})"
    if count == 1:  # smoothed ones are more
        return [f"Errors, NEES, NIS and counts: over {epochs}. The epoch before is the stated belief."]
    return [
        f"Errors, NEES, NIS and counts: over {epochs}. The {count} epochs before are the initialisation, by a smoother."
    ]
