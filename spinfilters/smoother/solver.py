"""Iterations to the most probable trajectory and map, by capped steps: halved Gauss-Newton, dogleg."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import LeastSquares, RobustLoss
from spinfilters.models.state_layout import StateLayout
from spinfilters.smoother.linear_system import SchurSystem
from spinfilters.smoother.problem import LinearizationPoint, NormalEquations, Problem, Stage

DAMPINGS = (0.0, 1e-9, 1e-6, 1e-3, 1e-1)
"""Added to a diagonal relative to itself, in this order, until a system can be factored (Levenberg 1944)."""
Solve = Callable[[float], NormalEquations]
"""The linear problem with a damping."""


@dataclass(frozen=True)
class Step:
    """Proposed step of a rule.

    Attributes
    ----------
    errors : ndarray of float, shape (k, n)
        Step of each epoch's error state.
    points : ndarray of float, shape (L, 3) or None
        Steps of the landmark points, m.
    normal : NormalEquations
        The linear problem it came from.
    predicted : float
        By how much the linear problem's cost falls, at least.
    size : float
        Of the rule's own measure.
    """

    errors: Float[np.ndarray, "k n"]
    points: Float[np.ndarray, "L 3"] | None
    normal: NormalEquations
    predicted: float
    size: float


class StepRule(ABC):
    """Step rule with one adapted control parameter: share or radius."""

    tries: int = 12
    """Steps from one point before it is given up."""

    @property
    @abstractmethod
    def first(self) -> float:
        """Initial control parameter."""

    @abstractmethod
    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """A step; None when the linear problem has no solution."""

    @abstractmethod
    def adapted(self, number: float, gain: float, step: Step) -> float:
        """Control parameter after a step with this gain ratio.

        The cost fell by ``gain`` times the predicted reduction; not positive: the step is not taken.
        """


@dataclass(frozen=True)
class GaussNewton(StepRule):
    """The whole step, halved until the cost does not rise."""

    @property
    def first(self) -> float:
        """The whole step."""
        return 1.0

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """A share of the whole step."""
        normal = _solvable(solve)
        if normal is None:
            return None
        errors = normal.system.errors
        return _scale_step(normal, errors, min(number, _cap(layout, errors)))

    def adapted(self, number: float, gain: float, step: Step) -> float:
        """Half the share after a failure, else the whole step."""
        return step.size / 2 if gain <= 0 else 1.0


@dataclass(frozen=True)
class Dogleg(StepRule):
    """Dogleg steps within a trust radius in scaled units (Powell 1970; Rosen et al. 2014).

    A step goes along steepest descent first, then towards the Gauss-Newton step.
    """

    radius: float = 1e4

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError(f"dogleg radius is {self.radius}; give a positive number")

    @property
    def first(self) -> float:
        """The first radius."""
        return self.radius

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """The dogleg step within the radius."""
        normal = _solvable(solve)
        if normal is None:
            return None
        solution = normal.system
        separator_step, share = _dogleg(solution, number)
        errors = solution.ordering.errors(separator_step, solution.tridiagonal.back(separator_step))
        cap = _cap(layout, errors)
        size = solution.ordering.epochs * len(solution.ordering.pose)
        poses = cap * separator_step[:size].reshape(solution.ordering.epochs, -1)
        points = None if normal.eliminated is None else normal.eliminated.points_step(poses)
        errors = solution.ordering.errors(
            cap * separator_step, solution.tridiagonal.back(cap * separator_step)
        )
        lost = np.tril(solution.information_sqrt).T @ (solution.separator_step - cap * separator_step)
        return Step(errors, points, normal, normal.predicted_reduction - float(lost @ lost), share * cap)

    def adapted(self, number: float, gain: float, step: Step) -> float:
        """A quarter of the radius after a poor step, twice after a good one."""
        if gain < 0.25:
            return number / 4
        return number * 2 if gain > 0.75 else number


STEP_RULES: dict[str, Callable[[], StepRule]] = {"gauss-newton": GaussNewton, "dogleg": Dogleg}
"""The rules by the names of the setting ``smoother.step``."""


def _dogleg(solution: SchurSystem, radius: float) -> tuple[Float[np.ndarray, " r"], float]:
    """The dogleg step within a radius, and its length over the radius."""
    information_sqrt = np.tril(solution.information_sqrt)
    scale = np.sqrt(np.einsum("ij,ij->i", information_sqrt, information_sqrt))
    newton = scale * solution.separator_step
    if np.linalg.norm(newton) <= radius:
        return solution.separator_step, float(np.linalg.norm(newton)) / radius
    down = solution.gradient / scale
    along = information_sqrt.T @ (down / scale)
    cauchy = down * float(down @ down) / float(along @ along)
    if np.linalg.norm(cauchy) >= radius:
        return cauchy / scale * radius / np.linalg.norm(cauchy), 1.0
    rest = newton - cauchy
    a, b, c = rest @ rest, cauchy @ rest, cauchy @ cauchy - radius**2
    share = (-b + np.sqrt(b**2 - a * c)) / a
    return (cauchy + share * rest) / scale, 1.0


def _solvable(solve: Solve) -> NormalEquations | None:
    """Normal equations with the least damping that gives a solution."""
    for damping in DAMPINGS:
        normal = solve(damping)
        if normal.solved:
            return normal
    return None


def _cap(layout: StateLayout, errors: Float[np.ndarray, "k n"]) -> float:
    """Share of a step within the range of validity of the linear model."""
    longest = np.abs(errors).max(axis=0, initial=np.finfo(float).tiny)
    return min(1.0, float((_largest_steps(layout) / longest).min(initial=1.0)))


@lru_cache(maxsize=64)
def _largest_steps(layout: StateLayout) -> Float[np.ndarray, " n"]:
    """Largest step of each error component, infinite where there is none."""
    bounds = [np.full(block.dimension, block.largest_step) for block in layout.members]
    return np.concatenate([np.zeros(0), *bounds])


def _scale_step(normal: NormalEquations, errors: Float[np.ndarray, "k n"], share: float) -> Step:
    """Part of the whole step, landmarks and velocities too."""
    points = None
    if normal.eliminated is not None:
        points = normal.eliminated.points_step(normal.system.poses)
    if share != 1.0:
        errors, points = share * errors, None if points is None else share * points
    predicted = share * (2 - share) * normal.predicted_reduction
    return Step(errors, points, normal, predicted, share)


COST_SLACK = 1e-3
"""By which the cost may rise: chi-square numbers differ by far more, rounding by far less."""


AT_A_KINK = 0.5
"""Fall of the cost that the linear problem promises, below which an iteration may end where no step lowers the cost.

