"""The smoother's steps and covariances are those of a dense least-squares problem whose rows are finite differences."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.robust_losses import LeastSquares, PseudoHuber, RobustLoss
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.timeline import Epoch
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.smoother.linear_system import Marginals, SchurSystem, latest_factor
from spinfilters.smoother.mass_posterior import log_determinant
from spinfilters.smoother.problem import InitialGuess, NormalEquations, Problem, Stage
from tests.smoother.smoothing_samples import LAYOUT, PROCESS, SMALL, Sample, perturbed, sample

STEP = 1e-6
MOVING, CONSTANT = 12, 8
LOSSES = (LeastSquares(), PseudoHuber(1.5))
TOLERANCE = 5e-5
"""Of correlations; what finite differences of that step give."""


@cache
def _sample() -> Sample:
    """Five epochs, with a measured pose in one of them."""
    here = sample(SMALL)
    off = LAYOUT.retract(here.truth[2], 0.01 * np.sin(np.arange(20.0)))
    pose = Measurement(Pose(LAYOUT), off[None, :7].copy(), pose_parameters(1e-4 * np.eye(6)[None]))
    epochs = list(here.epochs)
    epochs[2] = Epoch(epochs[2].time, (*epochs[2].measurements, pose))
    return replace(here, epochs=tuple(epochs))


@cache
def _trial() -> InitialGuess:
    """Off the truth in all that may be; the first pose defines g."""
    return perturbed(_sample(), 7, scale=0.3)


@dataclass(frozen=True)
class Dense:
    """Rows J e = y over moving errors by epoch, constants, and told landmarks."""

    J: Float[np.ndarray, "r n"]
    y: Float[np.ndarray, " r"]
    is_constrained: np.ndarray

    @property
    def covariance(self) -> Float[np.ndarray, "n n"]:
        return np.linalg.inv(self.J.T @ self.J)

    @property
    def step(self) -> Float[np.ndarray, " n"]:
        return np.linalg.lstsq(self.J, self.y)[0]

    def epoch(self, k: int) -> np.ndarray:
        """Where an epoch's state stands."""
        first = MOVING * len(_sample().epochs)
        return np.r_[MOVING * k : MOVING * (k + 1), first : first + CONSTANT]


@cache
def _linear(loss: RobustLoss) -> tuple[Problem, NormalEquations]:
    problem = _sample().problem
    here = problem.at(_trial().trajectory, _trial().points)
    return problem, problem.normal(here, Stage(loss))


def _solution(loss: RobustLoss) -> SchurSystem:
    solution = _linear(loss)[1].solution
    assert isinstance(solution, SchurSystem)
    return solution


@cache
def _dense(loss: RobustLoss) -> Dense:
    eliminated = _linear(loss)[1].eliminated
    assert eliminated is not None
    size = MOVING * len(_sample().epochs) + CONSTANT + 3 * int(eliminated.is_constrained.sum())
    weights = _weights(loss, eliminated.is_constrained)
    columns = [
        _residual(STEP * e, eliminated.is_constrained) - _residual(-STEP * e, eliminated.is_constrained)
        for e in np.eye(size)
    ]
    J = weights[:, None] * np.stack(columns, axis=1) / (2 * STEP)
    return Dense(
        J, -weights * _residual(np.zeros(size), eliminated.is_constrained), eliminated.is_constrained
    )


