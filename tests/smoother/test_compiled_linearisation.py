"""A window linearised and solved in C is that of NumPy: steps, marginalization prior, solution."""

from functools import cache

import numpy as np
import pytest

from spinfilters.smoother import linear_system, marginalization, motion_factors, priors
from spinfilters.smoother.kernels import kernels, scipy_address
from spinfilters.smoother.marginalization import without_oldest
from spinfilters.smoother.priors import MarginalizationPrior
from spinfilters.smoother.problem import LinearizationPoint, LinearProblem, NormalEquations, Problem
from spinfilters.smoother.window import FixedLag
from tests.smoother.smoothing_samples import LAYOUT, LONG, PLAIN, run, sample, smoother


@cache
def _window(epochs: int) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Problem of a window after so many epochs, and a point off its optimum."""
    found = run(smoother(sample(LONG), FixedLag(5, np.inf)), sample(LONG).epochs[:epochs])
    window, generator = found.window, np.random.default_rng(2)
    errors = np.repeat([1e-4, 3e-4, 1e-4, 1e-3, 1e-4, 0.02], [3, 3, 3, 3, 3, 5])
    errors = errors * generator.standard_normal((len(window.epochs), 20))
    errors[:, 12:] = errors[0, 12:]
    return found.problem(), LAYOUT.retract(window.trajectory, errors), window.points


def _linearised(epochs: int, damping: float = 0.0) -> tuple[LinearizationPoint, NormalEquations]:
    problem, trajectory, points = _window(epochs)
    here = problem.at(trajectory, points)
    return here, problem.normal(here, PLAIN, damping)


def _in_numpy(
    monkeypatch: pytest.MonkeyPatch, epochs: int, damping: float = 0.0
) -> tuple[LinearizationPoint, NormalEquations]:
    for file in (linear_system, motion_factors, priors):
        monkeypatch.setattr(file, "kernels", lambda: None)
    found = _linearised(epochs, damping)
    monkeypatch.undo()
    return found


@pytest.fixture(autouse=True)
def _with_kernels() -> None:
    if kernels() is None:
        pytest.skip("no C compiler on this machine")


@pytest.mark.parametrize("epochs", [2, 4, 20])
def test_steps_are_those_of_numpy(epochs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    (fast, _), (plain, _) = _linearised(epochs), _in_numpy(monkeypatch, epochs)
    for found, expected in (
        (fast.dynamics.rows, plain.dynamics.rows),
        (fast.dynamics.steps, plain.dynamics.steps),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    assert fast.dynamics.cost == pytest.approx(plain.dynamics.cost, rel=1e-9)
    assert (fast.dynamics.noise is None) == (plain.dynamics.noise is None)


def test_a_marginalization_prior_is_that_of_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    fast, plain = _linearised(20)[0].marginal_prior, _in_numpy(monkeypatch, 20)[0].marginal_prior
    assert fast is not None
    assert plain is not None
    assert plain.marginal_prior.knows_constants
    np.testing.assert_allclose(fast.gram, plain.gram, rtol=1e-8, atol=1e-12 * np.abs(plain.gram).max())
    np.testing.assert_allclose(
        fast.gradient, plain.gradient, rtol=1e-8, atol=1e-11 * np.abs(plain.gradient).max()
    )
    assert fast.cost == pytest.approx(plain.cost, rel=1e-9)


@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize("epochs", [1, 4, 20])
@pytest.mark.parametrize("lapack", [False, True])
def test_a_solution_is_that_of_numpy(
    epochs: int, damping: float, lapack: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = _in_numpy(monkeypatch, epochs, damping)[1].system
    if lapack:
        address = scipy_address("scipy.linalg.cython_lapack", "dpotrf")
        monkeypatch.setattr(linear_system, "potrf_address", lambda: address)
    fast = _linearised(epochs, damping)[1].system
    np.testing.assert_allclose(
        np.tril(fast.information_sqrt), np.tril(plain.information_sqrt), rtol=1e-6, atol=1e-8
    )
    np.testing.assert_allclose(fast.errors, plain.errors, rtol=1e-5, atol=1e-10)
    np.testing.assert_allclose(
        fast.gradient, plain.gradient, rtol=1e-7, atol=1e-9 * np.abs(plain.gradient).max()
    )
    assert fast.predicted_reduction == pytest.approx(plain.predicted_reduction, rel=1e-7)


def test_rows_are_moved_to_the_first_estimates_as_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    window = run(smoother(sample(LONG), FixedLag(5, np.inf)), sample(LONG).epochs[:20]).window
    problem, trajectory, points = _window(20)
    normal = problem.normal(here := problem.at(trajectory, points), PLAIN)
    left = window.seen.landmark[window.seen.epoch < 2]
    landmarks = np.isin(np.arange(len(window.ids)), left)

    def root() -> MarginalizationPrior:
        linear = LinearProblem(here, normal)
        prior = without_oldest(window, problem, linear, landmarks, count=2).marginal_prior
        assert prior is not None
        return prior

    fast = root()
    monkeypatch.setattr(marginalization, "kernels", lambda: None)
    plain = root()
    np.testing.assert_allclose(fast.gram, plain.gram, rtol=1e-8, atol=1e-10 * np.abs(plain.gram).max())
    np.testing.assert_allclose(
        fast.information_sqrt.T @ fast.right, plain.information_sqrt.T @ plain.right, rtol=1e-7, atol=1e-6
    )
