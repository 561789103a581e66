"""Inliers among the observations of the latest epoch. Its guess may be poor and its landmarks wrong."""

from dataclasses import replace

import numpy as np

from spinfilters.estimators.robust.losses import RobustLoss
from spinfilters.estimators.smoothing.factors.landmark_observations import (
    OBSERVATIONS_NEEDED,
    linearise_observations,
)
from spinfilters.estimators.smoothing.problem.landmark_reinitialisation import reinitialised
from spinfilters.estimators.smoothing.problem.least_squares import LinearizationPoint, Problem, Stage

POOR_GUESS_SHARE = 0.3
"""Share of the latest epoch's observations without weight from which the epoch's guess, not the observations, is taken to be
wrong."""
WIDTH = 5.0
"""Standard deviations within which observations' own points agree."""


def is_poor_guess(problem: Problem, here: LinearizationPoint, loss: RobustLoss) -> bool:
    """Whether the loss loses most of the latest epoch."""
    if here.linear is None or problem.observations is None:
        return False
    latest = np.flatnonzero(problem.observations.epoch == problem.ordering.epochs - 1)
    lost = loss.weight(here.linear.square[latest]) == 0
    return bool(len(lost)) and float(np.mean(lost)) > POOR_GUESS_SHARE


def with_landmarks_put_right(problem: Problem, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
    """With landmarks placed anew of whose observations fewer than two are believed."""
    if problem.observations is None or here.linear is None:
        return here
    inliers = stage.loss.weight(here.linear.square) > 0
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
