"""What leaves a smoother's window loses nothing: the latest epoch, the step and the cost stay, and no gauge becomes known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.models.gauge import gauge_directions
from spinfilters.models.process import ProcessNoise
from spinfilters.smoother import window as window_policy
from spinfilters.smoother.linear_system import SchurSystem, latest_factor
from spinfilters.smoother.marginalization import without_landmarks, without_oldest
from spinfilters.smoother.priors import (
    FirstStatePrior,
    MarginalizationPrior,
    column_errors,
    column_resets,
    gauge_columns,
    inverse_resets,
    with_columns_reset,
)
from spinfilters.smoother.problem import LinearizationPoint, LinearProblem, NormalEquations, Problem
from spinfilters.smoother.window import FixedLag, FullSmoothing, LandmarkMarginalization, Window, WindowPolicy
from tests.smoother.smoothing_samples import (
    LAYOUT,
    LONG,
    PLAIN,
    PROCESS,
    SOON,
    STD,
    run,
    sample,
    smoother,
)

LOOSE = np.concatenate([np.repeat([0.03, 0.1], 3), STD[6:]])
"""Of a first pose that hardly says where g is: there anything that the gauge is told wrongly shows."""


@cache
def _window() -> Window:
    """Nine epochs, all still there, about a point that is not the optimum."""
    whole = run(smoother(sample(LONG), FullSmoothing(), LOOSE), sample(LONG).epochs[:9]).window
    generator = np.random.default_rng(1)
    errors = np.repeat([1e-4, 3e-4, 1e-4, 1e-3, 1e-4, 0.02], [3, 3, 3, 3, 3, 5]) * generator.standard_normal(
        (9, 20)
    )
    errors[:, 12:] = errors[0, 12:]
    points = whole.points + 1e-4 * generator.standard_normal(whole.points.shape)
    return replace(whole, trajectory=LAYOUT.retract(whole.trajectory, errors), points=points)


def _prior(window: Window) -> FirstStatePrior | None:
    return FirstStatePrior(sample(LONG).truth[0], LOOSE) if window.marginal_prior is None else None


def _linear(
    window: Window, prior: FirstStatePrior | None
) -> tuple[Problem, LinearizationPoint, NormalEquations]:
    problem = window.problem(PROCESS, prior, has_landmarks=True)
    here = problem.at(window.trajectory, window.points)
    return problem, here, problem.normal(here, PLAIN)


def _solution(normal: NormalEquations) -> SchurSystem:
    assert isinstance(normal.solution, SchurSystem)
    return normal.solution


def _without(chosen: np.ndarray) -> tuple[Window, FirstStatePrior]:
    """The window without some landmarks; the prior is still that of its oldest epoch."""
    prior = FirstStatePrior(sample(LONG).truth[0], LOOSE)
    problem, here, normal = _linear(_window(), prior)
    return without_landmarks(_window(), problem, LinearProblem(here, normal), chosen), prior


def _seen_before(window: Window, epoch: int) -> np.ndarray:
    return np.isin(np.arange(len(window.ids)), window.seen.landmark[window.seen.epoch < epoch])


def _seen_by_the_oldest(window: Window) -> np.ndarray:
    return _seen_before(window, 1)


def _same_cost(window: Window, prior: FirstStatePrior | None, gone: int) -> bool:
    """Whether the least cost is the whole window's; covariance and step are checked, its first epochs are gone."""
    _, before, whole = _linear(_window(), FirstStatePrior(sample(LONG).truth[0], LOOSE))
    _, after, rest = _linear(window, prior)
    expected, found = latest_factor(_solution(whole)), latest_factor(_solution(rest))
    std = np.linalg.norm(expected, axis=1)
    correlation = np.outer(std, std)
    np.testing.assert_allclose(
        found @ found.T / correlation, expected @ expected.T / correlation, rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(
        _solution(rest).errors / std, _solution(whole).errors[gone:] / std, rtol=1e-6, atol=1e-6
    )
    least = before.cost(whole.used, PLAIN) - whole.predicted_reduction
    return after.cost(rest.used, PLAIN) - rest.predicted_reduction == pytest.approx(least, rel=1e-8)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_landmarks_that_leave_change_neither_covariance_nor_step_nor_cost(share: float) -> None:
    chosen = np.random.default_rng(2).random(len(_window().ids)) < share
    window, prior = _without(chosen)
    assert len(window.ids) == np.count_nonzero(~chosen)
    assert window.marginal_prior is not None
    assert _same_cost(window, prior, 0)


def _oldest_gone(window: Window, prior: FirstStatePrior | None, count: int) -> Window:
    """Without epochs whose landmarks have left."""
    problem, here, normal = _linear(window, prior)
    return without_oldest(
        window, problem, LinearProblem(here, normal), np.zeros(len(window.ids), dtype=bool), count
    )


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_the_oldest_epochs_that_leave_change_neither_covariance_nor_step_nor_cost(count: int) -> None:
    window, prior = _without(_seen_before(_window(), count))
    after = _oldest_gone(window, prior, count)
    assert len(after.epochs) == len(_window().epochs) - count
    assert _same_cost(after, None, count)


def test_epochs_that_leave_with_their_landmarks_change_neither_covariance_nor_step_nor_cost() -> None:
    problem, here, normal = _linear(_window(), FirstStatePrior(sample(LONG).truth[0], LOOSE))
    after = without_oldest(_window(), problem, LinearProblem(here, normal), _seen_before(_window(), 3), 3)
    assert _same_cost(after, None, 3)


def test_epochs_may_leave_one_after_the_other() -> None:
    window, prior = _without(_seen_before(_window(), 3))
    after = _oldest_gone(_oldest_gone(window, prior, 1), None, 2)
    assert _same_cost(after, None, 3)


def test_landmarks_may_leave_in_two_parts() -> None:
    chosen = np.arange(len(_window().ids)) % 3 == 0
    window, prior = _without(chosen)
    problem, here, normal = _linear(window, prior)
    again = without_landmarks(
        window, problem, LinearProblem(here, normal), np.arange(len(window.ids)) % 2 == 0
    )
    assert _same_cost(again, prior, 0)


@cache
def _carried_window() -> Window:
    window, prior = _without(_seen_by_the_oldest(_window()))
    return _oldest_gone(window, prior, 1)


def _moved(window: Window, scale: float) -> np.ndarray:
    """The trajectory after estimates have moved, as they do when the next epochs come."""
    generator = np.random.default_rng(5)
    std = scale * np.repeat([0.01, 0.03, 0.02, 0.05, 0.01, 0.2], [3, 3, 3, 3, 3, 5])
    errors = std * generator.standard_normal((len(window.trajectory), 20))
    errors[:, 12:] = errors[0, 12:]
    return LAYOUT.retract(window.trajectory, errors)


def _along_the_gauge(window: Window, trajectory: np.ndarray) -> np.ndarray:
    """Information of what is carried, about this trajectory, along the six directions of the gauge there."""
    assert window.marginal_prior is not None
    here = trajectory[: len(window.marginal_prior.first)]
    N = gauge_columns(window.marginal_prior.ordering, here)
    return N.T @ window.marginal_prior.at(trajectory).gram @ N


def test_moved_estimates_tell_the_carried_quadratic_nothing_of_the_gauge() -> None:
    window = _carried_window()
    first = _along_the_gauge(window, window.trajectory)
    for scale in (0.1, 1.0):
        found = _along_the_gauge(window, _moved(window, scale))
        np.testing.assert_allclose(found, first, rtol=1e-6, atol=1e-6 * np.abs(first).max())


def test_without_the_correction_moved_estimates_would_tell_the_gauge() -> None:
    window = _carried_window()
    assert window.marginal_prior is not None
    N = gauge_columns(window.marginal_prior.ordering, _moved(window, 1.0)[: len(window.marginal_prior.first)])
    first = _along_the_gauge(window, window.trajectory)
    assert np.abs(N.T @ window.marginal_prior.gram @ N - first).max() > 10 * np.abs(first).max()


def _rows_about(prior: MarginalizationPrior, here: np.ndarray) -> np.ndarray:
    """Rows [R_now | y_now] about other points of the prior's epochs."""
    errors = prior.ordering.layout.local(prior.first, here)
    away, resets = column_errors(prior.ordering, errors), column_resets(prior.ordering, errors)
    root, p = with_columns_reset(prior.information_sqrt, inverse_resets(resets)), len(prior.ordering.pose)
    root[:, :p] += root @ prior.shift(here, resets)
    return np.concatenate([root, (prior.right - prior.information_sqrt @ away)[:, None]], axis=1)


def test_the_root_about_other_points_is_that_of_the_gram_matrix() -> None:
    window = _carried_window()
    assert window.marginal_prior is not None
    trajectory = _moved(window, 1.0)
    about, rows = (
        window.marginal_prior.at(trajectory),
        _rows_about(window.marginal_prior, trajectory[: len(window.marginal_prior.first)]),
    )
    gram = rows.T @ rows
    scale = np.abs(gram).max()
    np.testing.assert_allclose(gram[:-1, :-1], about.gram, atol=1e-9 * scale)
    np.testing.assert_allclose(
        gram[:-1, -1], about.gradient, rtol=1e-6, atol=1e-9 * np.abs(gram[:, -1]).max()
    )
    assert about.cost == pytest.approx(gram[-1, -1] + window.marginal_prior.constant_cost, rel=1e-9)


@pytest.mark.parametrize("scale", [0.0, 1.0, 3.0])
def test_the_gradient_of_the_carried_quadratic_is_the_derivative_of_its_cost(scale: float) -> None:
    window = _carried_window()
    assert window.marginal_prior is not None
    prior, here, step = window.marginal_prior, _moved(window, scale), 1e-5
    about, constant = prior.at(here), prior.ordering.constant
    columns = len(prior.first) * len(prior.ordering.pose) + np.arange(len(constant))
    for column, component in zip(columns, constant, strict=True):
        error = np.zeros((len(here), LAYOUT.error_dim))
        error[:, component] = step
        ends = [prior.at(LAYOUT.retract(here, sign * error)).cost for sign in (-1.0, 1.0)]
        # cost = |rest - R e|^2, and the gradient is R' rest
        expected = -(ends[1] - ends[0]) / (4 * step)
        assert about.gradient[column] == pytest.approx(
            expected, rel=1e-4, abs=1e-6 * np.abs(about.gradient).max()
        )


def _known_of_the_gauge(factor: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Information that a belief has along the gauge, (6, 6)."""
    seen = np.linalg.solve(factor, gauge_directions(LAYOUT, x))
    return seen.T @ seen


EXACT = replace(LONG, pixel_std=1e-9, noise=ProcessNoise(0.0, 0.0))


@pytest.mark.parametrize(
    "mode", [FullSmoothing(), FixedLag(8, SOON), LandmarkMarginalization(0.3, 10, SOON)], ids=str
)
def test_a_run_without_noise_tells_nothing_of_the_gauge(
    mode: WindowPolicy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The latest state never knows more of it than the prior did, in any direction."""
    monkeypatch.setattr(window_policy, "SMALLEST_LANDMARK_BATCH", 1)
    here = sample(EXACT)
    sliding = run(smoother(here, mode, LOOSE), here.epochs)
    root = np.linalg.cholesky(_known_of_the_gauge(np.diag(LOOSE), here.truth[0]))
    latest = _known_of_the_gauge(sliding.belief.factor, sliding.belief.mean)
    shares = np.linalg.eigvalsh(np.linalg.solve(root, np.linalg.solve(root, latest).T))
    assert shares.max() < 1.001
    assert shares.min() > 0.9


def test_frozen_vision_that_freezes_nothing_is_full_smoothing() -> None:
    here = sample(LONG)
    full, frozen = (
        run(smoother(here, mode), here.epochs[:12])
        for mode in (FullSmoothing(), LandmarkMarginalization(1000.0))
    )
    assert frozen.window.marginal_prior is None
    np.testing.assert_array_equal(frozen.window.trajectory, full.window.trajectory)
    np.testing.assert_array_equal(frozen.belief.factor, full.belief.factor)


def test_a_lag_as_long_as_the_run_is_full_smoothing() -> None:
    here = sample(LONG)
    full, lag = (run(smoother(here, mode), here.epochs[:12]) for mode in (FullSmoothing(), FixedLag(12)))
    np.testing.assert_array_equal(lag.window.trajectory, full.window.trajectory)
    np.testing.assert_array_equal(lag.belief.factor, full.belief.factor)


def test_no_epoch_leaves_while_the_inertia_is_not_determined() -> None:
    here, seen = sample(LONG), []
    sliding = smoother(here, FixedLag(3, SOON))
    for k, epoch in enumerate(here.epochs):
        marginalized = sliding.add(epoch).marginalized
        seen.append((sliding.mass_std > SOON, k + 1 > 3, len(marginalized)))
    assert any(unobservable and longer for unobservable, longer, _ in seen)
    assert not any(unobservable and marginalized for unobservable, _, marginalized in seen)
    assert sum(marginalized for *_, marginalized in seen) > 1


def test_landmarks_unseen_for_long_are_frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(window_policy, "SMALLEST_LANDMARK_BATCH", 1)
    here = sample(LONG)
    sliding = run(smoother(here, LandmarkMarginalization(0.3)), here.epochs)
    full = run(smoother(here, FullSmoothing()), here.epochs)
    assert sliding.window.marginal_prior is not None
    assert len(sliding.window.seen.landmark) < 0.8 * len(full.window.seen.landmark)
    assert len(sliding.window.epochs) == len(here.epochs)
