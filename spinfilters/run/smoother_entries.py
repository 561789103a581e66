"""Table entries of the smoother: all epochs, the latest alone, and fixed lags."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import OnEpoch, Timeline
from spinfilters.inference.estimator_entry import EstimatorEntry
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import (
    NAME,
    begin_after_initialisation,
    sliding_smoother,
    smooth_and_sample,
    smoothed_history,
)
from spinfilters.io.sensor_format import sensor_format
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.recursive_smoother import RecursiveSmoother
from spinfilters.smoother.window import FixedLag


@dataclass(frozen=True)
class BatchSmoother:
    """Batch smoother of sensors without landmarks, by `smooth_and_sample`."""

    setup: Setup
    settings: Settings

    def smooth(self, timeline: Timeline, initial: InitialEstimate, on_epoch: OnEpoch) -> EstimateHistory:
        """Smooth from the trajectory of an EKF that continues the initialisation."""
        own = replace(self.setup, timeline=timeline, initial=initial)
        return smooth_and_sample(own, self.settings, on_epoch)


class SmootherEntry(EstimatorEntry[RecursiveSmoother]):
    """Recursive for tracks without a map (`RecursiveSmoother`), batch for everything else (`BatchSmoother`)."""

    name, order = NAME, 2
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
        return float(chi_square_tail(settings.smoother.width**2, dimension))


class LatestSmootherEntry(SmootherEntry):
    """Table entry of the smoother without revision by later measurements, to be compared with filters."""

    name, order = "smoother-latest", 7

    def batch(self, setup: Setup, settings: Settings) -> BatchSmoother | None:
        """None: it takes landmarks epoch by epoch.

        Raises
        ------
        InputError
            Measurements without landmarks to be found, all of whose epochs the smoother takes at once.
        """
        if not setup.initial.has_landmarks:
            raise InputError(f"{self.name} takes tracks without a map alone; choose smoother")
        return None

    def final(self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup) -> None:
        """None: what it said of each epoch as it came stands."""


class FixedLagEntry(SmootherEntry):
    """Table entry of the smoother with a fixed lag: an epoch leaves so many epochs behind the latest, and is final then.

    The window begins with the epochs of the initialisation. It is the same for all sensors, with landmarks or without.

    Parameters
    ----------
    lag : int
        Epochs between the latest and the one that leaves, at least; a fifth of a window leaves together.
    order : int
        Place in the table.
    """

    def __init__(self, lag: int, order: int) -> None:
        self.name, self.order, self.lag = f"smoother-lag-{lag}", order, lag

    def batch(self, setup: Setup, settings: Settings) -> None:
        """None: it is always recursive."""

    def build(self, setup: Setup, settings: Settings) -> RecursiveSmoother:
        """The sliding smoother whose window holds so many epochs behind the latest, however little of the inertia is known."""
        return sliding_smoother(setup, settings, FixedLag(self.lag + 1, determined=np.inf))

    def final(
        self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup
    ) -> EstimateHistory | None:
        """Every epoch as it left the window, those still in it as they are in the end."""
        return replace(smoothed_history(estimator, passed, setup), name=self.name)
