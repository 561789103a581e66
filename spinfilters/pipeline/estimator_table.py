"""The table of estimators: those of this package, and those of plug-ins."""

from typing import Final

from spinfilters.pipeline.estimator_entries.embedded_entries import EmbeddedDoubleEntry, EmbeddedEntry
from spinfilters.pipeline.estimator_entries.filterpy_baselines import FilterpyEkfEntry, FilterpyUkfEntry
from spinfilters.pipeline.estimator_entries.mekf import MekfEntry
from spinfilters.pipeline.estimator_entries.smoother import SmootherEntry
from spinfilters.pipeline.estimator_entries.smoother_latest import LatestSmootherEntry
from spinfilters.pipeline.estimator_entries.ukf import UkfEntry
from spinfilters.pipeline.estimator_entry import AnyEntry, EstimatorEntry
from spinfilters.plugins import entries_by_name, in_order, installed_plugins

OWN: Final[tuple[AnyEntry, ...]] = (
    MekfEntry(),
    UkfEntry(),
    SmootherEntry(),
    FilterpyEkfEntry(),
    FilterpyUkfEntry(),
    EmbeddedEntry(),
    EmbeddedDoubleEntry(),
    LatestSmootherEntry(),
)
"""Estimators of this package; `spinfilters.settings.estimator_names` lists their names for the settings."""


def estimator_entries() -> dict[str, AnyEntry]:
    """Entries by name, in their order: these, and those of the entry points ``spinfilters.estimators``.

    InputError: a plug-in that cannot be loaded, a name that stands twice.
    """
    others = installed_plugins("spinfilters.estimators", EstimatorEntry)
    return entries_by_name(in_order((*OWN, *others)), "estimator")
