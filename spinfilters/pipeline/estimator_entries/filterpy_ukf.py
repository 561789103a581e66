"""filterpy's UKF, a plain baseline."""

from spinfilters.estimators.estimator import Estimator
from spinfilters.pipeline.estimator_entry import EstimatorEntry
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings


class FilterpyUkfEntry(EstimatorEntry[Estimator]):
    """Table entry of `spinfilters.estimators.baselines.filterpy_filters.FilterpyUkf`."""

    name, order = "filterpy-ukf", 4
    is_baseline = True

    def build(self, setup: Setup, settings: Settings) -> Estimator:
        """filterpy's UKF on the run's process."""
        from spinfilters.estimators.baselines.filterpy_filters import (
            FilterpyUkf,  # slow to import, rarely asked for
        )

        return FilterpyUkf(setup.process)


ESTIMATOR = FilterpyUkfEntry()
