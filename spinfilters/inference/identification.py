"""Identification of noise by maximum marginal likelihood, from a smoothing problem.

Noise levels of sensors and densities of disturbances; score tests compare given levels with the data.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail, fisher_tail
from spinfilters.core.robust_losses import Gate, LeastSquares
from spinfilters.filters.noise_levels import PRIOR_INFORMATION, VarianceComponent
from spinfilters.filters.square_root import lower_roots
from spinfilters.inference.noise_model import (
    NoiseModel,
    Residuals,
    WhitenedRows,
    explained_observations,
    residuals_of,
    step_errors,
)
from spinfilters.smoother.batch_smoother import GATE
from spinfilters.smoother.landmark_factors import LinearObservations
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.motion_factors import SensorRows
from spinfilters.smoother.problem import LinearizationPoint, NormalEquations, Problem, Stage
from spinfilters.smoother.solver import GaussNewton, advanced


@dataclass(frozen=True)
class WorkingSolutions:
    """Of a problem about a point; what is not asked for is not solved.

    Attributes
    ----------
    sources : Sequence[WhitenedRows]
        The working variables.
    normal : NormalEquations
        The linear problem of the measurements themselves.
    """

    problem: Problem
    here: LinearizationPoint
    normal: NormalEquations
    sources: Sequence[WhitenedRows]

    @cached_property
    def variances_information(self) -> Float[np.ndarray, " c"]:
        """Information on each ln variance, the others known.

        By how much the cost of u falls in the linear problem is u' J P J' u.
        """
        lengths = np.array([source.dot(source) for source in self.sources])
        return (lengths - [each.predicted_reduction for each in self._solutions]) / 2

    @cached_property
    def information(self) -> Float[np.ndarray, "c c"]:
        """Fisher information of all ln variances.

        What two of them share is u_i'u_j - (J'u_i)' P (J'u_j), that of the one with what is left of the other.
        """
        F, ordering = np.diag(self.variances_information), self.problem.ordering
        for j, (other, solution) in enumerate(zip(self.sources, self._solutions, strict=True)):
            if not j:
                continue
            errors, seen = solution.system.errors, None
            along = step_errors(ordering, errors), errors[:, ordering.order]
            if self.here.linear is not None:
                seen = explained_observations(self.here, solution)
            for i, one in enumerate(self.sources[:j]):
                explained = self._gradients[i].dot(*along)
                if seen is not None and one.observations is not None:
                    explained += float(np.vdot(one.observations, seen))
                F[i, j] = F[j, i] = (one.dot(other) - explained) / 2
        return F

    @property
    def errors(self) -> Float[np.ndarray, "c k n"]:
        """P J'u: error of every epoch by each ln variance, up to its sign."""
        solutions = [each.solution for each in self._solutions]
        return np.array([each.errors for each in solutions if each is not None])

    @cached_property
    def _solutions(self) -> list[NormalEquations]:
        return [self._solution(*each) for each in zip(self.sources, self._gradients, strict=True)]

    @cached_property
    def _gradients(self) -> list["_Gradient"]:
        return [self._gradient(each) for each in self.sources]

    def _gradient(self, right: WhitenedRows) -> "_Gradient":
        motion, here = self.problem.motion, self.here
        sensors = np.zeros((self.problem.ordering.epochs, self.problem.layout.error_dim))
        for k, (sensor, u) in enumerate(zip(motion.sensors, right.sensors, strict=True)):
            if u.any():
                rows, columns = here.sensor_rows(motion, k).by_epoch, motion.sensor_columns(sensor)[:-1]
                sensors[:, columns] += rows.gradient(u[:, :, None], len(sensors))[:, :, 0]
        steps = np.einsum("kdc,kd->kc", here.dynamics.rows[:, :, :-1], right.steps)
        return _Gradient(steps, sensors)

    def _solution(self, right: WhitenedRows, gradient: "_Gradient") -> NormalEquations:
        """The linear problem with another right-hand side."""
        here = self.here
        left = here.marginal_prior
        if left is not None:
            left = replace(left, gradient=np.zeros_like(left.gradient))
        steps = here.dynamics.steps.copy()
        # per step J'y over the columns [moving k | moving k + 1 | constants], and y'y in the last entry
        steps[:, :-1, -1] = steps[:, -1, :-1] = gradient.steps
        steps[:, -1, -1] = np.einsum("kd,kd->k", right.steps, right.steps)
        other = replace(
            here,
            dynamics=replace(here.dynamics, steps=steps),
            sensors=replace(here.sensors, epochs=self._sensors(gradient)),
            linear=_observations(here.linear, right),
            marginal_prior=left,
        )
        return self.problem.normal(other, self.normal.stage)

    def _sensors(self, gradient: "_Gradient") -> Float[np.ndarray, "k n1 n1"]:
        """Information blocks of the epochs; that of the prior has no right-hand side."""
        epochs, n = self.here.sensors.epochs.copy(), gradient.sensors.shape[1]
        epochs[:, :, -1] = epochs[:, -1, :] = 0.0
        # without sensors there is the first epoch alone
        epochs[:, :n, -1] = epochs[:, -1, :n] = gradient.sensors[: len(epochs)]
        return epochs


