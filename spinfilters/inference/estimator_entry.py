"""Interface of an estimator in a comparison: recursive, or batch over all epochs."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

from spinfilters.settings.run_settings import NamedEstimator

if TYPE_CHECKING:
    from spinfilters.filters.estimator import Estimator
    from spinfilters.filters.history import EstimateHistory
    from spinfilters.filters.noise_levels import VarianceComponent
    from spinfilters.filters.timeline import OnEpoch, Timeline
    from spinfilters.inference.initial_estimate import InitialEstimate
    from spinfilters.inference.setup import Setup
    from spinfilters.settings.run_settings import Settings


Built = TypeVar("Built", bound="Estimator")


class BatchEstimator(Protocol):
    """All epochs given all measurements."""

    def smooth(
        self, timeline: "Timeline", initial: "InitialEstimate", on_epoch: "OnEpoch"
    ) -> "EstimateHistory":
        """States and covariances of every epoch, those of the initialisation among them.

        Parameters
        ----------
        timeline : Timeline
            All epochs.
        initial : InitialEstimate
            Smoothed first epochs, where the iterations may begin.
        on_epoch : OnEpoch
            Called with the number of epochs done and of all.
        """
        ...


class EstimatorEntry(NamedEstimator, ABC, Generic[Built]):
    """An estimator of the table.

    A subclass states its attributes and writes `build`; what else it does differently it overrides.
    It is recursive (a `LatestBelief`, or an `Estimator` with a state of its own), or for some data sets batch.

    Attributes
    ----------
    name : str
        As in ``--estimators``; also its folder in a run.
    order : int
        Place in the table and in messages.
    holds_landmarks : bool
        Whether it takes tracks without a known map.
    is_baseline : bool
        Whether it is another project's estimator to compare with, whose disagreement says nothing of ours.
    continues : bool
        Whether it continues from the initialisation, so that doubts about that are doubts about it.
    forgets : bool
        Of one that does not: whether it keeps linearisations of epochs that have left, and is compared with the smoother for that.
    tests_noise : bool
        Whether its covariances show wrong noise: each is predicted as F P F' + Q from the one before. A filter that widens its
        prediction on purpose, as by a forgetting factor, sets it to False.
    """

    holds_landmarks: bool = False
    is_baseline: bool = False
    continues: bool = True
    forgets: bool = False
    tests_noise: bool = True

    @abstractmethod
    def build(self, setup: "Setup", settings: "Settings") -> Built:
        """The recursive estimator, not begun.

        Parameters
        ----------
        setup : Setup
            Process, timeline and initialisation of the data set.
        settings : Settings
            Of the run.

        Returns
        -------
        Estimator
            That `begin` starts.

        Raises
        ------
        InputError
            It cannot take these measurements.
        """

    def batch(self, setup: "Setup", settings: "Settings") -> BatchEstimator | None:
        """The batch estimator of a data set; None where it is taken epoch by epoch.

        Parameters
        ----------
        setup, settings : Setup, Settings
            As of `build`.
        """
        return None

    def begin(self, estimator: Built, setup: "Setup") -> None:
        """Let it begin at the end of the initialisation.

        Parameters
        ----------
        estimator : Estimator
            From `build`.
        setup : Setup
            Holds the belief that it begins with.
        """
        estimator.start(setup.belief.state)

    def final(self, estimator: Built, passed: "EstimateHistory", setup: "Setup") -> "EstimateHistory | None":
        """Final estimates of all epochs, those of the initialisation among them.

        Parameters
        ----------
        estimator : Estimator
            After its last epoch.
        passed : EstimateHistory
            Its estimates of the epochs after the initialisation, as they came.
        setup : Setup
            Of the data set.

        Returns
        -------
        EstimateHistory or None
            None where the estimates as they came are final.
        """
        return None

    def noise(
        self, estimator: Built, history: "EstimateHistory", setup: "Setup"
    ) -> "tuple[VarianceComponent, ...]":
        """Identified levels of noise that it ended with; none where they are those of the initialisation.

        Parameters
        ----------
        estimator : Estimator
            After its last epoch.
        history : EstimateHistory
            Its final estimates.
        setup : Setup
            Of the data set.
        """
        return history.noise

    def points(
        self, estimator: Built, history: "EstimateHistory", setup: "Setup"
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks (k, 3) that it ended with, m, frame g; None without any.

        Parameters
        ----------
        estimator, history, setup : Estimator, EstimateHistory, Setup
            As of `noise`.
        """
        return setup.map_points

    def false_alarm_probability(self, setup: "Setup", settings: "Settings") -> float:
        """Probability of rejecting a measurement whose noise is as stated.

        Parameters
        ----------
        setup, settings : Setup, Settings
            As of `build`.
        """
        return 0.0


AnyEntry = EstimatorEntry[Any]


def begin_with_first_epoch(entry: AnyEntry, estimator: "Estimator", setup: "Setup") -> None:
    """Let an estimator begin; a filter from a given belief takes in the measurements of its epoch.

    A given belief holds before the measurements of the first epoch. A smoother from it has that epoch among its own, and a belief
    of smoothed epochs holds their measurements already.

    Parameters
    ----------
    entry : EstimatorEntry
        Of the estimator.
    estimator : Estimator
        From its `EstimatorEntry.build`.
    setup : Setup
        Of the data set.
    """
    entry.begin(estimator, setup)
    if entry.continues:
        setup.take_in_first_epoch(estimator)
