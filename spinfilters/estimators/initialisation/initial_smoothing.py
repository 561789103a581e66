"""Smoothing of the first epochs from one guess."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.identification.residuals import deleted_residuals
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.robust.losses import LeastSquares
from spinfilters.estimators.smoothing.factors.landmark_observations import NOTHING_TWICE, OBSERVATIONS_NEEDED
from spinfilters.estimators.smoothing.linear.marginals import Marginals
from spinfilters.estimators.smoothing.problem.least_squares import (
    InitialGuess,
    Problem,
    problem_of,
    with_common_constants,
)
from spinfilters.estimators.smoothing.solver.annealing import GATE, AnnealedSchedule, IdleAnnealing
from spinfilters.estimators.smoothing.solver.iterations import Solved, SolverOptions, solve
from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
from spinfilters.estimators.timeline import Timeline

MOST_MASKED = 2
"""Measurements that are refused beside those that the gates refuse, at most."""


@dataclass(frozen=True)
class SmoothingOptions:
    """Options of the smoothing of the first epochs.

    Attributes
    ----------
    iterations: at most; 0 linearises at the guess and takes no step.
    gate: whitened length of an innovation of three components beyond which an observation counts as wrong.
    annealed: iterations in which the process noise may be inflated and the gate wide, at most.
    """

    iterations: int = 40
    gate: float = GATE
    annealed: int = 40

    def __post_init__(self) -> None:
        if self.iterations < 0 or not self.gate > 0:
            raise InputError(
                f"iterations is {self.iterations}, gate {self.gate}; give at least 0 and more than 0"
            )


def smooth_first_epochs(
    process: ProcessModel,
    epochs: Timeline,
    guess: InitialGuess,
    prior: FirstStatePrior,
    options: SmoothingOptions,
) -> InitialEstimate:
    """Iterate from a guess to the most probable motion and map, robust to wrong observations.

    Parameters
    ----------
    epochs: observations of landmarks that the guess does not hold are left out.
    prior: of the first state; with unknown landmarks its pose must be tight, for it defines g.

    Raises
    ------
    InputError: when the guess has landmarks and none is observed twice, or the layout has no place for them.
    """
    order = np.argsort(guess.ids)
    ids, points = guess.ids[order], guess.points[order]
    problem = problem_of(process, epochs, ids, prior, OBSERVATIONS_NEEDED)
    if len(ids) and problem.observations is None:
        raise InputError(NOTHING_TWICE)
    here = problem.at(with_common_constants(process.layout, guess.trajectory), points)
    schedule = AnnealedSchedule(problem, min(options.annealed, options.iterations), options.gate)
    strict = IdleAnnealing(problem) if problem.observations is None and not options.annealed else None
    solved = solve(problem, here, SolverOptions(options.iterations), schedule, strict)
    if problem.observations is None and options.iterations:
        solved = _with_masked_refused(problem, solved, options)
    found = _with_map(_estimate(problem, solved, prior), problem, solved, options.gate)
    return replace(found, ids=ids[found.ids], is_annealed_too=strict is not None and strict.is_idle)


def _with_masked_refused(problem: Problem, solved: Solved, options: SmoothingOptions) -> Solved:
    """The solution without gross errors that bend the states towards themselves.

    A gate looks at residuals. Of a measurement that tells much of its epoch, as in the first and the last, a residual is what is
    left of the error: the others tell how far off it is. Refused once, it stays beyond the gate.
    """
    strict, settings = AnnealedSchedule(problem, 0, options.gate), SolverOptions(options.iterations)
    for _ in range(MOST_MASKED):
        masked = _most_masked(problem, solved, strict.pose_only_gate)
        if masked is None:
            break
        number, row = masked
        sensors = list(problem.motion.sensors)
        sensors[number] = sensors[number].chosen(np.arange(len(sensors[number].epoch)) != row)
        others = replace(problem, motion=replace(problem.motion, sensors=tuple(sensors)))
        schedule = AnnealedSchedule(others, 0, options.gate)
        rest = solve(others, others.at(solved.point.trajectory, solved.point.points), settings, schedule)
        again = solve(problem, problem.at(rest.point.trajectory, rest.point.points), settings, strict)
        if not again.converged or again.point.sensor_rows(problem.motion, number).counted[row]:
            break
        solved = replace(again, iterations=solved.iterations)
    return solved


def _most_masked(problem: Problem, solved: Solved, gate: float) -> tuple[int, int] | None:
    """Sensor and row of the measurement farthest from all others.

    None where all are within the gate (whitened length).
    """
    if solved.normal.solution is None or not solved.converged:
        return None
    marginals = Marginals(solved.normal.solution, solved.normal.eliminated)
    every = deleted_residuals(problem, solved.point, marginals)
    beyond = [chdtrc(sensor.model.dim, gate**2) for sensor in problem.motion.sensors]
    least = [float(each.min(initial=1.0)) / limit for each, limit in zip(every, beyond, strict=True)]
    if not least or min(least) >= 1.0:
        return None
    number = int(np.argmin(least))
    return number, int(every[number].argmin())


def _estimate(problem: Problem, solved: Solved, prior: FirstStatePrior) -> InitialEstimate:
    """The motion that was found, and how its pose-only observations fit."""
    here, solution, n = solved.point, solved.normal.solution, problem.layout.error_dim
    marginals = None if solution is None else Marginals(solution, solved.normal.eliminated)
    nothing = np.full((len(here.trajectory), n, n), np.nan)
    cost, dof, accepted, refused = here.sensors.cost + here.dynamics.cost, 0, 0, {}
    for k, sensor in enumerate(problem.motion.sensors):
        _, costs, square, _ = here.sensor_rows(problem.motion, k)
        inliers = (here.pose_only_loss or LeastSquares()).weight(square) > 0
        cost += float(square[inliers].sum() - costs.sum())
        accepted += int(np.count_nonzero(inliers))
        dof += int(np.count_nonzero(inliers)) * sensor.model.dim
        refused[sensor.model] = ~inliers
    return InitialEstimate(
        layout=problem.layout,
        prior=prior,
        mean=here.trajectory,
        factor=nothing if marginals is None else marginals.factors,
        cost=cost,
        dof=dof,
        accepted=accepted,
        rejected=sum(int(np.count_nonzero(each)) for each in refused.values()),
        iterations=solved.iterations,
        converged=solved.converged,
        refused=refused,
        marginals=marginals,
    )


def _with_map(found: InitialEstimate, problem: Problem, solved: Solved, gate: float) -> InitialEstimate:
    """With the landmarks that were found, and how their observations fit."""
    here, fit, observations = solved.point, solved.normal.eliminated, problem.observations
    if fit is None or observations is None or here.linear is None:
        return found
    inliers = int(np.count_nonzero(fit.used))
    return replace(
        found,
        cost=found.cost + float(here.linear.square[fit.used].sum()),
        dof=found.dof + here.linear.rows.shape[1] * inliers - 3 * int(np.count_nonzero(fit.is_constrained)),
        accepted=found.accepted + inliers,
        rejected=found.rejected + int(np.count_nonzero(here.linear.size >= gate)),
        used=observations.by_epoch(fit.used),
        ids=np.flatnonzero(fit.is_constrained),
        points=here.points[fit.is_constrained],
        counts=np.bincount(observations.landmark[fit.used], minlength=observations.landmarks)[
            fit.is_constrained
        ],
    )
