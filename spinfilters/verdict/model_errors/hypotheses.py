"""Linear problems about one motion under two explanations of a misfit, and the marginal likelihood of each."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaln

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.robust_losses import LeastSquares, RobustLoss, Squares
from spinfilters.inference.identification import STAGE, identify
from spinfilters.inference.noise_model import NoiseModel, residuals_of, source_factors
from spinfilters.smoother.problem import (
    LinearizationPoint,
    NormalEquations,
    Problem,
    Stage,
    with_last_constants,
)
from spinfilters.smoother.solver import SolverOptions, solve
from spinfilters.verdict.model_errors.linear_rows import LinearRows
from spinfilters.verdict.model_errors.noise_components import TELLING, NoiseComponents

ITERATIONS: Final = 6
NOISE_RATIO: Final = 1.25
"""Of squared residuals over their expectation, either way, beyond which noise levels are identified anew before the tests."""
CHANCE: Final = 1e-6
"""Probability of larger residuals below which the noise level of a component is contradicted."""
UNSETTLED: Final = 0.1
"""Share of a cost that the linear problem promises to take off, from which the states are not the most probable ones."""
IN_A_ROW: Final = 2
"""Epochs without any measurement that counts, beyond which gross errors are none."""
EVERY_MEASUREMENT: Final = Stage(LeastSquares(), pose_only_loss=LeastSquares())
FEWEST_COUNTED: Final = 0.9
"""Share of measurements that count, below which noise is identified anew."""


@dataclass(frozen=True)
class _OneStage:
    """The same strictness in every iteration."""

    only: Stage

    def stage(self, iteration: int, here: LinearizationPoint, before: NormalEquations | None) -> Stage:
        """The only stage."""
        return self.only

    def last(self, iteration: int, stage: Stage) -> bool:
        """True: one iteration."""
        return True

    def repaired(self, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
        """The linearization point as it is."""
        return here


@dataclass(frozen=True)
class _Chosen(RobustLoss):
    """Squares of chosen observations, whatever their size."""

    weights: Float[np.ndarray, " N"]

    def cost(self, square: Squares) -> Squares:
        """Squares of the chosen observations, zero of the others."""
        return np.where(self.weights > 0, square, 0.0)

    def weight(self, square: Squares) -> Squares:
        """Weights of the chosen finite observations."""
        return np.where(np.isfinite(square), self.weights, 0.0)


def solved_near(
    problem: Problem,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
    stage: Stage = STAGE,
) -> LinearRows | None:
    """The linear problem at the most probable states near a trajectory; None where it has no solution."""
    common = with_last_constants(problem.layout, trajectory)
    here = problem.at(common, points, stage.pose_only_loss)
    found = solve(problem, here, SolverOptions(ITERATIONS), _OneStage(stage))
    return LinearRows(problem, found.point, found.normal) if found.normal.solved else None


LONGER: Final = 5.0
"""Factor by which correlated errors may last longer than a recording of some ten of their correlation times shows."""


@dataclass(frozen=True)
class KnownLevels:
    """Noise levels known before the tests, with their uncertainty.

    Attributes
    ----------
    stated : Collection[str]
        Names of levels that are not identified.
    correlation : Mapping[str, float]
        Samples that count as one, by the name of the level of an error that represents a correlated one.
    inflation : Mapping[str, float]
        Of stated variances for errors that rows have in common, by the level's name; 1 where none is stated.
    """

    stated: Collection[str] = frozenset()
    correlation: Mapping[str, float] = field(default_factory=dict)
    inflation: Mapping[str, float] = field(default_factory=dict)

    @property
    def counts_common_errors(self) -> bool:
        """Whether rows are stated to have errors in common."""
        return max(self.inflation.values(), default=1.0) > 1.0

    @property
    def score_inflation(self) -> float | None:
        """Factor by which errors that are known to be correlated may enlarge a score.

        Infinite where rows have errors in common, for those of an epoch are many; None where there are none.
        """
        if self.counts_common_errors:
            return np.inf
        return LONGER if self.correlation else None


NOTHING_KNOWN: Final = KnownLevels()


def noise_of(model: NoiseModel, solved: LinearRows, told: KnownLevels = NOTHING_KNOWN) -> NoiseComponents:
    """Variance components of a solved problem."""
    problem, here = solved.problem, solved.here
    after = residuals_of(problem, here, solved.normal, model.components, model.densities, solved.steps_after)
    factors = tuple(source_factors(problem, here, model.densities))
    known = np.array([name in told.stated for name in model.names])
    correlation = np.array([told.correlation.get(name, 1.0) for name in model.names])
    dof = np.maximum(after.redundancy, 0.0)
    for k, each in enumerate(model.components):
        if correlation[k] > 1:
            values = sum(len(solved.sensor_rows[s]) * len(rows) for s, rows in each.sensors.items())
            dof[k] = max(values / correlation[k] - (values - dof[k]), 0.0)
    larger = np.array([told.inflation.get(name, 1.0) for name in model.names])
    return NoiseComponents(model.components, factors, after.redundancy, known, correlation, dof, larger)


def is_doubtful(noise: NoiseComponents, solved: LinearRows) -> bool:
    """Whether residuals of some component contradict its noise level; small ones are expected where it is inflated."""
    ratio = noise.squares(solved.left) / np.maximum(noise.redundancy, 1.0)
    away = (ratio > NOISE_RATIO) | (ratio * noise.inflation < 1 / NOISE_RATIO)
    return bool(np.any(away & (noise.redundancy > TELLING))) or rejects(solved)


def is_contradicted(noise: NoiseComponents, solved: LinearRows) -> bool:
    """Whether residuals of some component are beyond chance at its noise level."""
    squares = noise.squares(solved.left)
    told = noise.redundancy > TELLING
    return bool(np.any(chi_square_tail(squares[told], noise.redundancy[told]) < CHANCE)) or rejects(solved)


def is_settled(solved: LinearRows) -> bool:
    """Whether the states are nearly the most probable ones, so that the linear problem gives the cost of residuals."""
    cost = solved.here.cost(solved.normal.used, solved.normal.stage)
    return solved.normal.predicted_reduction < max(UNSETTLED * cost, 1.0)


def rejects(solved: LinearRows) -> bool:
    """Whether gates reject more than gross errors explain."""
    counted = [*solved.counted]
    if solved.normal.eliminated is not None:
        counted.append(solved.normal.eliminated.used)
    return any(each.mean() < FEWEST_COUNTED for each in counted if each.size)


def rejects_in_a_row(solved: LinearRows) -> bool:
    """Whether gates reject whole successive epochs, which gross errors of single measurements do not explain."""
    measured, counted = measured_epochs(solved)
    empty = (measured & ~counted)[measured]
    return bool(np.any(np.convolve(empty, np.ones(IN_A_ROW), "valid") == IN_A_ROW))


def measured_epochs(solved: LinearRows) -> tuple[Bool[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
    """Epochs with measurements, and those in which any pose-only one or most landmark observations count."""
    epochs, fit = solved.problem.ordering.epochs, solved.normal.eliminated
    measured, counted = np.zeros((2, epochs), dtype=bool)
    for sensor, good in zip(solved.problem.motion.sensors, solved.counted, strict=True):
        measured[sensor.epoch] = True
        counted[sensor.epoch[good]] = True
    if fit is not None:
        every, used = (
            np.bincount(fit.observations.epoch[k], minlength=epochs) for k in (slice(None), fit.used)
        )
        measured, counted = measured | (every > 0), counted | (used > every / 2)
    return measured, counted


def with_refused_in_a_row(solved: LinearRows) -> LinearRows | None:
    """The problem with all refused epochs included where several in a row were refused, else unchanged."""
    if not rejects_in_a_row(solved):
        return solved
    fit, stage = solved.normal.eliminated, EVERY_MEASUREMENT
    if fit is not None:
        measured, counted = measured_epochs(solved)
        taken = fit.used | (measured & ~counted)[fit.observations.epoch]
        stage = replace(stage, loss=_Chosen(taken.astype(float)))
    return solved_near(solved.problem, solved.here.trajectory, solved.here.points, stage)


def with_identified(model: NoiseModel, solved: LinearRows, gated: bool = True) -> LinearRows | None:
    """The problem with the noise levels that it identifies itself, solved again.

    None where it identifies none, or such that gates reject what they accept at the levels stated: a level that falls below what
    the linearisation describes takes its measurements out, and then explains nothing. Unless ``gated`` the same measurements count.
    """
    here = solved.here
    found = identify(model, here.trajectory, here.points)
    if found is None:
        return None
    stated = model.values(model.stated)
    power = [2.0] * len(model.components) + [1.0] * len(model.densities)
    values = [each.value for each in found.components]
    log_variance = np.array(power) * np.log(np.divide(values, stated))
    if not gated:
        return among_inliers(model.scaled(log_variance), solved)
    again = solved_near(model.scaled(log_variance), here.trajectory, here.points)
    if again is None or (rejects(again) and not rejects(solved)):
        return None
    return with_refused_in_a_row(again)


def among_inliers(
    problem: Problem, inliers: LinearRows, beside: Int[np.ndarray, " e"] | None = None
) -> LinearRows | None:
    """A problem with other noise levels, solved with exactly the measurements that count in ``inliers``.

    These may be of some of its measurements alone, as this makes them. And with all measurements without landmarks of the epochs
    ``beside`` these.
    """
    sensors = []
    every = zip(problem.motion.sensors, inliers.problem.motion.sensors, inliers.counted, strict=True)
    for sensor, some, own in every:
        counted = sensor.counted_among(some, own)
        good = counted if beside is None else counted | np.isin(sensor.epoch, beside)
        sensors.append(sensor.chosen(good))
    motion = replace(problem.motion, sensors=tuple(sensors), loss=LeastSquares())
    fit = inliers.normal.eliminated
    loss = LeastSquares() if fit is None else _Chosen(fit.used.astype(float))
    own = replace(problem, motion=motion)
    return solved_near(own, inliers.here.trajectory, inliers.here.points, Stage(loss))


GROSS: Final = 30.0
"""Width of gross errors over the standard deviation of the noise."""
RARE: Final = 0.02
"""Share of measurements that are gross errors, before the data are used."""


def minus_twice_log_likelihood(rows: LinearRows) -> float:
    """-2 ln likelihood of the measurements, states and landmarks integrated out (Laplace).

    Up to a constant of the measurements' number. Measurements that are refused count as gross errors.
    """
    total = float(rows.left.gram(rows.left)[0, 0]) + _of_sensors(rows) + _of_observations(rows)
    fit, s = rows.normal.eliminated, rows.solution
    d = len(rows.problem.ordering.moving)
    total -= 2 * float(np.linalg.slogdet(rows.here.dynamics.rows[:, :, d : 2 * d])[1].sum())
    total += 2 * float(np.log(np.diag(s.information_sqrt)).sum())
    total += 2 * float(np.log(np.einsum("kii->ki", s.tridiagonal.information_sqrts)).sum())
    if fit is not None:
        told = np.einsum("kii->ki", fit.information_sqrt[fit.is_constrained])
        total += 2 * float(np.log(told).sum())
    return total


def _of_sensors(rows: LinearRows) -> float:
    """ln determinant of the noise covariances, and what refused measurements add."""
    total = 0.0
    for sensor, counts in zip(rows.problem.motion.sensors, rows.counted, strict=True):
        if not len(sensor.epoch):
            continue
        x, scale = rows.here.trajectory[sensor.epoch], 1.0 if sensor.scale is None else sensor.scale
        innovation, valid = sensor.model.innovations(x, sensor.parameters, sensor.values)
        whitening = sensor.model.whitening(x, sensor.parameters) / np.expand_dims(scale, -1)
        total += _stated_cost(innovation[valid] / scale, whitening[valid], counts[valid])
    return total


def _of_observations(rows: LinearRows) -> float:
    """The same of observations of landmarks that are well-constrained."""
    fit, observations, total = rows.normal.eliminated, rows.problem.observations, 0.0
    if fit is None or observations is None:
        return total
    for group in observations.groups:
        told = fit.is_constrained[observations.landmark[group.rows]]
        at, scale = group.rows[told], observations.scale
        points, x = rows.here.points[observations.landmark[at]], rows.here.trajectory[observations.epoch[at]]
        parameters = np.concatenate([points, group.parameters[told]], axis=1)
        innovation, valid = group.model.innovations(x, parameters, group.values[told])
        whitening = group.model.whitening(x, parameters) / scale
        total += _stated_cost(innovation[valid] / scale, whitening[valid], fit.used[at][valid])
    return total


def _stated_cost(
    innovation: Float[np.ndarray, "k i"],
    whitening: Float[np.ndarray, "k i i"],
    counts: Bool[np.ndarray, " k"],
) -> float:
    squares = np.sum(innovation[~counts] ** 2, axis=1)
    refused = gross_error_cost(squares, innovation.shape[1]).sum()
    roots = np.einsum("kii->ki", whitening)  # the diagonal of a lower triangle
    return float(refused - 2 * np.log(roots).sum())


def gross_error_cost(squares: Float[np.ndarray, " k"], size: int) -> Float[np.ndarray, " k"]:
    """-2 ln density of gross errors over that of white noise at its centre.

    Cauchy's, far wider than the noise, times how rare they are: noise that is too small does not gain by what is refused for it.

    Parameters
    ----------
    squares : (k,) float array
        Squared lengths of whitened innovations of ``size`` components.
    """
    shape = (size + 1) / 2
    constant = size * np.log(GROSS**2 / 2) + 2 * (gammaln(0.5) - gammaln(shape)) - 2 * np.log(RARE)
    return constant + 2 * shape * np.log1p(squares / GROSS**2)
