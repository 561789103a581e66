"""Marginal likelihood of a recording's first epochs under a setup."""

import numpy as np
from jaxtyping import Float

from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.model_errors.hypotheses import solved_near
from spinfilters.estimators.model_errors.laplace_likelihood import minus_twice_log_likelihood
from spinfilters.pipeline.model_errors import landmarks_placed, linear_problem
from spinfilters.pipeline.setup import Setup


def minus_twice_log_evidence(setup: Setup, trajectory: Float[np.ndarray, "k m"]) -> float | None:
    """-2 ln evidence of the first epochs.

    Up to a constant of priors and of the measurements' number. None where they cannot be linearised about a trajectory.
    """
    try:
        with np.errstate(all="ignore"):
            problem = linear_problem(setup, setup.timeline[: len(trajectory)])
            solved = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
            return None if solved is None else minus_twice_log_likelihood(solved)
    except NUMERICAL_ERRORS:
        return None


def cost_of_first_epochs(setup: Setup) -> float:
    """-2 ln marginal likelihood of the initialisation's epochs, with its prior; infinite where they could not be smoothed."""
    start = setup.initial
    if start.has_failed or not np.isfinite(start.mean).all():
        return np.inf
    found = minus_twice_log_evidence(setup, start.mean)
    return np.inf if found is None else found + 2 * float(np.log(start.prior.std).sum())
