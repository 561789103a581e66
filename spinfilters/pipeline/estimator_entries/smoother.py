"""The smoother: epoch by epoch for unmapped tracks, else all at once."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.smoothing.window.recursive_smoother import RecursiveSmoother
from spinfilters.estimators.timeline import Timeline
from spinfilters.pipeline.estimator_entry import EstimatorEntry, OnEpoch
from spinfilters.pipeline.setup import Setup
from spinfilters.pipeline.smoother_run import (
    NAME,
    begin_after_initialisation,
    sliding_smoother,
    smooth_at_once,
    smoothed_history,
)
from spinfilters.settings.run_settings import Settings


@dataclass(frozen=True)
class BatchSmoother:
    """Batch smoother of sensors without landmarks, by `smooth_at_once`."""

    setup: Setup
    settings: Settings

    def smooth(self, timeline: Timeline, initial: InitialEstimate, on_epoch: OnEpoch) -> EstimateHistory:
        """Smooth from the trajectory of an EKF that continues the initialisation."""
        own = replace(self.setup, timeline=timeline, initial=initial)
        return smooth_at_once(own, self.settings, on_epoch)


class SmootherEntry(EstimatorEntry[RecursiveSmoother]):
    """Recursive for tracks without a map (`RecursiveSmoother`), batch for everything else (`BatchSmoother`)."""

    name, order = NAME, 2
    is_default = True
    holds_landmarks = True
    continues = False

    def batch(self, setup: Setup, settings: Settings) -> BatchSmoother | None:
        """The batch smoother where no landmarks are estimated, else None."""
        return None if setup.initial.has_landmarks else BatchSmoother(setup, settings)

    def build(self, setup: Setup, settings: Settings) -> RecursiveSmoother:
        """The sliding smoother with the run's options."""
        return sliding_smoother(setup, settings)

    def begin(self, estimator: RecursiveSmoother, setup: Setup) -> None:
        """Begin with the epochs of the initialisation."""
        begin_after_initialisation(estimator, setup)

    def final(
        self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup
    ) -> EstimateHistory | None:
        """Smoothed estimates of all epochs."""
        return smoothed_history(estimator, passed, setup)

    def points(
        self, estimator: RecursiveSmoother, history: EstimateHistory, setup: Setup
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks (k, 3), m, frame g, of the last window."""
        return estimator.sliding.window.points

    def false_alarm_probability(self, setup: Setup, settings: Settings) -> float:
        """Chi-square tail beyond the gate, zero of other losses."""
        if settings.smoother.loss != "gate":
            return 0.0
        dimension = max(sensor_format(sensor).dimension for sensor in setup.dataset.log.sensors)
        return float(chdtrc(dimension, settings.smoother.width**2))
