"""Unstated noise, identified on a smoother's own epochs.

All of a recording, or what its window holds.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.identification.identify import Identified, identify
from spinfilters.estimators.smoothing.problem.least_squares import Problem
from spinfilters.estimators.smoothing.solver.batch_smoother import BatchSmoothing, smooth_problem
from spinfilters.estimators.smoothing.window.recursive_smoother import RecursiveSmoother
from spinfilters.estimators.smoothing.window.smoother_records import MarginalizedState
from spinfilters.pipeline.identified_noise import noise_model
from spinfilters.pipeline.setup import Setup


def identified_levels(
    problem: Problem,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
    setup: Setup,
) -> Identified | None:
    """Noise levels of a problem, from those of the initialisation.

    None where all are stated or they do not settle.
    """
    model = noise_model(problem, setup.noise, setup.sought)
    if model is None or not np.isfinite(trajectory).all():
        return None
    try:
        found = identify(model, trajectory, points, np.zeros(len(model.components) + len(model.densities)))
    except NUMERICAL_ERRORS:
        return None
    return found if found is not None and found.converged else None


def at_levels(problem: Problem, found: Identified, setup: Setup) -> Problem:
    """The problem with levels identified from it, or from a part of it."""
    model = noise_model(problem, setup.noise, setup.sought)
    return problem if model is None else model.scaled(found.expected)


def settled_at_levels(
    smoother: RecursiveSmoother, setup: Setup
) -> tuple[list[MarginalizedState], Identified | None]:
    """Every epoch so far at the levels that the window identifies, and these."""
    sliding = smoother.sliding
    window = sliding.window
    found = identified_levels(sliding.problem(), window.trajectory, window.points, setup)
    if found is None:
        return smoother.smoothed(), None
    sliding.at_levels = lambda problem: at_levels(problem, found, setup)
    rows = smoother.smoothed()
    before, own = rows[: -len(window.epochs)], rows[-len(window.epochs) :]
    factors = found.widened(np.array([row.factor for row in own]))
    return [*before, *(replace(row, factor=f) for row, f in zip(own, factors, strict=True))], found


def smoothed_at_levels(
    problem: Problem, part: Problem, smoothed: BatchSmoothing, setup: Setup
) -> tuple[BatchSmoothing, Identified | None]:
    """A recording smoothed once more at the levels that it identifies, and these.

    Parameters
    ----------
    part: of the problem's first epochs, whose rows are in memory together; the problem itself where it is short.
    """
    trajectory = smoothed.mean[: part.ordering.epochs]
    found = identified_levels(part, trajectory, np.zeros((0, 3)), setup)
    if found is None:
        return smoothed, None
    again = smooth_problem(at_levels(problem, found, setup), smoothed.mean)
    if part.ordering.epochs == problem.ordering.epochs:
        again = replace(again, factor=found.widened(again.factor))
    return again, found
