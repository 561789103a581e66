"""One simulated batch run of the smoother.

All epochs at once from the closed form, beside the Cramer-Rao bound.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.smoother_workload import MOTIONS, Workload, simulated_workload
from spinfilters.core.linear_algebra import normalised_square
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimated_motion import body_history, trajectory_of
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.evaluation.trajectory_errors import Alignment, truth_in_first_frame
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.filters.timeline import Timeline
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import EstimatorStatus
from spinfilters.reproduction.tweddle.final_deviations import actual_errors, marginal_std
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.smoother.batch_smoother import GATE, AnnealedSchedule
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import (
    LinearizationPoint,
    NormalEquations,
    Problem,
    Stage,
    problem_of,
    with_common_constants,
)
from spinfilters.smoother.solver import Schedule, SolverOptions, solve

FRAMES: Final = 115
"""Of the workload disam115."""
Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class SmootherCase:
    """One run: motion "rich" or "thesis", seed, frames at 0.5 s."""

    motion: str
    seed: int
    epochs: int = FRAMES

    @property
    def label(self) -> str:
        """A name for files."""
        return f"{self.motion}-{self.epochs}-{self.seed}"

    @cached_property
    def scenario(self) -> Scenario:
        """The common workload."""
        return replace(Scenario.common_workload(MOTIONS[self.motion], self.seed), epochs=self.epochs)


def run_batch(case: SmootherCase) -> Arrays:
    """Batch run from the closed form: arrays and schedules' ends.

    Arrays as `_figures`, and how the two schedules came to their ends.
    linearisations_<schedule>, converged_<schedule>, cost_<schedule> (1,); finite (1,) whether all of them ended in numbers.
    """
    workload, dataset = _simulated(case)
    problem = _problem(workload, workload.prior)
    here = problem.at(
        with_common_constants(workload.layout, workload.trial.trajectory), workload.trial.points
    )
    schedules: dict[str, Schedule | None] = {
        "plain": None,
        "drawn": AnnealedSchedule(problem, SolverOptions().iterations, GATE),
    }
    arrays, histories = {}, {}
    for name, schedule in schedules.items():
        solved = solve(problem, here, SolverOptions(), schedule)
        arrays[f"linearisations_{name}"] = np.array([solved.linearisations])
        arrays[f"converged_{name}"] = np.array([solved.converged])
        arrays[f"cost_{name}"] = np.array([solved.costs[-1]])
        histories[name] = _history(name, workload.timeline, problem, solved.point, solved.normal)
    finite = [np.isfinite(each).all() for found in histories.values() for each in (found.mean, found.factor)]
    at_truth = _at_truth(workload, dataset)
    bound = _history("bound", workload.timeline, *at_truth)
    linear = {f"linear_{what}": array for what, array in _linear_nees(*at_truth).items()}
    return (
        arrays | {"finite": np.array([all(finite)])} | linear | _figures(histories["drawn"], bound, dataset)
    )


def _simulated(case: SmootherCase) -> tuple[Workload, Dataset]:
    """The problem with the scenario's own disturbances, and what it was made from."""
    workload = simulated_workload(case.scenario)
    process = TorqueFreeProcess(workload.layout, case.scenario.noise)
    return replace(workload, process=process), simulate(case.scenario)


def _problem(workload: Workload, prior: FirstStatePrior) -> Problem:
    return problem_of(workload.process, workload.timeline, workload.trial.ids, prior, OBSERVATIONS_NEEDED)


def _at_truth(workload: Workload, dataset: Dataset) -> tuple[Problem, LinearizationPoint, NormalEquations]:
    """The problem linearised at the true body and landmarks; its covariance is the bound."""
    assert dataset.truth is not None
    assert dataset.known_map is not None
    layout, prior = workload.layout, workload.prior
    truth, mean = true_states(dataset.truth, layout), prior.mean.copy()
    for block in ("t", "a"):
        mean[layout.mean_slice(block)] = truth[0, layout.mean_slice(block)]
    problem = _problem(workload, FirstStatePrior(mean, prior.std))
    rows = np.searchsorted(dataset.known_map.ids, workload.trial.ids)
    here = problem.at(truth, dataset.known_map.points[rows])
    return problem, here, problem.normal(here, Stage(LeastSquares()))


def _linear_nees(problem: Problem, here: LinearizationPoint, normal: NormalEquations) -> Arrays:
    """NEES (n,) of the linear estimate about the truth.

    Chi-square when the noise models are right, whatever is not linear.
    """
    errors, factors = normal.system.errors, Marginals(normal.system, normal.eliminated).factors
    where = {"nees": slice(None)} | {f"nees_{b}": problem.layout.slice(b) for b in problem.layout.blocks}
    return {name: normalised_square(errors[:, at], factors[:, at]) for name, at in where.items()}


def _history(
    name: str, timeline: Timeline, problem: Problem, here: LinearizationPoint, normal: NormalEquations
) -> EstimateHistory:
    """Every frame given all of them."""
    layout = problem.layout
    if normal.solution is not None:
        factors = Marginals(normal.solution, normal.eliminated).factors
    else:
        factors = np.full((len(timeline), layout.error_dim, layout.error_dim), np.nan)
    rows = GrowingHistory(layout, timeline[0].time)
    for frame, mean, factor in zip(timeline, here.trajectory, factors, strict=True):
        rows.append(frame.time, Gaussian(layout, mean, factor), [], 0.0)
    return rows.ended(name, EstimatorStatus())


def _figures(history: EstimateHistory, bound: EstimateHistory, dataset: Dataset) -> Arrays:
    """Of all n frames: `_error_figures`, with position_bound and velocity_bound (n, 3), moments_bound (3,) standard deviations.

    std, std_bound, square (7, 3): of the quantities of `marginal_deviations`, standard deviations and squared errors.
    """
    assert dataset.truth is not None
    evaluation = evaluate(history, dataset.truth, Alignment.FIRST_FRAME)
    truth = truth_in_first_frame(history, dataset.truth)
    limits = trajectory_of(bound)
    return _error_figures(evaluation) | {
        "position_bound": limits.std_position,
        "velocity_bound": limits.std_velocity,
        "moments_bound": body_history(bound).at(-1).principal_moments_std,
        "std": marginal_std(history),
        "std_bound": marginal_std(bound),
        "square": actual_errors(history, truth),
    }


def _error_figures(evaluation: Evaluation) -> Arrays:
    """Errors and NEES of one run, as arrays.

    nees (n,), nees_<block> (n,); errors (n, 3) of position, velocity (m, m/s), attitude (rad); moments (3,) at the end.
    """
    assert evaluation.nees is not None
    assert evaluation.errors is not None
    assert evaluation.errors.position is not None
    assert evaluation.errors.velocity is not None
    assert evaluation.body_errors is not None
    assert evaluation.body_errors.principal_moments is not None
    return {
        "nees": evaluation.nees.total,
        **{f"nees_{block}": values for block, values in evaluation.nees.blocks.items()},
        "position": evaluation.errors.position,
        "velocity": evaluation.errors.velocity,
        "attitude": evaluation.errors.attitude,
        "moments": evaluation.body_errors.principal_moments,
    }


def root_mean_square(errors: Float[np.ndarray, "r n 3"]) -> float:
    """Of the lengths, over runs and frames."""
    return float(np.sqrt(np.square(errors).sum(axis=2).mean()))
