"""Gauss-Newton on lines, circles and what determines nothing: the optimum, its information, how it ended."""

import numpy as np
import pytest

from spinfilters.core.gauss_newton import (
    GaussNewtonSolution,
    LeastSquaresEnd,
    StepEquations,
    gauss_newton,
    step_equations,
)
from spinfilters.core.robust_losses import Huber, RobustLoss

ANGLES = np.linspace(0.2, 2.5, 12)
CENTRE = np.array([0.3, -0.2])
SEEN = CENTRE + 2.0 * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


def circle(points: np.ndarray, loss: RobustLoss | None, most_steps: int = 30) -> GaussNewtonSolution:
    """Centre and radius of a circle through points, from a rough start."""

    def linearise(state: np.ndarray) -> StepEquations:
        away = points - state[:2]
        distance = np.linalg.norm(away, axis=1)
        jacobian = np.column_stack([away / distance[:, None], np.ones(len(points))])
        return step_equations(distance - state[2], jacobian, loss)

    return gauss_newton(
        np.array([0.0, 0.0, 1.0]),
        linearise,
        lambda state, step: state + step,
        lambda step, _: bool(np.abs(step).max() < 1e-12),
        most_steps,
    )


def test_exact_measurements_give_the_true_state() -> None:
    found = circle(SEEN, None)
    assert found.end is LeastSquaresEnd.SETTLED
    assert found.state == pytest.approx([*CENTRE, 2.0], abs=1e-10)


def test_a_robust_loss_holds_against_an_outlier() -> None:
    spoiled = SEEN.copy()
    spoiled[4] *= 3.0
    plain, robust = (circle(spoiled, loss, 200).state for loss in (None, Huber(1e-3)))
    assert np.abs(robust - [*CENTRE, 2.0]).max() < 0.01 < np.abs(plain - [*CENTRE, 2.0]).max()


def test_the_information_of_a_linear_problem_is_the_inverse_covariance() -> None:
    jacobian = np.random.default_rng(0).standard_normal((400, 2))
    found = gauss_newton(
        np.zeros(2),
        lambda x: step_equations(jacobian @ (np.array([1.0, 2.0]) - x), jacobian),
        lambda x, step: x + step,
        lambda step, _: bool(np.abs(step).max() < 1e-9),
        5,
    )
    assert found.normal is not None
    assert found.normal.information == pytest.approx(jacobian.T @ jacobian)


def test_too_few_steps_are_said_to_be_unsettled() -> None:
    assert circle(SEEN, None, 2).end is LeastSquaresEnd.UNSETTLED


@pytest.mark.parametrize(
    "information", [np.zeros((2, 2)), np.full((2, 2), np.nan)], ids=["singular", "not finite"]
)
def test_equations_that_determine_nothing_leave_the_state(information: np.ndarray) -> None:
    start = np.array([1.0, 2.0])
    found = gauss_newton(start, lambda _: StepEquations(information, np.ones(2)), np.add, lambda *_: False, 5)
    assert found.end is LeastSquaresEnd.UNDETERMINED
    assert np.array_equal(found.state, start)


def test_damping_makes_steps_of_singular_equations() -> None:
    half = StepEquations(np.diag([1.0, 0.0]), np.array([1.0, 0.0]))
    found = gauss_newton(np.zeros(2), lambda _: half, np.add, lambda *_: True, 5, lambda _: 1e-3)
    assert found.end is LeastSquaresEnd.SETTLED
    assert found.state == pytest.approx([1 / 1.001, 0.0])
