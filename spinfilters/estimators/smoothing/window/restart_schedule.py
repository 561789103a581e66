"""When a restart from conserved angular momentum is tried: at which epochs, and for which fit."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from spinfilters.estimators.smoothing.problem.least_squares import LinearizationPoint, NormalEquations

FIRST, GROWTH, RETRY = 4, 1.5, 1.2
"""Number of epochs at which it is first asked, and by how much more before it is asked again: where all fits, and where not."""
GOOD_FIT, INLIER_SHARE = 1.5, 0.4
"""Cost per degree of freedom, and share of the observations, from which a fit is not in doubt."""


@dataclass
class RetrySchedule:
    """Schedule of restart attempts by number of epochs. Sparser where everything fits."""

    next: float = FIRST
    retry: float = FIRST

    def is_due(self, epochs: int, good: bool) -> bool:
        """Whether enough epochs have come for the next attempt."""
        if epochs < (self.next if good else self.retry):
            return False
        self.next, self.retry = GROWTH * epochs, RETRY * epochs
        return True


def fits(here: "LinearizationPoint", normal: "NormalEquations") -> bool:
    """Whether a point fits as well as the noise allows.

    Its own cost counts, not the one that its linear problem predicts.
    """
    if not normal.solved:
        return False
    if normal.eliminated is None or here.linear is None:
        return True
    used, constrained = int(np.count_nonzero(normal.eliminated.used)), normal.eliminated.is_constrained
    dof = here.linear.rows.shape[1] * used - 3 * int(np.count_nonzero(constrained))
    every = int(np.diff(normal.eliminated.observations.start)[constrained].sum())
    cost = here.cost(normal.used, normal.stage)
    if here.marginal_prior is not None:
        prior = here.marginal_prior.marginal_prior
        cost -= (
            prior.constant_cost
        )  # of observations that have left, which are not among these degrees of freedom
        dof += max(len(prior.right) - prior.ordering.layout.error_dim, 0)  # beyond what one state takes
    return used >= INLIER_SHARE * every and cost <= GOOD_FIT * max(dof, 1)