The cost has a kink or a jump there, as where a ray passes the edge of a face, which has another noise. The minimum of the linear
problem is within 0.7 standard deviations.
"""
NEAR_A_KINK = 0.05
"""The same where the cost falls only by a short step."""
CUT = 4
"""Number of the step from a point that is short: each is half the one before, so that it is an eighth of the whole."""


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
    iterations : int
        Steps at most; 0 linearises and takes none.
    settled : float
        Fall of the cost that the linear problem promises below which one more step ends the iteration.
    rule : StepRule
        How far a step goes.
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
    problem : Problem
        Whose solution it is.
    stage : Stage
        Whose solution it is.
    linearisations : int
        How often everything was linearised.
    before : tuple[float, ...]
        Costs before each step.
    last : NormalEquations or None
        The linear problem about the point, where the iterations have made it.
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
    """Iterate from a linearisation point until the cost converges; an underdetermined system raises nothing.

    Parameters
    ----------
    is_known : Callable[[LinearizationPoint], bool] or None
        Whether it is known already where a point leads to, so that it is followed no further.
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
        converged = _is_settled(normal, options, there, tries) and plan.last(used - 1, normal.stage)
        if there is None:
            break
        before.append(here.cost(normal.used, normal.stage))
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
    point : LinearizationPoint or None
        The next linearisation point, which fits no worse; None where there is none.
    number : float
        Of the step rule, after it.
    tries : int
        Points that were tried.
    """

    point: LinearizationPoint | None
    number: float
    tries: int


def _is_settled(
    normal: NormalEquations, options: SolverOptions, there: LinearizationPoint | None, tries: int
) -> bool:
    """Whether the cost has as good as ended to fall; ``there`` is None where no step lowered it."""
    kink = AT_A_KINK if there is None else NEAR_A_KINK if tries >= CUT else 0.0
    return normal.predicted_reduction <= max(options.settled, kink)


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
