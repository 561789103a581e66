"""filterpy's EKF, a plain baseline."""

from spinfilters.estimators.estimator import Estimator
from spinfilters.workflow.estimator_entry import EstimatorEntry
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings


class FilterpyEkfEntry(EstimatorEntry[Estimator]):
    """See `spinfilters.estimators.filterpy_baselines.FilterpyEkf`."""

    name, order = "filterpy-ekf", 3
    is_baseline = True

    def build(self, prepared: Prepared, settings: Settings) -> Estimator:
        from spinfilters.estimators.filterpy_baselines import FilterpyEkf  # slow to import, rarely asked for

        return FilterpyEkf(prepared.process)


ESTIMATOR = FilterpyEkfEntry()
