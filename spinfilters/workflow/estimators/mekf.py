"""The multiplicative EKF."""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter
from spinfilters.state.status import Verdict
from spinfilters.workflow.estimator_entry import EstimatorEntry
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings


class MultiplicativeEntry(EstimatorEntry):
    """A multiplicative filter: it continues with the landmarks of the initialisation."""

    is_default = True
    holds_landmarks = True

    def begin(self, estimator: Estimator, prepared: Prepared) -> None:
        assert isinstance(estimator, MultiplicativeFilter)
        estimator.start(prepared.belief)

    def points(
        self, estimator: Estimator, history: EstimateHistory, prepared: Prepared
    ) -> Float[np.ndarray, "k 3"] | None:
        """Those of the initialisation where it failed or the map was known."""
        if history.status.verdict is Verdict.FAILED or not isinstance(prepared.belief, LandmarkBelief):
            return prepared.map_points
        assert isinstance(estimator, MultiplicativeFilter)
        return estimator.landmark_belief.points_in_g

    def false_alarm_probability(self, prepared: Prepared, settings: Settings) -> float:
        return 1.0 - settings.robust.gate_probability


class MekfEntry(MultiplicativeEntry):
    """See `MultiplicativeEkf`."""

    name, order = "mekf", 0

    def build(self, prepared: Prepared, settings: Settings) -> Estimator:
        return MultiplicativeEkf(
            prepared.process, settings.robust, settings.adaptation, settings.iteration, settings.landmarks
        )


ESTIMATOR = MekfEntry()
