"""Table entries of the filters of this package: an entry each."""

import numpy as np
from jaxtyping import Float

from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.invariant_ekf import InvariantEkf
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.filters.joint_ekf import JointEkf
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.filters.rauch_tung_striebel import smooth_backwards
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.inference.estimator_entry import EstimatorEntry
from spinfilters.inference.setup import Setup
from spinfilters.inference.stated_noise import adapted_levels, identified_scales
from spinfilters.models.status import Verdict
from spinfilters.settings.run_settings import Settings

UNTIL_CONVERGED = IterationOptions(iterations=30, tolerance=1e-6)
"""Of the iterated filter: to a millionth of a standard deviation, whatever the linear model promises."""


class MultiplicativeEntry(EstimatorEntry[MultiplicativeFilter]):
    """A multiplicative filter: it continues with the landmarks of the initialisation."""

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


class UkfEntry(MultiplicativeEntry):
    """Table entry of `MultiplicativeUkf`."""

    name, order = "ukf", 1

    def build(self, setup: Setup, settings: Settings) -> MultiplicativeUkf:
        """The multiplicative UKF with the run's options."""
        return MultiplicativeUkf(
            setup.process, settings.ukf, settings.robust, settings.adaptation, settings.landmarks
        )


class IteratedEntry(MultiplicativeEntry):
    """Table entry of the iterated EKF: the MEKF, every update of which is iterated until it converges."""

    name, order = "iekf", 8

    def build(self, setup: Setup, settings: Settings) -> MultiplicativeEkf:
        """The multiplicative EKF with updates iterated to convergence."""
        return MultiplicativeEkf(
            setup.process, settings.robust, settings.adaptation, UNTIL_CONVERGED, settings.landmarks
        )


class RauchTungStriebelEntry(MekfEntry):
    """Table entry of the fixed-interval smoother of the MEKF: the same run, then `smooth_backwards`.

    Epochs of the initialisation stay as the initialisation has smoothed them.
    """

    name, order = "rts", 9
    holds_landmarks = False

    def final(
        self, estimator: MultiplicativeFilter, passed: EstimateHistory, setup: Setup
    ) -> EstimateHistory | None:
        """Every epoch given all measurements, linearised where the MEKF was."""
        if passed.status.verdict is Verdict.FAILED:
            return None
        return smooth_backwards(setup.process, passed).preceded_by(setup.initial_arrays)


class InvariantEntry(MultiplicativeEntry):
    """Table entry of `InvariantEkf`."""

    name, order = "invariant", 10
    holds_landmarks = False

    def build(self, setup: Setup, settings: Settings) -> InvariantEkf:
        """The invariant EKF with the run's options."""
        return InvariantEkf(setup.process, settings.robust, settings.adaptation, settings.invariant)


class JointEntry(EstimatorEntry[JointEkf]):
    """Table entry of `JointEkf`."""

    name, order = "ekf-joint", 11
    is_baseline = True
    holds_landmarks = True

    def build(self, setup: Setup, settings: Settings) -> JointEkf:
        """The EKF with all landmarks in its state."""
        return JointEkf(setup.process, settings.robust)

    def begin(self, estimator: JointEkf, setup: Setup) -> None:
        """Start with the initialisation's belief, landmarks included."""
        estimator.start(setup.belief)

    def points(
        self, estimator: JointEkf, history: EstimateHistory, setup: Setup
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks of its state; those of the setup without estimated ones."""
        return estimator.points if setup.initial.has_landmarks else setup.map_points

    def false_alarm_probability(self, setup: Setup, settings: Settings) -> float:
        """One minus the gate's probability."""
        return 1.0 - settings.robust.gate_probability