class _Gradient(NamedTuple):
    """J'u by step, columns as in the steps' rows, and by epoch, components as in `VariableOrdering.order`; not of landmarks."""

    steps: Float[np.ndarray, "j w"]
    sensors: Float[np.ndarray, "k n"]

    def dot(self, steps: Float[np.ndarray, "j w"], epochs: Float[np.ndarray, "k n"]) -> float:
        """Product with errors of the same columns."""
        return float(np.vdot(self.steps, steps) + np.vdot(self.sensors, epochs))


def _observations(linear: LinearObservations | None, right: WhitenedRows) -> LinearObservations | None:
    if linear is None or right.observations is None:
        return linear
    seen = linear.rows.copy()
    seen[:, :, -1] = right.observations
    return replace(linear, rows=seen)


POSE_ONLY_GATE: Final[float] = 6.3
"""As `GATE` for measurements of up to six components, whose whitened length is greater."""
GATE_COMPONENTS: Final[int] = 3
"""Of the innovation that `GATE` is the length of."""
KNOWN: Final[float] = 1e6
"""Degrees of freedom of a level that is as good as known."""
STAGE: Final = Stage(Gate(GATE, GATE), pose_only_loss=Gate(POSE_ONLY_GATE, POSE_ONLY_GATE))
MOST_MASKED: Final[int] = 2
"""Measurements that are left out at most: gross errors that pass the gate because levels have risen for them."""
SUSPECTED: Final[float] = 0.05
"""Probability that any measurement is as far from where all others have it, below which one is identified without."""
ITERATIONS: Final[int] = 30
SETTLED: Final[float] = 0.05
"""Share of its standard deviation that a component still moves by when the iteration ends."""
NEARLY_SETTLED: Final[float] = 0.5
"""The same after the last iteration: a density that the data hardly bound may lie six decades below what was assumed."""
LONGEST_STEP: Final[float] = 3.0
"""Of ln variance, in one iteration."""
NEAR: Final[float] = 0.7
"""Of the logarithms of (r + slope) / S, below which all levels take their step together."""
LONGEST_NEAR: Final[float] = 1.0
"""Of ln variance, in one such iteration."""
GAINS: Final[tuple[float, float]] = (0.1, 4.0)
PRIOR_SLOPE: Final[float] = 2 * PRIOR_INFORMATION
"""Of twice the log prior by ln variance: flat in the standard deviation."""
SMALLEST_REDUNDANCY: Final[float] = 1e-3
SMALLEST_SHARE: Final[float] = 0.01
"""Of a level in what identifies it, below which it makes no difference."""
TINY: Final[float] = float(np.finfo(float).tiny)
NEGLIGIBLE: Final[float] = 1e-3
"""Of ln variance: a change that no estimate shows."""


@dataclass(frozen=True)
class Identified:
    """Noise identified from some epochs.

    Attributes
    ----------
    components : tuple[VarianceComponent, ...]
        Sensors' standard deviations, then densities.
    converged : bool
        Whether every component has settled, or nearly.
    log_variance : (c,) float array
        ln variances of the components, relative to those that the model states.
    covariance : (c, c) float array
        Covariance of these ln variances.
    sensitivity : (c, k, n) float array
        Error of every epoch by each ln variance, up to its sign.
    trajectory : (k, m) float array
        Likeliest states at these levels.
    """

    components: tuple[VarianceComponent, ...]
    iterations: int
    converged: bool
    log_variance: Float[np.ndarray, " c"]
    covariance: Float[np.ndarray, "c c"]
    sensitivity: Float[np.ndarray, "c k n"]
    trajectory: Float[np.ndarray, "k m"]

    @property
    def expected(self) -> Float[np.ndarray, " c"]:
        """ln variances to estimate with, see `VarianceComponent.expected`."""
        raised = [np.log(each.expected / each.value) for each in self.components]
        return self.log_variance + np.array(raised)

    def widened(self, factors: Float[np.ndarray, "k n n"]) -> Float[np.ndarray, "k n n"]:
        """Factors of epochs' covariances with what is not known of the levels (see the module)."""
        if not np.isfinite(factors).all():
            return factors
        spread = np.einsum("ckn,cd->knd", self.sensitivity, _symmetric_sqrt(self.covariance))
        return lower_roots(np.concatenate([factors, spread], axis=2))


