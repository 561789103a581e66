"""The smoother of unmapped tracks as a filter, epoch by epoch.

What it says of each epoch when it comes.
"""

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.smoothing.window.recursive_smoother import RecursiveSmoother
from spinfilters.pipeline.estimator_entries.smoother import BatchSmoother, SmootherEntry
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings


class LatestSmootherEntry(SmootherEntry):
    """Table entry of the smoother without revision by later measurements.

    To be compared with filters.
    """

    name, order = "smoother-latest", 7
    is_default = False

    def batch(self, setup: Setup, settings: Settings) -> BatchSmoother | None:
        """None. InputError.

        Measurements without landmarks to be found, all of whose epochs the smoother takes at once.
        """
        if not setup.initial.has_landmarks:
            raise InputError(f"{self.name} takes tracks without a map alone; choose smoother")
        return None

    def final(self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup) -> None:
        """None: what it said of each epoch as it came stands."""
