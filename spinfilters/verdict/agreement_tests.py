"""Test of a filter by the smoother of the same measurements."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.agreement import WHOLE, compared_parts, expected_nees
from spinfilters.evaluation.consistency import finite_epochs
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.state.quantities import ALL
from spinfilters.state.status import Finding
from spinfilters.verdict.checks import finding
from spinfilters.verdict.holding import history_at, own_rows
from spinfilters.verdict.quantity_differences import quantity_differences

RARE = 0.01
"""Probability of a NEES of a consistent filter, beyond which one that is expected with the smoother for the truth is a doubt: 1.9
per degree of freedom of a state with a place, 3.0 of a mass distribution. Of 70 filters of noisy poses on the thesis' motion those
below had a NEES of up to 1.9 and errors of up to 3.0 deviations, those beyond it of up to 14 and 58."""
HELD = 2.0
"""Expected square of a component of a published quantity in its own deviations, mean over the epochs and in the last, up to which
the quantity holds: a normal error of that size is beyond four deviations with a probability of 0.5 %."""
HELD_AT_ONCE = 16.0
"""The same at one epoch: there the smoother itself is four deviations away."""


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

    @property
    def excess(self) -> float:
        """Times the largest that a consistent filter has."""
        return max(self.mean, self.last) / (float(chdtri(self.dof, RARE)) / self.dof)


def over_confidence(history: EstimateHistory, smoother: EstimateHistory) -> list[Finding] | None:
    """Finding where a filter departs from the smoother beyond its own covariance.

    None where there is no epoch that both have.
    """
    parts = compared_parts(history.layout)
    found = [
        OverConfidence(name, float(nees.mean()), float(nees[-1]), parts[name].stop - parts[name].start)
        for name, nees in expected_nees(history, smoother).items()
        if nees.size
    ]
    if not found:
        return None
    worst = max(found, key=lambda each: each.excess)
    if worst.excess <= 1:
        return []
    nees = max(worst.mean, worst.last)
    numbers: dict[str, float | str] = {
        "nees": nees,
        "times": float(np.sqrt(nees)),
        "which": "" if worst.part == WHOLE else f" of the {MASS_DISTRIBUTION.label}",
        "where": "over its epochs" if worst.mean >= worst.last else "in the last epoch",
    }
    return [finding("over-confident", numbers, over_confident_quantities(history, smoother))]


def over_confident_quantities(history: EstimateHistory, smoother: EstimateHistory) -> frozenset[str]:
    """Published quantities whose errors a filter states too small; all where that cannot be computed."""
    rows = own_rows(history)
    rows = rows[(rows < len(smoother.time)) & finite_epochs(history)[rows]]
    rows = rows[finite_epochs(smoother)[rows]]
    if not rows.size:
        return ALL
    with np.errstate(all="ignore"):
        found = quantity_differences(history_at(history, rows), history_at(smoother, rows))
        squares = {name: each.expected_squares for name, each in found.items()}
    return ALL & frozenset(name for name, own in squares.items() if not _holds(own))


def _holds(squares: Float[np.ndarray, "n c"]) -> bool:
    typical = max(float(squares.mean(axis=0).max()), float(squares[-1].max()))
    return typical <= HELD and float(squares.max()) <= HELD_AT_ONCE
