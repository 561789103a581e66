"""Score tests beside smaller disturbances.

Identified densities have taken a part of an error, and would be less without it.
The gain of an error is the fall of -2 ln likelihood profiled over the noise levels. At the identified ones a slow error is half a
disturbance, and one step of the levels tells little of how far they would fall. At smaller densities its statistic is larger; by
how much these are less likely without the error is taken off it.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.model_errors.hypotheses import (
    KnownLevels,
    among_inliers,
    noise_of,
)
from spinfilters.estimators.model_errors.laplace_likelihood import minus_twice_log_likelihood
from spinfilters.estimators.model_errors.score_test import ScoreTest
from spinfilters.estimators.model_errors.score_tests import likelier, score_tests
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion

SUSPECTED: Final = 0.05
"""Probability of a test below which its error is tested at smaller densities too."""
SHARES: Final = (1 / 4, 1 / 16)
"""Of the identified densities."""


def beside_lower_densities(
    found: Sequence[ScoreTest], motion: SmoothedMotion, model: NoiseModel, told: KnownLevels
) -> list[ScoreTest]:
    """Tests, of `SUSPECTED` errors at the likeliest of some densities.

    Of errors of the whole recording. The same tests where all densities are stated, or where no error is suspected.
    """
    lower = np.array([name not in told.stated for name in model.densities])
    suspected = [each.error for each in found if each.p_value < SUSPECTED and not each.error.by_epoch]
    best = list(found)
    if not lower.any() or not suspected or told.correlation:
        return best
    likelihood = minus_twice_log_likelihood(motion.rows)
    for share in SHARES:
        log_variance = np.concatenate([np.zeros(len(model.components)), np.log(share) * lower])
        own = model.at(log_variance)
        rows = among_inliers(own.problem, motion.rows)
        if rows is None:
            continue
        beside = score_tests(SmoothedMotion(motion.time, rows), noise_of(own, rows, told), suspected)
        best = likelier(best, beside, max(minus_twice_log_likelihood(rows) - likelihood, 0.0))
    return best
