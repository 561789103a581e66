"""filterpy's EKF and UKF, plain baselines."""

from spinfilters.estimators.estimator import Estimator
from spinfilters.pipeline.estimator_entry import EstimatorEntry
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings

# filterpy is slow to import and rarely asked for: each is imported when it is built


class FilterpyEkfEntry(EstimatorEntry[Estimator]):
    """Table entry of `spinfilters.estimators.baselines.filterpy_filters.FilterpyEkf`."""

    name, order = "filterpy-ekf", 3
    is_baseline = True

    def build(self, setup: Setup, settings: Settings) -> Estimator:
        """filterpy's EKF on the run's process."""
        from spinfilters.estimators.baselines.filterpy_filters import FilterpyEkf

        return FilterpyEkf(setup.process)


class FilterpyUkfEntry(EstimatorEntry[Estimator]):
    """Table entry of `spinfilters.estimators.baselines.filterpy_filters.FilterpyUkf`."""

    name, order = "filterpy-ukf", 4
    is_baseline = True

    def build(self, setup: Setup, settings: Settings) -> Estimator:
        """filterpy's UKF on the run's process."""
        from spinfilters.estimators.baselines.filterpy_filters import FilterpyUkf

        return FilterpyUkf(setup.process)
