"""What errors of the calibration add to the covariance of estimates.

Smoother: S = P J'H by the factors of its linear problem (`spinfilters.estimators.model_errors.calibration_sensitivity`). Filter: it
runs once more for each independent error, with the measurements as they would be were the calibration wrong by one deviation, from
an initialisation that has moved by its own S; the difference is what Schmidt's recursion carries along, of whatever filter it is,
and costs nothing while it runs.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.consider_parameter import ConsideredDeviation
from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.model_errors.calibration_sensitivity import smoothed_sensitivity
from spinfilters.estimators.model_errors.hypotheses import solved_near
from spinfilters.estimators.model_errors.linear_rows import Sensitivity
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.run import run
from spinfilters.estimators.timeline import LogTimeline, Timeline, times_of
from spinfilters.pipeline.estimator_entry import AnyEntry
from spinfilters.pipeline.model_errors import (
    MOST_EPOCHS,
    MOST_EPOCHS_WITH_MAP,
    landmarks_placed,
    linear_problem,
)
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import Verdict

UNKNOWN: Final = (
    "what errors of the calibration do to it could not be computed: its deviations are of chance alone"
)


@dataclass(frozen=True)
class CalibrationErrors:
    """Of one run."""

    setup: Setup
    settings: Settings

    @property
    def considered(self) -> tuple[ConsideredDeviation, ...]:
        """Those that are not zero."""
        return tuple(each for each in self.setup.calibration if each.std > 0)

    def counted(self, history: EstimateHistory, entry: AnyEntry) -> EstimateHistory:
        """A history with what errors of the calibration add to its covariance; ``degraded`` where that cannot be computed."""
        if not self.considered or history.status.verdict is Verdict.FAILED:
            return history
        try:
            with np.errstate(all="ignore"):  # what is not finite becomes a status
                errors = self._of_filter(history, entry) if entry.continues else self._smoothed(history)
                known = errors is not None and np.isfinite(errors).all()
                counted = history.considering(errors) if errors is not None and known else None
        except NUMERICAL_ERRORS:
            counted = None
        if counted is None or not np.isfinite(counted.factor).all():
            return replace(history, status=history.status.degraded(UNKNOWN))
        return counted

    def _smoothed(self, history: EstimateHistory) -> Float[np.ndarray, "n e c"] | None:
        found = self._sensitivity(self.setup.timeline[: len(history.time)], history.mean)
        return None if found is None else found.states

    def _of_filter(self, history: EstimateHistory, entry: AnyEntry) -> Float[np.ndarray, "n e c"] | None:
        """Differences of the filter's estimates from those of data with an error each."""
        begun = self._initialisation
        if begun is None:
            return None
        columns, first = [], history.initialisation
        for number, moved in enumerate(self._timelines(self.setup.timeline[: len(history.time)])):
            states = self._run(entry, moved, begun.states[:, :, number], begun.landmarks[:, :, number])
            if states is None or len(states) != len(history.time) - first:
                return None
            away = history.layout.local(history.mean[first:], states)
            columns.append(np.concatenate([begun.states[:first, :, number], away]))
        return np.stack(columns, axis=2)

    def _run(
        self,
        entry: AnyEntry,
        timeline: Timeline,
        states: Float[np.ndarray, "k e"],
        landmarks: Float[np.ndarray, "L 3"],
    ) -> Float[np.ndarray, "n m"] | None:
        """States of a filter behind an initialisation that has moved; None where it fails."""
        setup = self.setup
        mean = setup.process.layout.retract(setup.initial.mean, states)
        initial = replace(setup.initial, mean=mean, points=setup.initial.points + landmarks)
        belief = initial.joint_belief(self.settings.landmarks)
        moved = replace(setup, timeline=timeline, initial=initial, belief=belief)
        estimator = entry.build(moved, self.settings)
        entry.begin(estimator, moved)
        found = run(estimator, moved.end_of_initialisation, timeline[len(mean) :])
        return None if found.status.verdict is Verdict.FAILED else found.mean

    def _timelines(self, epochs: Timeline) -> Iterator[Timeline]:
        """The epochs under each independent error, by one deviation."""
        assert isinstance(epochs, LogTimeline)
        for each in self.considered:
            for error in each.std * np.eye(each.parameter.size):
                yield with_error(epochs, each, error)

    @cached_property
    def _initialisation(self) -> Sensitivity | None:
        """Of the initialisation; nothing of one that was given."""
        initial = self.setup.initial
        if self.setup.is_given:
            count = sum(each.parameter.size for each in self.considered)
            states = np.zeros((*initial.factor.shape[:2], count))
            return Sensitivity(states, np.zeros((*initial.points.shape, count)))
        return self._sensitivity(self.setup.timeline[: len(initial.mean)], initial.mean, initial.ids)

    def _sensitivity(
        self, epochs: Timeline, trajectory: Float[np.ndarray, "k m"], ids: Int[np.ndarray, " L"] | None = None
    ) -> Sensitivity | None:
        """Of epochs smoothed together; of a long recording of some of them, and between these interpolated."""
        most = MOST_EPOCHS_WITH_MAP if self.setup.initial.has_landmarks else MOST_EPOCHS
        rows = np.unique(np.linspace(0, len(trajectory) - 1, min(most, len(trajectory))).round().astype(int))
        chosen = epochs if len(rows) == len(trajectory) else [epochs[int(row)] for row in rows]
        problem = linear_problem(self.setup, chosen, ids)
        solved = solved_near(problem, trajectory[rows], landmarks_placed(problem, trajectory[rows]))
        if solved is None:
            return None
        found = smoothed_sensitivity(SmoothedMotion(times_of(chosen), solved), self.considered)
        return found if chosen is epochs else replace(found, states=_between(rows, found.states))


def with_error(epochs: LogTimeline, considered: ConsideredDeviation, error: np.ndarray) -> LogTimeline:
    """Epochs as they would be, were the calibration larger by an error."""
    parameter = considered.parameter
    if parameter.moved is None:
        begin = epochs.time[0]
        return replace(epochs, time=begin + (epochs.time - begin) * (1 + error[0]))
    sensors = []
    for part in epochs.sensors:
        every = part.every
        if every.model.name in parameter.sensors:
            changed = every.model.with_error(parameter.moved, error, every.values, every.parameters)
            part = replace(part, every=Measurement(every.model, *changed, every.ids))
        sensors.append(part)
    return replace(epochs, sensors=tuple(sensors))


def _between(rows: Int[np.ndarray, " r"], states: Float[np.ndarray, "r e c"]) -> Float[np.ndarray, "k e c"]:
    """Numbers of some rows, and of those between them by lines."""
    every = np.arange(rows[-1] + 1)
    behind = np.minimum(np.searchsorted(rows, every, "right"), len(rows) - 1)
    before = behind - 1
    share = ((every - rows[before]) / (rows[behind] - rows[before]))[:, None, None]
    return states[before] + share * (states[behind] - states[before])
