"""Score tests of noise levels against the data.

All variance components of a smoothing problem at once.
At the levels of a problem the score of ln variance i is g_i = (r_i - S_i) / 2, with r and S of `residuals`; F is the information.
A level that is wrong shows in the scores of the others, so that each is tested with the others free:

    z_i = (F^-1 g)_i / sqrt((F^-1)_ii).

The average information is in proportion to the residuals that it is made of; F_ij sqrt(S_i S_j / (r_i r_j)) is what it would be at
right levels. Sums of squares are skewed, the more the fewer they are: they are taken for chi-square ones of S^2 / 2F degrees of
freedom, and z for the normal number as improbable as they (Wilson and Hilferty 1931).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.identification.identify import STAGE
from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.identification.residuals import residuals_of
from spinfilters.estimators.identification.working_solutions import WorkingSolutions
from spinfilters.estimators.smoothing.solver.iterations import advanced
from spinfilters.estimators.smoothing.solver.step_rules import GaussNewton

STEPS: Final = 2
"""From the states given towards the most probable ones, before the test."""
LEAST_INFORMATION: Final = 0.25
"""Of a ln variance, below which nothing is tested: its standard deviation is 2."""
LEAST_SHARE: Final = 1e-9
"""Of a sum of squares to its expectation."""


@dataclass(frozen=True)
class LevelTest:
    """A noise level beside the data.

    Attributes
    ----------
    score: standard deviations by which the data ask for more noise, as of a normal number; zero where they tell nothing.
    """

    name: str
    score: float


def level_tests(
    model: NoiseModel, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> tuple[LevelTest, ...]:
    """Score test of every noise level, about states near the most probable.

    None where the problem has no solution.
    """
    problem, rule = model.problem, GaussNewton()
    here = problem.at(trajectory, points, STAGE.pose_only_loss)
    normal = problem.normal(here, STAGE)
    for _ in range(STEPS):
        if not normal.solved:
            return ()
        there = advanced(problem, here, normal, rule, rule.first).point
        if there is None:
            return ()
        here, normal = there, problem.normal(there, STAGE)
    if not normal.solved:
        return ()
    found = residuals_of(problem, here, normal, model.components, model.densities)
    F = WorkingSolutions(problem, here, normal, found.sources).information
    names = (*(each.name for each in model.components), *model.densities)
    return tuple(map(LevelTest, names, _scores(found.squares, found.redundancy, F).tolist()))


def _scores(
    squares: Float[np.ndarray, " c"],
    redundancy: Float[np.ndarray, " c"],
    information: Float[np.ndarray, "c c"],
) -> Float[np.ndarray, " c"]:
    scores = np.zeros(len(squares))
    seen = np.maximum(squares, LEAST_SHARE * np.maximum(redundancy, LEAST_SHARE))
    expected = np.sqrt(np.maximum(redundancy, 0.0) / seen)
    F = information * expected * expected[:, None]
    told = np.flatnonzero(np.diag(F) > LEAST_INFORMATION)
    if not len(told):
        return scores
    F, gradient = F[np.ix_(told, told)], (squares - redundancy)[told] / 2
    covariance = np.linalg.pinv(F, hermitian=True)
    deviation = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    dof = np.maximum(redundancy[told] ** 2 / (2 * np.diag(F)), 0.1)
    scores[told] = _normal(covariance @ gradient / deviation, dof)
    return scores


def _normal(z: Float[np.ndarray, " c"], dof: Float[np.ndarray, " c"]) -> Float[np.ndarray, " c"]:
    """Normal numbers as improbable as chi-square ones that lie z standard deviations above their mean."""
    ratio = np.maximum(1 + z * np.sqrt(2 / dof), 0.0)
    spread = 2 / (9 * dof)
    return (np.cbrt(ratio) - (1 - spread)) / np.sqrt(spread)
