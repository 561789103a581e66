"""Recursive estimator over the sliding-window smoother.

Time and belief move with every prediction, measurements come one by one.
"""

from collections.abc import Sequence

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator, Measurement, ProcessModel, Snapshot, UpdateReport
from spinfilters.estimators.filters.belief_prediction import predict_ahead
from spinfilters.estimators.smoothing.factors.motion_factors import StatePrior
from spinfilters.estimators.smoothing.problem.least_squares import InitialGuess
from spinfilters.estimators.smoothing.window.momentum_restart import RetrySchedule
from spinfilters.estimators.smoothing.window.sliding_smoother import SlidingSmoother
from spinfilters.estimators.smoothing.window.smoother_records import (
    MarginalizedState,
    SmootherOptions,
    SmootherState,
    UpdateResult,
)
from spinfilters.estimators.smoothing.window.window_arrays import window_arrays, window_of
from spinfilters.estimators.timeline import Epoch, Timeline
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import POSE_BLOCKS
from spinfilters.state.status import EstimatorStatus

_RETIRED = ("time", "mean", "factor")


class RecursiveSmoother(Estimator):
    """A sliding smoother that takes measurements as they come; those of one instant make one epoch.

    An epoch is made by the first measurement of an instant, and solved again with every further one, or once for all that come by
    `update_all`. Where nothing was measured the belief is predicted, and no epoch is made.

    Parameters
    ----------
    sensors: those of a run whose snapshot another object is to restore, in the same order; others join as they speak.
    """

    name = "smoother"

    def __init__(
        self,
        process: ProcessModel,
        options: SmootherOptions | None = None,
        sensors: Sequence[MeasurementModel] = (),
    ) -> None:
        super().__init__(process)
        self.begun: list[UpdateResult] = []
        """What `begin` did, epoch by epoch."""
        self._options, self._sensors = options or SmootherOptions(), list(sensors)
        n = self.layout.error_dim
        self._begun(Gaussian(self.layout, self.layout.origin(), np.full((n, n), np.nan)))

    def start(self, belief: Gaussian) -> None:
        """Begin from a belief at time 0 with all its correlations.

        The pose of the landmarks' frame g is as certain as the belief says.
        """
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._begun(belief)
        self.sliding.add(Epoch(0.0, ()))
        self._time, self._belief = 0.0, belief

    def begin(self, prior: StatePrior, epochs: Timeline, first: InitialGuess) -> list[UpdateResult]:
        """Begin with the smoothed epochs of an initialisation.

        From the states and landmarks that it found for them.

        Parameters
        ----------
        prior: of the first epoch's state; its pose says where g is.
        """
        self._begun(prior)
        for epoch in epochs:
            self._meet(epoch.measurements)
        self.begun = self.sliding.begin(epochs, first.trajectory, first.ids, first.points)
        self._time, self._belief = epochs[-1].time, self.sliding.belief
        return self.begun

    @property
    def belief(self) -> Gaussian:
        """Belief of the present time given all measurements so far."""
        return self._belief

    @property
    def status(self) -> EstimatorStatus:
        """Whether the belief can be relied upon already: see `SlidingSmoother.status`."""
        return self.sliding.status

    def predict(self, dt: float) -> None:
        """Predict dt > 0 seconds ahead. The window stays as it is until something is measured."""
        ahead = predict_ahead(self.process, self._belief, np.array([dt]))
        self._time, self._belief = self._time + dt, ahead.belief(0)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Take in one sensor's values at the present time, beside what was measured then already."""
        return self.update_all((measurement,))[0]

    def update_all(self, measurements: Sequence[Measurement]) -> list[UpdateReport]:
        """Take in what was measured at the present time, and solve once."""
        if not measurements:
            return []
        self._meet(measurements)
        if self.sliding.window.epochs[-1].time < self._time:
            taken = self.sliding.add(Epoch(self._time, tuple(measurements)))
        else:
            taken = self.sliding.extend(tuple(measurements))
        self.marginalized += taken.marginalized
        self._belief = self.sliding.belief
        return [UpdateReport(0.0, 0, accepted, rejected) for accepted, rejected in taken.counts]

    def update_epochs(self, epochs: Sequence[Epoch]) -> None:
        """Add several later epochs and solve once."""
        measured = [epoch for epoch in epochs if epoch.measurements]
        for epoch in measured:
            self._meet(epoch.measurements)
        if measured:
            self.marginalized += self.sliding.add_all(measured).marginalized
            self._time, self._belief = measured[-1].time, self.sliding.belief
        if epochs and epochs[-1].time > self._time:
            self.predict(epochs[-1].time - self._time)

    def smoothed(self) -> list[MarginalizedState]:
        """Every epoch so far, those in the window iterated until nothing moves."""
        self.sliding.settle()
        return [*self.marginalized, *self.sliding.smoothed()]

    def snapshot(self) -> Snapshot:
        """Copies of the whole internal state."""
        m = self.sliding.state
        flags = [
            m.prior_alive,
            m.poor_guess,
            m.determined,
            m.retry_schedule.next,
            m.retry_schedule.retry,
            m.mass_std,
            m.fits,
        ]
        marginalized = {
            name: np.array([getattr(row, name) for row in self.marginalized])
            for name in _RETIRED
            if self.marginalized
        }
        return {
            **marginalized,
            **window_arrays(self.sliding.window, self._sensors),
            "flags": np.array([self._time, *flags], dtype=float),
            "prior_mean": self._prior.mean.copy(),
            "prior_factor": self._prior.factor.copy(),
            "belief_mean": self._belief.mean.copy(),
            "belief_factor": self._belief.factor.copy(),
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot. The smoother must have met the same sensors in the same order."""
        window = window_of(self.layout, snapshot, self._sensors)
        self._begun(Gaussian(self.layout, snapshot["prior_mean"].copy(), snapshot["prior_factor"].copy()))
        self._time, alive, poor_guess, determined, is_due, retry, std, fits = map(float, snapshot["flags"])
        retry_schedule = RetrySchedule(is_due, retry)
        state = SmootherState(bool(alive), bool(poor_guess), int(determined), retry_schedule, std, bool(fits))
        self.sliding.resume(window, state)
        mean, factor = snapshot["belief_mean"].copy(), snapshot["belief_factor"].copy()
        self._belief = Gaussian(self.layout, mean, factor)
        kept = [snapshot[name] for name in _RETIRED if name in snapshot]
        self.marginalized = [MarginalizedState(float(t), m, f) for t, m, f in zip(*kept, strict=True)]

    def _begun(self, prior: StatePrior) -> None:
        """Begin with this prior and no epoch."""
        self._prior, self.marginalized = prior, list[MarginalizedState]()
        has_landmarks = self.layout.blocks[:2] == POSE_BLOCKS
        self.sliding = SlidingSmoother(self.process, prior, self._options, has_landmarks)
        self._time, self._belief = 0.0, Gaussian(self.layout, prior.mean, prior.factor)

    def _meet(self, measurements: Sequence[Measurement]) -> None:
        """Give new sensors a number."""
        for m in measurements:
            if not any(known is m.model for known in self._sensors):
                self._sensors.append(m.model)
