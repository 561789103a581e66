"""The smoother: epoch by epoch for tracks without a map, all epochs at once for everything else."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from spinfilters.estimators.contracts import OnEpoch
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.smoothing.recursive import RecursiveSmoother
from spinfilters.estimators.timeline import Timeline
from spinfilters.logs.sensor_format import sensor_format
from spinfilters.workflow.estimator_entry import EstimatorEntry
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings
from spinfilters.workflow.smoothing import (
    NAME,
    begin_at_start,
    sliding_smoother,
    smooth_at_once,
    smoothed_history,
)


@dataclass(frozen=True)
class BatchSmoother:
    """See `smooth_at_once`."""

    prepared: Prepared
    settings: Settings

    def smooth(self, timeline: Timeline, initial: InitialEstimate, on_epoch: OnEpoch) -> EstimateHistory:
        """From where the filter of first order passes, which goes on from the initialisation."""
        own = replace(self.prepared, timeline=timeline, start=initial)
        return smooth_at_once(own, self.settings, on_epoch)


class SmootherEntry(EstimatorEntry[RecursiveSmoother]):
    """Recursive for tracks without a map (`RecursiveSmoother`), batch for everything else (`BatchSmoother`)."""

    name, order = NAME, 2
    is_default = True
    holds_landmarks = True
    continues = False

    def batch(self, prepared: Prepared, settings: Settings) -> BatchSmoother | None:
        return None if prepared.start.has_landmarks else BatchSmoother(prepared, settings)

    def build(self, prepared: Prepared, settings: Settings) -> RecursiveSmoother:
        return sliding_smoother(prepared, settings)

    def begin(self, estimator: RecursiveSmoother, prepared: Prepared) -> None:
        begin_at_start(estimator, prepared)

    def final(
        self, estimator: RecursiveSmoother, passed: EstimateHistory, prepared: Prepared
    ) -> EstimateHistory:
        return smoothed_history(estimator, passed, prepared)

    def points(
        self, estimator: RecursiveSmoother, history: EstimateHistory, prepared: Prepared
    ) -> Float[np.ndarray, "k 3"] | None:
        return estimator.sliding.window.points

    def false_alarm_probability(self, prepared: Prepared, settings: Settings) -> float:
        if settings.smoother.kernel != "gate":
            return 0.0
        dimension = max(sensor_format(sensor).dimension for sensor in prepared.dataset.log.sensors)
        return float(chdtrc(dimension, settings.smoother.width**2))


ESTIMATOR = SmootherEntry()
