"""Inliers among the observations of the latest epoch.

Its guess may be poor and its landmarks wrong.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.robust.losses import RobustLoss
from spinfilters.estimators.smoothing.factors.landmark_observations import (
    OBSERVATIONS_NEEDED,
    linearise_observations,
)
from spinfilters.estimators.smoothing.problem.landmark_reinitialisation import reinitialised
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    LinearProblem,
    NormalEquations,
    Problem,
    Stage,
)
from spinfilters.estimators.smoothing.window.smoother_window import Window

POOR_GUESS_SHARE = 0.3
"""Share of the latest epoch's observations without weight from which the epoch's guess, not the observations, is taken to be
wrong."""
WIDTH = 5.0
"""Standard deviations within which observations' own points agree."""


def is_poor_guess(problem: Problem, here: LinearizationPoint, loss: RobustLoss) -> bool:
    """Whether the loss rejects most observations of the latest epoch."""
    if here.linear is None or problem.observations is None:
        return False
    latest = np.flatnonzero(problem.observations.epoch == problem.ordering.epochs - 1)
    lost = here.linear.weight(loss)[latest] == 0
    return bool(np.count_nonzero(lost) > POOR_GUESS_SHARE * len(lost))


def with_landmarks_put_right(problem: Problem, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
    """Linearisation point with landmarks of fewer than two inliers re-initialised."""
    if problem.observations is None or here.linear is None:
        return here
    inliers = here.linear.weight(stage.loss) > 0
    if inliers.all():
        return here
    landmark, count = problem.observations.landmark, problem.observations.landmarks
    every, good = np.bincount(landmark, minlength=count), np.bincount(landmark[inliers], minlength=count)
    if not ((every > OBSERVATIONS_NEEDED) & (good < OBSERVATIONS_NEEDED)).any():
        return here
    points = reinitialised(problem.observations, here.trajectory, here.points, inliers, WIDTH)
    if points is None:
        return here
    linear = linearise_observations(problem.observations, here.trajectory, points)
    return replace(here, points=points, linear=linear)


def linear_problem(problem: Problem, here: LinearizationPoint, loss: RobustLoss) -> LinearProblem:
    """Linear problem about a point, or one at which misplaced landmarks are re-initialised."""
    stage = Stage(loss)
    here = with_landmarks_put_right(problem, here, stage)
    return LinearProblem(here, problem.normal(here, stage))


def observation_weights(
    window: Window, normal: NormalEquations, epoch: int, ends: list[int]
) -> list[Float[np.ndarray, " n"]]:
    """Weights of the observations of an epoch between these ends; zero where there is no solution."""
    fit, (first, last) = normal.eliminated, np.searchsorted(window.seen.epoch, [epoch, epoch + 1]).tolist()
    weight = np.zeros(last - first)
    if fit is not None:
        order = np.argsort(window.seen.landmark[first:last], kind="stable")
        weight[order] = fit.weight[fit.observations.epoch == epoch]
    return [weight[begin - first : end - first] for begin, end in pairwise(ends)]
