"""The multiplicative UKF."""

from spinfilters.estimators.filters.multiplicative_ukf import MultiplicativeUkf
from spinfilters.pipeline.estimator_entries.mekf import MultiplicativeEntry
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings


class UkfEntry(MultiplicativeEntry):
    """Table entry of `MultiplicativeUkf`."""

    name, order = "ukf", 1

    def build(self, setup: Setup, settings: Settings) -> MultiplicativeUkf:
        """The multiplicative UKF with the run's options."""
        return MultiplicativeUkf(
            setup.process, settings.ukf, settings.robust, settings.adaptation, settings.landmarks
        )
