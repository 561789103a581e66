"""filterpy's UKF, a plain baseline."""

from spinfilters.estimators.estimator import Estimator
from spinfilters.workflow.estimator_entry import EstimatorEntry
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings


class FilterpyUkfEntry(EstimatorEntry[Estimator]):
    """See `spinfilters.estimators.filterpy_baselines.FilterpyUkf`."""

    name, order = "filterpy-ukf", 4
    is_baseline = True

    def build(self, prepared: Prepared, settings: Settings) -> Estimator:
        from spinfilters.estimators.filterpy_baselines import FilterpyUkf  # slow to import, rarely asked for

        return FilterpyUkf(prepared.process)


ESTIMATOR = FilterpyUkfEntry()
