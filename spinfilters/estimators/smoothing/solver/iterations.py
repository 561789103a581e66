"""Iterations to the most probable trajectory and map."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.robust.losses import LeastSquares, RobustLoss
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    NormalEquations,
    Problem,
    Stage,
)
from spinfilters.estimators.smoothing.solver.step_rules import GaussNewton, Step, StepRule

COST_SLACK = 1e-3
"""By which the cost may rise: chi-square numbers differ by far more, rounding by far less."""


class Schedule(Protocol):
    """Schedule of loss and process noise over iterations."""

    def stage(self, iteration: int, here: LinearizationPoint, before: NormalEquations | None) -> Stage:
        """Loss and process-noise inflation of an iteration."""
        ...

    def last(self, iteration: int, stage: Stage) -> bool:
        """Whether no stricter stage follows, so that the iteration may end."""
        ...

    def repaired(self, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
        """Linearisation point with misplaced landmarks re-initialised."""
        ...


@dataclass(frozen=True)
class ConstantSchedule:
    """One loss for all iterations, or one that is graduated."""

    loss: RobustLoss = field(default_factory=LeastSquares)

    def stage(self, iteration: int, here: LinearizationPoint, before: NormalEquations | None) -> Stage:
        """The loss at its own stage."""
        return Stage(self.loss.at_stage(iteration))

    def last(self, iteration: int, stage: Stage) -> bool:
        """Whether the loss is fully graduated."""
        return iteration >= self.loss.stages

    def repaired(self, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
        """The linearisation point as it is."""
        return here


@dataclass(frozen=True)
class SolverOptions:
    """Options of the nonlinear solver.

    Attributes
    ----------
    iterations: steps at most; 0 linearises and takes none.
    settled: fall of the cost that the linear problem promises below which one more step ends the iteration.
    rule: how far a step goes.
    """

    iterations: int = 40
    settled: float = 1e-2
    rule: StepRule = field(default_factory=GaussNewton)

    def __post_init__(self) -> None:
        if self.iterations < 0 or not self.settled > 0:
            raise InputError(
                f"iterations is {self.iterations}, settled {self.settled}; give at least 0 and more than 0"
            )


@dataclass(frozen=True)
class Solved:
    """Result of the iterations.

    Attributes
    ----------
    problem, stage: whose solution it is.
    linearisations: how often everything was linearised.   before: costs before each step.
    last: the linear problem about the point, where the iterations have made it.
    """

    point: LinearizationPoint
    problem: Problem
    stage: Stage
    iterations: int
    linearisations: int
    converged: bool
    before: tuple[float, ...]
    last: NormalEquations | None

    @cached_property
    def normal(self) -> NormalEquations:
        """The linear problem there, which holds the covariance: solved when it is first asked for."""
        return self.last or self.problem.normal(self.point, self.stage)

    @cached_property
    def costs(self) -> tuple[float, ...]:
        """Costs before each step, and at the end."""
        return *self.before, self.point.cost(self.normal.used, self.normal.stage)


OnIteration = Callable[[LinearizationPoint, NormalEquations], None]
"""Called with every linear problem and the point it is about."""


def solve(
    problem: Problem,
    here: LinearizationPoint,
    options: SolverOptions,
    schedule: Schedule | None = None,
    on_iteration: OnIteration | None = None,
    is_known: Callable[[LinearizationPoint], bool] | None = None,
) -> Solved:
    """Iterate from a linearisation point until the cost converges.

    Nothing is raised for a system that does not determine everything.

    Parameters
    ----------
    is_known: whether it is known already where a point leads to, so that it is followed no further.
    """
    plan = ConstantSchedule() if schedule is None else schedule
    number, used, evaluated, converged = options.rule.first, 0, 1, False
    stage = plan.stage(0, here, None)
    here = problem.staged(here, stage)
    before: list[float] = []
    normal: NormalEquations | None = None
    while used < options.iterations and not converged and not (is_known and is_known(here)):
        normal = problem.normal(here, stage)
        if on_iteration is not None:
            on_iteration(here, normal)
        there, number, tries = advanced(problem, here, normal, options.rule, number)
        used, evaluated = used + 1, evaluated + tries
        if there is None:
            break
        before.append(here.cost(normal.used, normal.stage))
        converged = normal.predicted_reduction <= options.settled and plan.last(used - 1, normal.stage)
        stage = plan.stage(used, there, normal)
        here, normal = problem.staged(plan.repaired(there, stage), stage), None
    solved = Solved(here, problem, stage, used, evaluated, converged, tuple(before), normal)
    if on_iteration is not None:
        on_iteration(here, solved.normal)
    return solved


class Advanced(NamedTuple):
    """Outcome of one iteration.

    Attributes
    ----------
    point: the next linearisation point, which fits no worse; None where there is none.
    number: of the step rule, after it.   tries: points that were tried.
    """

    point: LinearizationPoint | None
    number: float
    tries: int


def advanced(
    problem: Problem, here: LinearizationPoint, normal: NormalEquations, rule: StepRule, number: float
) -> Advanced:
    """Next linearisation point that fits no worse, by a step rule and its present number."""
    allowed = here.cost(normal.used, normal.stage)

    def again(damping: float) -> NormalEquations:
        """The linear problem with another damping."""
        return normal if damping == 0.0 else problem.normal(here, normal.stage, damping)

    for tried in range(1, rule.tries + 1):
        step = rule.propose(again, problem.layout, number)
        if step is None:
            number = rule.adapted(number, -1.0, Step(np.zeros((0, 0)), None, normal, 0.0, number))
            continue
        there = problem.at(*moved(problem, here, step), normal.stage.pose_only_loss)
        fallen = allowed - there.cost(normal.used, normal.stage)
        if fallen >= -COST_SLACK:
            gain = (fallen + COST_SLACK) / (step.predicted + COST_SLACK)
            return Advanced(there, rule.adapted(number, gain, step), tried)
        number = rule.adapted(number, -1.0, step)
    return Advanced(None, number, rule.tries)


def moved(problem: Problem, here: LinearizationPoint, step: Step) -> tuple[np.ndarray, np.ndarray]:
    """Trajectory and landmarks after a step."""
    points = here.points if step.points is None else here.points + step.points
    return problem.layout.retract(here.trajectory, step.errors), points
