"""Step rules reach one optimum from a start that is off, their steps are capped, and wrong associations do not spoil it."""

from collections.abc import Callable

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import Barron, Graduated, LeastSquares, PseudoHuber, RobustLoss
from spinfilters.models.state_blocks import ATTITUDE, MASS_DISTRIBUTION
from spinfilters.smoother import solver
from spinfilters.smoother.linear_system import Marginals, SchurSystem
from spinfilters.smoother.problem import InitialGuess, LinearizationPoint, NormalEquations, Stage
from spinfilters.smoother.solver import (
    COST_SLACK,
    Dogleg,
    GaussNewton,
    Solved,
    SolverOptions,
    StepRule,
    solve,
)
from tests.smoother.smoothing_samples import (
    LAYOUT,
    MIDDLE,
    PLAIN,
    Sample,
    optimum,
    perturbed,
    sample,
    solved,
    whitened,
)

RULES = (GaussNewton(), Dogleg(), Dogleg(1.0))


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("seed", [0, 1])
def test_every_rule_reaches_the_optimum_from_a_start_that_is_off(rule: StepRule, seed: int) -> None:
    found = solved(sample(MIDDLE), perturbed(sample(MIDDLE), seed), rule)
    assert found.converged
    assert found.costs[-1] == pytest.approx(optimum(MIDDLE).costs[-1], abs=0.02)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_no_step_raises_the_cost(rule: StepRule) -> None:
    costs = solved(sample(MIDDLE), perturbed(sample(MIDDLE), 2, scale=2.0), rule).costs
    assert len(costs) > 2
    assert np.diff(costs).max() <= COST_SLACK


def _heavy_on_one_side(here: Sample) -> InitialGuess:
    """The mass distribution off by a factor of e^4 and more."""
    trial = perturbed(here, 4)
    trajectory = trial.trajectory.copy()
    trajectory[:, LAYOUT.mean_slice("s")] += [4.0, -3.0, 2.0, 2.0, -2.0]
    return InitialGuess(trajectory, trial.ids, trial.points)


@pytest.mark.parametrize(("fall", "is_settled"), [(0.3, True), (2.0, False)])
def test_an_iteration_has_settled_at_a_kink_of_the_cost(
    fall: float, is_settled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No step lowers the cost, as where a ray passes an edge; the linear problem promises a fall nevertheless."""
    problem, best = sample(MIDDLE).problem, optimum(MIDDLE).point
    errors = np.zeros((len(best.trajectory), LAYOUT.error_dim))
    errors[-1, LAYOUT.slice("w")] = 1e-4

    def near(scale: float) -> LinearizationPoint:
        return problem.at(LAYOUT.retract(best.trajectory, scale * errors), best.points)

    promised = problem.normal(near(1.0), Stage(LeastSquares())).predicted_reduction
    monkeypatch.setattr(solver, "advanced", lambda *_: solver.Advanced(None, 1.0, 12))
    found = solve(problem, near(np.sqrt(fall / promised)), SolverOptions())
    assert found.converged is is_settled


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_steps_are_capped_where_a_linear_model_tells_nothing(rule: StepRule) -> None:
    whole, trial = sample(MIDDLE).problem, _heavy_on_one_side(sample(MIDDLE))
    here = whole.at(trial.trajectory, trial.points)
    normal = whole.normal(here, PLAIN)

    def again(damping: float) -> NormalEquations:
        return whole.normal(here, PLAIN, damping)

    step = rule.propose(again, LAYOUT, rule.first)
    assert step is not None
    assert isinstance(normal.solution, SchurSystem)
    assert np.abs(normal.solution.errors[:, LAYOUT.slice("s")]).max() > MASS_DISTRIBUTION.largest_step
    assert np.abs(step.errors[:, LAYOUT.slice("s")]).max() <= MASS_DISTRIBUTION.largest_step * (1 + 1e-12)
    assert np.abs(step.errors[:, LAYOUT.slice("a")]).max() <= ATTITUDE.largest_step * (1 + 1e-12)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_a_mass_distribution_that_is_far_off_does_not_diverge(rule: StepRule) -> None:
    found = solved(sample(MIDDLE), _heavy_on_one_side(sample(MIDDLE)), rule)
    assert np.isfinite(found.point.trajectory).all()
    assert found.costs[-1] <= found.costs[0]
    assert np.diff(found.costs).max() <= COST_SLACK


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_a_rule_promises_what_the_linear_problem_keeps(rule: StepRule) -> None:
    """Near the optimum the cost falls by what was predicted."""
    whole, trial = sample(MIDDLE).problem, perturbed(sample(MIDDLE), 0, scale=0.02)
    here = whole.at(trial.trajectory, trial.points)
    normal = whole.normal(here, PLAIN)
    step = rule.propose(lambda damping: whole.normal(here, PLAIN, damping), LAYOUT, rule.first)
    assert step is not None
    assert step.points is not None
    there = whole.at(LAYOUT.retract(trial.trajectory, step.errors), trial.points + step.points)
    fallen = here.cost(normal.used, PLAIN) - there.cost(normal.used, PLAIN)
    assert fallen > 0.95 * step.predicted > 0


def test_no_iterations_take_no_step() -> None:
    whole, trial = sample(MIDDLE).problem, perturbed(sample(MIDDLE), 0)
    here = whole.at(trial.trajectory, trial.points)
    found = solve(whole, here, SolverOptions(0))
    assert found.point is here
    assert (found.iterations, found.linearisations, found.converged) == (0, 1, False)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Dogleg(-1.0),
        lambda: Dogleg(np.inf),
        lambda: SolverOptions(-1),
        lambda: SolverOptions(settled=0.0),
    ],
)
def test_numbers_without_a_meaning_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(InputError, match="give"):
        make()


def _off_the_clean_optimum(found: Solved) -> float:
    """Root mean square over the latest state's directions, in the clean problem's standard deviations."""
    clean = optimum(MIDDLE)
    assert isinstance(clean.normal.solution, SchurSystem)
    factor = Marginals(clean.normal.solution, clean.normal.eliminated).factors[-1]
    error = LAYOUT.local(clean.point.trajectory[-1], found.point.trajectory[-1])
    return float(np.sqrt(np.mean(whitened(factor, error) ** 2)))


@pytest.mark.parametrize(
    ("wrong", "loss", "most"),
    [
        (0.5, Graduated(), 3.0),
        (0.3, Graduated(), 2.0),
        (0.1, PseudoHuber(), 3.0),
        (0.1, Barron(), 2.0),
        (0.1, Barron(-2.0), 2.0),
        (0.0, PseudoHuber(), 1.0),
    ],
    ids=str,
)
def test_robust_kernels_end_near_the_clean_optimum(wrong: float, loss: RobustLoss, most: float) -> None:
    here = sample(MIDDLE, wrong)
    found = solved(here, perturbed(sample(MIDDLE), 3, scale=0.5), loss=loss)
    assert _off_the_clean_optimum(found) < most


def test_least_squares_does_not_end_near_the_clean_optimum() -> None:
    found = solved(sample(MIDDLE, 0.1), perturbed(sample(MIDDLE), 3, scale=0.5), loss=LeastSquares())
    assert _off_the_clean_optimum(found) > 10.0
