"""filterpy's EKF, a plain baseline."""

from spinfilters.estimators.estimator import Estimator
from spinfilters.pipeline.estimator_entry import EstimatorEntry
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings


class FilterpyEkfEntry(EstimatorEntry[Estimator]):
    """Table entry of `spinfilters.estimators.baselines.filterpy_filters.FilterpyEkf`."""

    name, order = "filterpy-ekf", 3
    is_baseline = True

    def build(self, setup: Setup, settings: Settings) -> Estimator:
        """filterpy's EKF on the run's process."""
        from spinfilters.estimators.baselines.filterpy_filters import (
            FilterpyEkf,  # slow to import, rarely asked for
        )

        return FilterpyEkf(setup.process)


ESTIMATOR = FilterpyEkfEntry()