def identify(
    model: NoiseModel,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
    first: Float[np.ndarray, " c"] | None = None,
) -> Identified | None:
    """Noise levels, from states near the most probable ones; None where the problem has no solution.

    Parameters
    ----------
    trajectory, points : (k, m) float array, (L, 3) float array
        About which the first linear problem is made, m in frame g.
    first : (c,) float array or None
        Ln variances to begin from; None for those of the median residuals.
    """
    theta = model.first(trajectory, points) if first is None else first
    best = _optimum(model, trajectory, points, theta)
    for _ in range(MOST_MASKED):
        suspect = None if best is None else _find_suspect(best.residuals)
        if best is None or suspect is None:
            break
        model, measurement = model.without(*suspect)
        rest = _optimum(model, best.here.trajectory, best.here.points, best.found.log_variance)
        if rest is None or not rest.found.converged or not rest.refuses(measurement, suspect[0]):
            break
        best = rest
    return None if best is None else best.found


@dataclass(frozen=True)
class _Optimum:
    """Levels with the solved linear problem that they come from."""

    found: Identified
    problem: Problem
    here: LinearizationPoint
    normal: NormalEquations
    residuals: Residuals

    def refuses(self, measurement: SensorRows, sensor: int) -> bool:
        """Whether a further measurement is beyond the gate at these levels.

        The residuals of the others estimate these by as many degrees of freedom as they have redundancy (Fisher's distribution).
        """
        own = replace(measurement, scale=self.problem.motion.sensors[sensor].scale)
        rows = self.problem.motion.sensor_rows(own, self.here.trajectory, LeastSquares()).rows
        J, y, (epoch,), columns = rows[0, :, :-1], rows[0, :, -1], own.epoch, own.model.columns
        marginals = Marginals(self.normal.system, self.normal.eliminated)
        rest = y - J @ marginals.solution.errors[epoch][columns]
        spread = J @ marginals.factors[epoch][columns]
        square = float(rest @ np.linalg.solve(np.eye(len(y)) + spread @ spread.T, rest))
        of_sensors = [not each.is_density for each in self.found.components]
        told = float(np.clip(self.residuals.redundancy[of_sensors].min(initial=KNOWN), 1.0, KNOWN))
        beyond = fisher_tail(square / len(y), len(y), told)
        return bool(beyond < chi_square_tail(GATE**2, GATE_COMPONENTS))


def _optimum(
    model: NoiseModel,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
    theta: Float[np.ndarray, " c"],
) -> _Optimum | None:
    """The likeliest levels of a model; None where the problem has no solution."""
    rule, lowest = GaussNewton(), model.lowest
    theta = np.maximum(theta, lowest)
    for iteration in range(1, ITERATIONS + 1):
        problem = model.scaled(theta)
        here = problem.at(trajectory, points, STAGE.pose_only_loss)
        normal = problem.normal(here, STAGE)
        if not normal.solved:
            return None
        residuals = residuals_of(problem, here, normal, model.components, model.densities)
        working = WorkingSolutions(problem, here, normal, residuals.sources)
        by, deviations = _step(working, residuals)
        by = np.maximum(theta + by, lowest) - theta
        away = float(np.max((np.abs(by) - NEGLIGIBLE) / deviations))
        if away <= SETTLED or iteration == ITERATIONS:
            covariance = _covariance(working.information)
            share = _shares(working, residuals)
            components = _components(model, theta, covariance, share)
            found = Identified(
                components, iteration, away <= NEARLY_SETTLED, theta, covariance, working.errors, trajectory
            )
            return _Optimum(found, problem, here, normal, residuals)
        there = advanced(problem, here, normal, rule, rule.first).point
        if there is None:
            return None
        theta, trajectory, points = theta + by, there.trajectory, there.points
    return None


def _find_suspect(residuals: Residuals) -> tuple[int, int] | None:
    """Sensor and row of the measurement farthest from all others; None where chance explains its distance."""
    least = [each.least_probability for each in residuals.sensors]
    if not least or min(least) * sum(len(each.rest) for each in residuals.sensors) >= SUSPECTED:
        return None
    sensor = int(np.argmin(least))
    return sensor, residuals.sensors[sensor].farthest


def _covariance(information: Float[np.ndarray, "c c"]) -> Float[np.ndarray, "c c"]:
    """Of ln variances, prior included. Average information need not be positive where residuals contradict the levels."""
    values, vectors = np.linalg.eigh(information)
    return vectors / (np.maximum(values, 0.0) + PRIOR_INFORMATION) @ vectors.T


