"""The smoother: epoch by epoch for tracks without a map, all epochs at once for everything else."""

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.smoothing.recursive import RecursiveSmoother
from spinfilters.logs.sensor_format import sensor_format
from spinfilters.workflow.estimator_entry import EstimatorEntry, OnEpoch
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings
from spinfilters.workflow.smoothing import (
    NAME,
    begin_at_start,
    sliding_smoother,
    smooth_at_once,
    smoothed_history,
)


class SmootherEntry(EstimatorEntry):
    """See `RecursiveSmoother` and `smooth_at_once`."""

    name, order = NAME, 2
    is_default = True
    holds_landmarks = True
    continues = False

    def build(self, prepared: Prepared, settings: Settings) -> Estimator | None:
        return sliding_smoother(prepared, settings)

    def begin(self, estimator: Estimator, prepared: Prepared) -> None:
        assert isinstance(estimator, RecursiveSmoother)
        begin_at_start(estimator, prepared)

    def at_once(self, prepared: Prepared, settings: Settings, on_epoch: OnEpoch) -> EstimateHistory:
        return smooth_at_once(prepared, settings, on_epoch)

    def final(self, estimator: Estimator, passed: EstimateHistory, prepared: Prepared) -> EstimateHistory:
        assert isinstance(estimator, RecursiveSmoother)
        return smoothed_history(estimator, passed, prepared)

    def points(
        self, estimator: Estimator, history: EstimateHistory, prepared: Prepared
    ) -> Float[np.ndarray, "k 3"] | None:
        assert isinstance(estimator, RecursiveSmoother)
        return estimator.sliding.window.points

    def false_alarm_probability(self, prepared: Prepared, settings: Settings) -> float:
        if settings.smoother.kernel != "gate":
            return 0.0
        dimension = max(sensor_format(sensor).dimension for sensor in prepared.dataset.log.sensors)
        return float(chdtrc(dimension, settings.smoother.width**2))


ESTIMATOR = SmootherEntry()
