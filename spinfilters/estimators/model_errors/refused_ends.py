"""Measurements refused at the ends of a recording, where contact explains them.

Within a recording a touch is refused in successive epochs, which no gross error explains. Of a touch that the recording ends with,
the last epoch may be the only one beyond the gates, as of a gross error. It is taken in where a touch fits all measurements, with
that epoch's, better than no touch fits those that count. A gross error of s standard deviations costs such a fit s^2 and gains
2 s z, z standard normal, so that it passes with the probability of z beyond the root of `BETTER`, at most.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.alternatives.contact import ContactAtBegin, ContactAtEnd
from spinfilters.estimators.model_errors.hypotheses import among_inliers, measured_epochs
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.estimators.model_errors.noise_components import NoiseComponents
from spinfilters.estimators.model_errors.score_tests import score_tests
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion

BETTER: Final = 4.0
"""By how much less the squared residuals are with a touch and one epoch more."""
Noise = Callable[[LinearRows], NoiseComponents]
"""Variance components of a solved problem."""


def with_refused_ends(solved: LinearRows, time: Float[np.ndarray, " k"], noise: Noise) -> LinearRows:
    """The problem with refused first and last epochs taken in.

    Where a contact explains them; else as it is.
    """
    for epoch, contact in _refused_ends(solved):
        taken = among_inliers(solved.problem, solved, np.array([epoch]))
        if taken is None:
            continue
        found = score_tests(SmoothedMotion(time, taken), noise(taken), [contact])
        explained = None if not found else found[0].explained
        if explained is not None and _squares(taken, explained) < _squares(solved) - BETTER:
            solved = taken
    return solved


def _refused_ends(solved: LinearRows) -> list[tuple[int, Alternative]]:
    """First and last measured epochs none of whose measurements counts, with the contact there."""
    measured, counted = measured_epochs(solved)
    if solved.problem.observations is not None or not measured.any():
        return []
    first, last = np.flatnonzero(measured)[[0, -1]].tolist()
    ends: list[tuple[int, Alternative]] = [(first, ContactAtBegin()), (last, ContactAtEnd())]
    return [(epoch, contact) for epoch, contact in ends if not counted[epoch]]


def _squares(solved: LinearRows, explained: Float[np.ndarray, " r"] | float = 0.0) -> float:
    """Sum of squared residuals less what an error explains of them."""
    left = np.concatenate([part.ravel() for part in solved.residual(solved.right).parts]) - explained
    return float(left @ left)