def _parts(step: np.ndarray, is_constrained: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Whitened residuals of the motion, and of the observations of told landmarks, after a step."""
    here, trial, count = _sample(), _trial(), len(_sample().epochs)
    moving, constant = step[: MOVING * count].reshape(count, MOVING), step[MOVING * count :][:CONSTANT]
    errors = np.concatenate([moving, np.tile(constant, (count, 1))], axis=1)
    points = trial.points.copy()
    points[is_constrained] += step[MOVING * count + CONSTANT :].reshape(-1, 3)
    x = LAYOUT.retract(trial.trajectory, errors)
    motion, seen = [LAYOUT.local(here.prior.mean, x[0]) / here.prior.std], []
    for k, epoch in enumerate(here.epochs):
        for m in epoch.measurements:
            if m.ids is None:
                motion.append(-m.model.linearise(x[k], m.parameters, m.values).innovation.reshape(-1))
            else:
                seen.append(_observation(m, x[k], points, is_constrained))
    for k in range(count - 1):
        defect = LAYOUT.local(trial.trajectory[k + 1], PROCESS.step(x[k], 0.5))[:MOVING] - moving[k + 1]
        motion.append(np.linalg.solve(_noise_root(k), defect))
    return motion, seen


def _observation(m: Measurement, x: np.ndarray, points: np.ndarray, is_constrained: np.ndarray) -> np.ndarray:
    assert m.ids is not None
    keep = is_constrained[m.ids]
    parameters = m.parameters[keep].copy()
    parameters[:, :3] = points[m.ids[keep]]
    return m.model.predict(x, parameters) - m.values[keep]


@cache
def _noise_root(k: int) -> np.ndarray:
    """Of the error about the trial's next point that a step's noise gives."""
    here, there = _trial().trajectory[k : k + 2]
    moved, _, noise = PROCESS.linearise(here, 0.5)
    spread = 1e-4 * noise.T
    by_noise = LAYOUT.local(there, LAYOUT.retract(moved, spread)) - LAYOUT.local(
        there, LAYOUT.retract(moved, -spread)
    )
    factor = by_noise[:, :MOVING].T / 2e-4
    return np.linalg.cholesky(factor @ factor.T)


def _residual(step: np.ndarray, is_constrained: np.ndarray) -> np.ndarray:
    motion, seen = _parts(step, is_constrained)
    return np.concatenate([*motion, *(part.reshape(-1) for part in seen)])


def _weights(loss: RobustLoss, is_constrained: np.ndarray) -> np.ndarray:
    """Square roots of the weights of the rows at the trial; those of the motion count in full."""
    count = len(_sample().epochs)
    motion, seen = _parts(np.zeros(MOVING * count + CONSTANT + 3 * int(is_constrained.sum())), is_constrained)
    square = np.concatenate([np.square(part).sum(axis=1) for part in seen])
    return np.concatenate([np.ones(sum(map(len, motion))), np.repeat(np.sqrt(loss.weight(square)), 3)])


def _scaled(P: np.ndarray, reference: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.diag(reference))
    return P / std / std[:, None]


def _apart(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of two covariances in the expected deviations."""
    return float(np.abs(_scaled(found, expected) - _scaled(expected, expected)).max())


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_a_step_is_that_of_the_dense_problem(loss: RobustLoss) -> None:
    dense, solution = _dense(loss), _solution(loss)
    std = np.sqrt(np.diag(dense.covariance))
    for k, error in enumerate(solution.errors):
        at = dense.epoch(k)
        np.testing.assert_allclose(error / std[at], dense.step[at] / std[at], atol=1e-3)


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_landmarks_step_as_in_the_dense_problem(loss: RobustLoss) -> None:
    dense, eliminated = _dense(loss), _linear(loss)[1].eliminated
    assert eliminated is not None
    expected = dense.step[-3 * int(dense.is_constrained.sum()) :].reshape(-1, 3)
    found = eliminated.points_step(_solution(loss).poses)
    std = np.sqrt(np.diag(dense.covariance))[-3 * int(dense.is_constrained.sum()) :].reshape(-1, 3)
    np.testing.assert_allclose(found[dense.is_constrained] / std, expected / std, atol=1e-3)
    assert not found[~dense.is_constrained].any()


def test_the_cost_is_that_of_the_dense_problem() -> None:
    problem, normal = _linear(LeastSquares())
    here = problem.at(_trial().trajectory, _trial().points)
    y = _dense(LeastSquares()).y
    assert here.cost(normal.used, normal.stage) == pytest.approx(y @ y, rel=1e-6)


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_the_promised_fall_of_the_cost_is_that_of_the_dense_problem(loss: RobustLoss) -> None:
    dense = _dense(loss)
    rest = dense.y - dense.J @ dense.step
    fall = dense.y @ dense.y - rest @ rest
    assert _linear(loss)[1].predicted_reduction == pytest.approx(fall, rel=1e-5)


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_the_covariance_of_every_epoch_is_that_of_the_dense_problem(loss: RobustLoss) -> None:
    dense = _dense(loss)
    for k, factor in enumerate(Marginals(_solution(loss), None).factors):
        assert _apart(factor @ factor.T, dense.covariance[np.ix_(dense.epoch(k), dense.epoch(k))]) < TOLERANCE
        assert not np.triu(factor, 1).any()


def test_the_covariance_of_landmarks_is_that_of_the_dense_problem() -> None:
    dense, (_, normal) = _dense(LeastSquares()), _linear(LeastSquares())
    is_constrained = np.flatnonzero(dense.is_constrained)
    first = MOVING * len(_sample().epochs) + CONSTANT
    marginals = Marginals(_solution(LeastSquares()), normal.eliminated)
    by_epochs, own = marginals.landmark_rows(is_constrained[[6, 2, 9]])
    found = by_epochs @ by_epochs.swapaxes(1, 2) + own @ own.swapaxes(1, 2)
    for covariance, k in zip(found, (6, 2, 9), strict=True):
        at = first + 3 * k + np.arange(3)
        assert _apart(covariance, dense.covariance[np.ix_(at, at)]) < TOLERANCE


def test_epochs_and_landmarks_are_correlated_as_in_the_dense_problem() -> None:
    dense, (_, normal) = _dense(LeastSquares()), _linear(LeastSquares())
    marginals = Marginals(_solution(LeastSquares()), normal.eliminated)
    is_constrained, r = np.flatnonzero(dense.is_constrained), _solution(LeastSquares()).ordering.separator_dim
    found = marginals.epoch_rows(3)[:, :r] @ marginals.landmark_rows(is_constrained[[4]])[0][0].T
    at = MOVING * len(_sample().epochs) + CONSTANT + 12 + np.arange(3)
    std = np.sqrt(np.diag(dense.covariance))
    expected = dense.covariance[np.ix_(dense.epoch(3), at)]
    scale = np.outer(std[dense.epoch(3)], std[at])
    np.testing.assert_allclose(found / scale, expected / scale, atol=TOLERANCE)


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_the_factor_of_the_newest_epoch_alone_is_the_same(loss: RobustLoss) -> None:
    factor = latest_factor(_solution(loss))
    every = Marginals(_solution(loss), None).factors[-1]
    assert _apart(factor @ factor.T, every @ every.T) < TOLERANCE
    assert not np.triu(factor, 1).any()


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_the_log_determinant_is_that_of_the_dense_information(loss: RobustLoss) -> None:
    J = _dense(loss).J
    assert log_determinant(_linear(loss)[1]) == pytest.approx(np.linalg.slogdet(J.T @ J)[1], abs=1e-3)