def _shares(working: WorkingSolutions, residuals: Residuals) -> Float[np.ndarray, " c"]:
    """Shares of every component in the variance of its evidence.

    2F / r, as u'u = r and the states take their part of u.
    """
    share = 2 * working.variances_information / np.maximum(residuals.squares, TINY)
    return np.clip(share, SMALLEST_SHARE, 1.0)


def _components(
    model: NoiseModel,
    theta: Float[np.ndarray, " c"],
    covariance: Float[np.ndarray, "c c"],
    share: Float[np.ndarray, " c"],
) -> tuple[VarianceComponent, ...]:
    """Levels at ln variances of this covariance."""
    log_std = np.sqrt(np.diag(covariance))
    return tuple(map(VarianceComponent, model.names, model.values(theta), log_std.tolist(), share.tolist()))


def _step(
    working: WorkingSolutions, residuals: Residuals
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Step of ln variances, and their standard deviations.

    Near the optimum all at once, for one level takes what another leaves.
    """
    ratio = (residuals.squares + PRIOR_SLOPE) / np.maximum(residuals.redundancy, SMALLEST_REDUNDANCY)
    logarithms = np.log(np.maximum(ratio, TINY))
    if np.all(np.abs(logarithms) < NEAR):
        covariance = _covariance(working.information)
        by = covariance @ (residuals.squares / 2 * logarithms)
        return np.clip(by, -LONGEST_NEAR, LONGEST_NEAR), np.sqrt(np.diag(covariance))
    # A level far below what the data see has no information of theirs: the prior's bounds how far it may still be from settled.
    information = working.variances_information + PRIOR_INFORMATION
    gain = np.clip((residuals.squares + PRIOR_SLOPE) / (2 * information), *GAINS)
    return np.clip(gain * logarithms, -LONGEST_STEP, LONGEST_STEP), 1 / np.sqrt(information)


def _symmetric_sqrt(covariance: Float[np.ndarray, "c c"]) -> Float[np.ndarray, "c c"]:
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


STEPS: Final = 2
"""From the states given towards the most probable ones, before the test."""
LEAST_INFORMATION: Final = 0.25
"""Of a ln variance, below which nothing is tested: its standard deviation is 2."""
LEAST_SHARE: Final = 1e-9
"""Of a sum of squares to its expectation."""


@dataclass(frozen=True)
class LevelTest:
    """A noise level compared with the data.

    Attributes
    ----------
    score : float
        Standard deviations by which the data ask for more noise, as of a normal number; zero where they contain no information.
    """

    name: str
    score: float


def level_tests(
    model: NoiseModel, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> tuple[LevelTest, ...]:
    """Score test of every noise level near the most probable states; empty where the problem has no solution."""
    problem, rule = model.problem, GaussNewton()
    here = problem.at(trajectory, points, STAGE.pose_only_loss)
    normal = problem.normal(here, STAGE)
    for _ in range(STEPS):
        if not normal.solved:
            return ()
        there = advanced(problem, here, normal, rule, rule.first).point
        if there is None:
            return ()
        here, normal = there, problem.normal(there, STAGE)
    if not normal.solved:
        return ()
    found = residuals_of(problem, here, normal, model.components, model.densities)
    F = WorkingSolutions(problem, here, normal, found.sources).information
    return tuple(map(LevelTest, model.names, _scores(found.squares, found.redundancy, F).tolist()))


def _scores(
    squares: Float[np.ndarray, " c"],
    redundancy: Float[np.ndarray, " c"],
    information: Float[np.ndarray, "c c"],
) -> Float[np.ndarray, " c"]:
    scores = np.zeros(len(squares))
    seen = np.maximum(squares, LEAST_SHARE * np.maximum(redundancy, LEAST_SHARE))
    expected = np.sqrt(np.maximum(redundancy, 0.0) / seen)
    F = information * expected * expected[:, None]
    told = np.flatnonzero(np.diag(F) > LEAST_INFORMATION)
    if not len(told):
        return scores
    F, gradient = F[np.ix_(told, told)], (squares - redundancy)[told] / 2
    covariance = np.linalg.pinv(F, hermitian=True)
    deviation = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    dof = np.maximum(redundancy[told] ** 2 / (2 * np.diag(F)), 0.1)
    scores[told] = _normal(covariance @ gradient / deviation, dof)
    return scores


def _normal(z: Float[np.ndarray, " c"], dof: Float[np.ndarray, " c"]) -> Float[np.ndarray, " c"]:
    """Normal numbers as improbable as chi-square ones that lie z standard deviations above their mean."""
    ratio = np.maximum(1 + z * np.sqrt(2 / dof), 0.0)
    spread = 2 / (9 * dof)
    return (np.cbrt(ratio) - (1 - spread)) / np.sqrt(spread)
