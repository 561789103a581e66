"""Batch smoother of a whole recording without landmarks.

The system is block-tridiagonal, and the cost grows linearly with time.

It sets out from a trajectory that a filter has found. Where observations of landmarks without a map tie poses together, see
`sliding`.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.robust.losses import RobustLoss
from spinfilters.estimators.smoothing.linear.marginals import Marginals
from spinfilters.estimators.smoothing.problem.least_squares import Problem, problem_of, with_common_constants
from spinfilters.estimators.smoothing.problem.unobservable_directions import unobservable_directions
from spinfilters.estimators.smoothing.solver.annealing import AnnealedSchedule
from spinfilters.estimators.smoothing.solver.iterations import Solved, SolverOptions, solve
from spinfilters.estimators.smoothing.state_prior import StatePrior
from spinfilters.estimators.timeline import Timeline
from spinfilters.state.status import Finding

NO_LANDMARKS, NO_POINTS = np.zeros(0, dtype=int), np.zeros((0, 3))


@dataclass(frozen=True)
class BatchSmoothing:
    """The most probable trajectory.

    Attributes
    ----------
    mean: (k, m).   factor: (k, n, n) of each epoch's covariance given everything; not finite where something is not determined.
    accepted, rejected: (k,) measurements of each epoch that count, and that do not.
    unobservable: findings of what the measurements do not determine.
    """

    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    accepted: Int[np.ndarray, " k"]
    rejected: Int[np.ndarray, " k"]
    solved: Solved
    unobservable: list[Finding]


def smooth_recording(
    process: ProcessModel,
    epochs: Timeline,
    trajectory: Float[np.ndarray, "k m"],
    prior: StatePrior,
    loss: RobustLoss,
    annealed_iterations: int = 0,
) -> BatchSmoothing:
    """Smooth measurements without landmark ids from an initial trajectory.

    Its constants are those of the last epoch.

    Parameters
    ----------
    annealed_iterations: in which disturbances are taken for larger than they are, at most, for a trajectory that does not obey
        its dynamics.
    """
    problem = problem_of(process, epochs, NO_LANDMARKS, prior, 2, loss)
    return smooth_problem(problem, trajectory, annealed_iterations)


def smooth_problem(
    problem: Problem, trajectory: Float[np.ndarray, "k m"], annealed_iterations: int = 0
) -> BatchSmoothing:
    """Smooth a problem without landmarks; see `smooth_recording`."""
    start = np.ascontiguousarray(with_common_constants(problem.layout, trajectory[::-1])[::-1])
    schedule = AnnealedSchedule(problem, annealed_iterations) if annealed_iterations else None
    solved = solve(problem, problem.at(start, NO_POINTS), SolverOptions(), schedule)
    solution, here, n = solved.normal.solution, solved.point.trajectory, problem.layout.error_dim
    marginals = None if solution is None else Marginals(solution, None)
    factor = np.full((len(here), n, n), np.nan) if marginals is None else marginals.factors
    accepted, rejected = np.zeros(len(here), dtype=int), np.zeros(len(here), dtype=int)
    for sensor in problem.motion.sensors:
        good = problem.motion.inliers(sensor, here)
        np.add.at(accepted, sensor.epoch[good], 1)
        np.add.at(rejected, sensor.epoch[~good], 1)
    directions = unobservable_directions(problem, solved.point, solved.normal, marginals)
    return BatchSmoothing(here, factor, accepted, rejected, solved, directions)
