"""The multiplicative EKF."""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.filters.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.filters.multiplicative_filter import MultiplicativeFilter
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.identification.components import VarianceComponent
from spinfilters.pipeline.estimator_entry import EstimatorEntry
from spinfilters.pipeline.filter_noise import adapted_levels, identified_scales
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import Verdict


class MultiplicativeEntry(EstimatorEntry[MultiplicativeFilter]):
    """A multiplicative filter: it continues with the landmarks of the initialisation."""

    is_default = True
    holds_landmarks = True

    def begin(self, estimator: MultiplicativeFilter, setup: Setup) -> None:
        """Start with the initialisation's belief and noise scales."""
        estimator.adapt_from(identified_scales(setup))
        estimator.start(setup.belief)

    def noise(
        self, estimator: MultiplicativeFilter, history: EstimateHistory, setup: Setup
    ) -> tuple[VarianceComponent, ...]:
        """Noise levels as adapted, beside those of the initialisation."""
        return adapted_levels(setup, estimator.level)

    def points(
        self, estimator: MultiplicativeFilter, history: EstimateHistory, setup: Setup
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks of the filter; those of the setup after a failure or without estimated ones."""
        if history.status.verdict is Verdict.FAILED or not setup.initial.has_landmarks:
            return setup.map_points
        return estimator.landmark_belief.points_in_g

    def false_alarm_probability(self, setup: Setup, settings: Settings) -> float:
        """One minus the gate's probability."""
        return 1.0 - settings.robust.gate_probability


class MekfEntry(MultiplicativeEntry):
    """Table entry of `MultiplicativeEkf`."""

    name, order = "mekf", 0

    def build(self, setup: Setup, settings: Settings) -> MultiplicativeEkf:
        """The multiplicative EKF with the run's options."""
        return MultiplicativeEkf(
            setup.process, settings.robust, settings.adaptation, settings.iteration, settings.landmarks
        )
