"""A comparison of estimators without what a test of their estimates and verdicts does not look at."""

from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.run.estimation import Comparison, ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings

PLAIN = ComparisonExtent(bounding=without_bounds, rehearsing=None)
"""Without the Cramer-Rao bound, and with nothing built before a clock runs."""


def plain_comparison(dataset: Dataset, settings: Settings) -> Comparison:
    """Estimates of a data set with their verdicts."""
    return plainly_compared(prepare(dataset, settings), settings)


def plainly_compared(setup: Setup, settings: Settings) -> Comparison:
    """The same of a prepared data set."""
    return compare_estimators(setup, settings, lambda *_: None, extent=PLAIN)
