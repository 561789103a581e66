"""The multiplicative UKF."""

from spinfilters.estimators.multiplicative_ukf import MultiplicativeUkf
from spinfilters.workflow.estimators.mekf import MultiplicativeEntry
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings


class UkfEntry(MultiplicativeEntry):
    """See `MultiplicativeUkf`."""

    name, order = "ukf", 1

    def build(self, prepared: Prepared, settings: Settings) -> MultiplicativeUkf:
        return MultiplicativeUkf(
            prepared.process, settings.ukf, settings.robust, settings.adaptation, settings.landmarks
        )


ESTIMATOR = UkfEntry()
