"""A comparison of estimators without what a test of their estimates and verdicts does not look at."""

from spinfilters.data.dataset import Dataset
from spinfilters.pipeline.estimation import Comparison, ComparisonExtent, compare_estimators
from spinfilters.pipeline.preparation import prepare
from spinfilters.pipeline.recording_bound import without_bounds
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings

PLAIN = ComparisonExtent(bounding=without_bounds, rehearsing=lambda *_: None)
"""Without the Cramer-Rao bound, and with nothing built before a clock runs."""


def plain_comparison(dataset: Dataset, settings: Settings) -> Comparison:
    """Estimates of a data set with their verdicts."""
    return plainly_compared(prepare(dataset, settings), settings)


def plainly_compared(setup: Setup, settings: Settings) -> Comparison:
    """The same of a prepared data set."""
    return compare_estimators(setup, settings, lambda *_: None, extent=PLAIN)
