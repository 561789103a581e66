"""Test of a filter by the smoother of the same measurements."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.agreement import WHOLE, expected_nees, whole_and_blocks
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.state.quantities import ALL, OF_BLOCKS
from spinfilters.state.status import Finding
from spinfilters.verdict.checks import finding

RARE = 0.01
"""Probability of a NEES of a consistent filter, beyond which one that is expected with the smoother for the truth is a doubt: 1.9
per degree of freedom of a state with a place, 3.0 of a mass distribution. Of 70 filters of noisy poses on the thesis' motion those
below had a NEES of up to 1.9 and errors of up to 3.0 deviations, those beyond it of up to 14 and 58."""
HELD = 0.1
"""Probability of a block's NEES below which it is among what a filter is over-confident of: blocks have few numbers, and the
errors of one are in the covariances of the others."""


@dataclass(frozen=True)
class OverConfidence:
    """Expected NEES per degree of freedom of a part of a filter's error.

    Attributes
    ----------
    mean, last: over its epochs, and in the last.   dof: of the part.
    """

    part: str
    mean: float
    last: float
    dof: int

    def excess(self, probability: float) -> float:
        """Times the largest that a consistent filter has with this probability."""
        return max(self.mean, self.last) / (float(chdtri(self.dof, probability)) / self.dof)


def over_confidence(history: EstimateHistory, smoother: EstimateHistory) -> list[Finding] | None:
    """Finding where a filter departs from the smoother beyond its own covariance.

    None where there is no epoch that both have.
    """
    parts = whole_and_blocks(history.layout)
    found = [
        OverConfidence(name, float(nees.mean()), float(nees[-1]), parts[name].stop - parts[name].start)
        for name, nees in expected_nees(history, smoother).items()
        if nees.size
    ]
    if not found:
        return None
    telling = [each for each in found if each.part in (WHOLE, MASS_DISTRIBUTION.name)]
    worst = max(telling, key=lambda each: each.excess(RARE))
    if worst.excess(RARE) <= 1:
        return []
    nees = max(worst.mean, worst.last)
    numbers: dict[str, float | str] = {
        "nees": nees,
        "times": float(np.sqrt(nees)),
        "which": "" if worst.part == WHOLE else f" of the {MASS_DISTRIBUTION.label}",
        "where": "over its epochs" if worst.mean >= worst.last else "in the last epoch",
    }
    beyond = [each.part for each in found if each.part != WHOLE and each.excess(HELD) > 1]
    about = frozenset().union(*(OF_BLOCKS.get(part, frozenset()) for part in beyond)) or ALL
    return [finding("over-confident", numbers, about)]
