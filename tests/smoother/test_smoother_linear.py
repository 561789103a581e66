"""On a linear model the smoother is the textbook's: Kalman filter forwards, Rauch-Tung-Striebel backwards."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import PseudoHuber
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.timeline import Epoch, Timeline
from spinfilters.smoother.linear_system import Marginals, SchurSystem, latest_factor
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import problem_of
from spinfilters.smoother.sliding_smoother import SlidingSmoother, SmootherOptions
from spinfilters.smoother.solver import (
    Dogleg,
    GaussNewton,
    SolverOptions,
    StepRule,
    solve,
)
from spinfilters.smoother.window import FixedLag, FullSmoothing, LandmarkMarginalization
from tests.filters.linear_samples import LAYOUT, LinearProcess, LinearSensor, N, linear_sensor

NO_IDS = np.zeros(0, dtype=int)
NO_POINTS = np.zeros((0, 3))
MOVING = LAYOUT.slice("c").start


@dataclass(frozen=True)
class Case:
    """A linear model whose block c is constant, its epochs, and a prior."""

    process: LinearProcess
    epochs: Timeline
    prior: FirstStatePrior


def _frames(sensors: list[LinearSensor], dt: np.ndarray, counts: np.ndarray, seed: int) -> Timeline:
    """Epochs with so many values of each sensor; none at all where both counts are 0."""
    generator, time, epochs = np.random.default_rng(seed), np.cumsum([0.0, *dt]), []
    for stamp, here in zip(time, counts, strict=True):
        every = [
            sensor.measurement(generator.standard_normal((count, sensor.dim)))
            for sensor, count in zip(sensors, here, strict=True)
            if count
        ]
        epochs.append(Epoch(float(stamp), tuple(every)))
    return tuple(epochs)


@cache
def _case(name: str) -> Case:
    generator = np.random.default_rng(8)
    A, noise = 0.3 * generator.standard_normal((N, N)), np.zeros((N, 7))
    A[MOVING:] = 0.0
    noise[:MOVING] = 0.2 * generator.standard_normal((MOVING, 7))
    sensors = [linear_sensor(2, generator), linear_sensor(4, generator)]
    dt, counts = np.full(24, 0.3), np.tile([1, 0], (25, 1))
    if name == "gaps":
        counts[4:13] = 0
        counts[::3] = 0
    if name == "several at once":
        counts = generator.integers(0, 4, (25, 2))
    if name == "uneven time":
        dt = 0.02 + generator.random(24)
    if name == "one epoch":
        dt, counts = dt[:0], np.array([[2, 1]])
    if name == "nothing measured":
        counts[:] = 0
    prior = FirstStatePrior(generator.standard_normal(N), 0.5 + generator.random(N))
    return Case(LinearProcess(A, noise), _frames(sensors, dt, counts, 9), prior)


CASES = ("one sensor", "gaps", "several at once", "uneven time", "one epoch")


@dataclass(frozen=True)
class Textbook:
    """Filtered and smoothed moments, epoch by epoch."""

    filtered: list[tuple[np.ndarray, np.ndarray]]
    smoothed: list[tuple[np.ndarray, np.ndarray]]


def _updated(mean: np.ndarray, P: np.ndarray, m: Measurement) -> tuple[np.ndarray, np.ndarray]:
    assert isinstance(m.model, LinearSensor)
    H, R = m.model.H, m.model.noise @ m.model.noise.T
    for value in m.values:
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        mean, P = mean + gain @ (value - H @ mean), (np.eye(N) - gain @ H) @ P
    return mean, P


def _textbook(case: Case) -> Textbook:
    mean, P = case.prior.mean, np.diag(case.prior.std**2)
    filtered, predicted = [], []
    for k, epoch in enumerate(case.epochs):
        if k:
            dt = epoch.time - case.epochs[k - 1].time
            F, Q = case.process.transition(dt), dt * case.process.noise @ case.process.noise.T
            mean, P = F @ mean, F @ P @ F.T + Q
            predicted.append((F, mean, P))
        for m in epoch.measurements:
            mean, P = _updated(mean, P, m)
        filtered.append((mean, P))
    smoothed = [filtered[-1]]
    for (F, ahead, P_ahead), (mean, P) in zip(reversed(predicted), reversed(filtered[:-1]), strict=True):
        C = P @ F.T @ np.linalg.inv(P_ahead)
        after, P_after = smoothed[0]
        smoothed.insert(0, (mean + C @ (after - ahead), P + C @ (P_after - P_ahead) @ C.T))
    return Textbook(filtered, smoothed)


def _solved(case: Case, rule: StepRule) -> tuple[Float[np.ndarray, "k n"], SchurSystem]:
    """From a trial that is anywhere, but whose constants are the same in all epochs."""
    problem = problem_of(case.process, case.epochs, NO_IDS, case.prior, 2)
    trial = np.random.default_rng(10).standard_normal((len(case.epochs), N))
    trial[:, MOVING:] = trial[0, MOVING:]
    found = solve(problem, problem.at(trial, NO_POINTS), SolverOptions(60, 1e-9, rule))
    assert found.converged
    assert isinstance(found.normal.solution, SchurSystem)
    return found.point.trajectory, found.normal.solution


@pytest.mark.parametrize("name", CASES)
def test_means_and_covariances_are_the_textbooks(name: str) -> None:
    expected = _textbook(_case(name)).smoothed
    trajectory, solution = _solved(_case(name), GaussNewton())
    for x, factor, (mean, P) in zip(trajectory, Marginals(solution, None).factors, expected, strict=True):
        np.testing.assert_allclose(x, mean, rtol=0, atol=1e-10)
        np.testing.assert_allclose(factor @ factor.T, P, rtol=0, atol=1e-10)
    latest = latest_factor(solution)
    np.testing.assert_allclose(latest @ latest.T, expected[-1][1], rtol=0, atol=1e-10)


def test_without_a_measurement_the_covariance_is_what_the_dynamics_make_of_the_prior() -> None:
    case = _case("nothing measured")
    expected = _textbook(case).filtered
    _, solution = _solved(case, GaussNewton())
    for factor, (_, P) in zip(Marginals(solution, None).factors, expected, strict=True):
        np.testing.assert_allclose(factor @ factor.T, P, rtol=0, atol=1e-7 * np.abs(expected[-1][1]).max())


def test_dogleg_steps_end_at_the_same_means() -> None:
    trajectory, _ = _solved(_case("several at once"), Dogleg(10.0))
    expected = np.array([mean for mean, _ in _textbook(_case("several at once")).smoothed])
    np.testing.assert_allclose(trajectory, expected, atol=1e-5)


def _sliding(case: Case, mode: FixedLag | FullSmoothing | LandmarkMarginalization) -> SlidingSmoother:
    return SlidingSmoother(case.process, case.prior, SmootherOptions(mode), has_landmarks=False)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(
    "mode", [FullSmoothing(), FixedLag(2), FixedLag(5), LandmarkMarginalization(epochs=4)], ids=str
)
def test_the_newest_state_is_the_kalman_filters_whatever_is_kept(
    name: str, mode: FixedLag | FullSmoothing | LandmarkMarginalization
) -> None:
    case = _case(name)
    smoother = _sliding(case, mode)
    for epoch, (mean, P) in zip(case.epochs, _textbook(case).filtered, strict=True):
        smoother.add(epoch)
        belief = smoother.belief
        np.testing.assert_allclose(belief.mean, mean, rtol=0, atol=1e-9)
        np.testing.assert_allclose(belief.factor @ belief.factor.T, P, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("mode", [FullSmoothing(), FixedLag(6)], ids=str)
def test_the_window_is_the_textbooks_smoothing(mode: FixedLag | FullSmoothing) -> None:
    case = _case("several at once")
    smoother = _sliding(case, mode)
    for epoch in case.epochs:
        smoother.add(epoch)
    rows = smoother.smoothed()
    assert len(rows) == min(len(case.epochs), 6 if isinstance(mode, FixedLag) else 99)
    for row, (mean, P) in zip(rows, _textbook(case).smoothed[-len(rows) :], strict=True):
        np.testing.assert_allclose(row.mean, mean, rtol=0, atol=1e-9)
        np.testing.assert_allclose(row.factor @ row.factor.T, P, rtol=0, atol=1e-9)


def test_an_epoch_that_leaves_is_smoothed_over_the_lag() -> None:
    """The last that is said of it knows all epochs that came before it left."""
    case = _case("uneven time")
    smoother, gone = _sliding(case, FixedLag(4)), 0
    for k, epoch in enumerate(case.epochs):
        for row in smoother.add(epoch).marginalized:
            mean, P = _textbook(Case(case.process, case.epochs[: k + 1], case.prior)).smoothed[gone]
            assert row.time == case.epochs[gone].time
            np.testing.assert_allclose(row.mean, mean, rtol=0, atol=1e-9)
            np.testing.assert_allclose(row.factor @ row.factor.T, P, rtol=0, atol=1e-9)
            gone += 1
    assert gone == len(case.epochs) - 4


def test_a_robust_kernel_keeps_a_wrong_value_from_pulling() -> None:
    case = _case("one sensor")
    epochs = list(case.epochs)
    wrong = epochs[9].measurements[0]
    epochs[9] = Epoch(epochs[9].time, (Measurement(wrong.model, wrong.values + 1e4, wrong.parameters),))
    trial = np.array([mean for mean, _ in _textbook(case).smoothed])
    away = []
    for loss in (None, PseudoHuber()):
        problem = problem_of(case.process, tuple(epochs), NO_IDS, case.prior, 2, loss)
        found = solve(problem, problem.at(trial, NO_POINTS), SolverOptions(60))
        away.append(np.abs(found.point.trajectory - trial).max())
    assert away[0] > 1e2
    assert away[1] < 5.0


def _backwards(smoother: SlidingSmoother, case: Case) -> None:
    smoother.add(case.epochs[3])
    smoother.add(case.epochs[2])


def _twice(smoother: SlidingSmoother, case: Case) -> None:
    smoother.add(case.epochs[3])
    smoother.add(case.epochs[3])


@pytest.mark.parametrize("attempt", [_backwards, _twice])
def test_time_that_does_not_go_forwards_is_refused(attempt: Callable[[SlidingSmoother, Case], None]) -> None:
    case = _case("one sensor")
    smoother = _sliding(case, FullSmoothing())
    with pytest.raises(InputError, match="order of time"):
        attempt(smoother, case)
    assert len(smoother.window.epochs) == 1
