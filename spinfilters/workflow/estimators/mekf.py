"""The multiplicative EKF."""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.multiplicative_filter import MultiplicativeFilter
from spinfilters.state.status import Verdict
from spinfilters.workflow.estimator_entry import EstimatorEntry
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings


class MultiplicativeEntry(EstimatorEntry[MultiplicativeFilter]):
    """A multiplicative filter: it continues with the landmarks of the initialisation."""

    is_default = True
    holds_landmarks = True

    def begin(self, estimator: MultiplicativeFilter, prepared: Prepared) -> None:
        estimator.start(prepared.belief)

    def points(
        self, estimator: MultiplicativeFilter, history: EstimateHistory, prepared: Prepared
    ) -> Float[np.ndarray, "k 3"] | None:
        """Those of the initialisation where it failed or the map was known."""
        if history.status.verdict is Verdict.FAILED or not prepared.start.has_landmarks:
            return prepared.map_points
        return estimator.landmark_belief.points_in_g

    def false_alarm_probability(self, prepared: Prepared, settings: Settings) -> float:
        return 1.0 - settings.robust.gate_probability


class MekfEntry(MultiplicativeEntry):
    """See `MultiplicativeEkf`."""

    name, order = "mekf", 0

    def build(self, prepared: Prepared, settings: Settings) -> MultiplicativeEkf:
        return MultiplicativeEkf(
            prepared.process, settings.robust, settings.adaptation, settings.iteration, settings.landmarks
        )


ESTIMATOR = MekfEntry()
