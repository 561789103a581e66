"""Smoothing problem with unknown noise levels: its variance components, and the same problem at other levels.

Squared whitened residuals of each variance component, and what is expected of them: its redundancy.

At the most probable states of the linearised problem min |J e - y|^2 with covariance P = (J'J)^-1, a component that scales the
variance of some rows by exp(theta) has the score

    d ln p / d theta = (r - S) / 2,    r = sum of squares of (y - J e),    S = sum of diag(I - J P J')  over those rows

(Patterson and Thompson 1971). The process noise of a step has two sources, Q = G_f G_f' + G_t G_t'. With W = L^-1 G, L L' = Q,
theirs are r = |W'(y - J e)|^2 and S = tr W'(I - J P J') W.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_median, chi_square_tail
from spinfilters.filters.noise_levels import ComponentRows
from spinfilters.io.disturbances import DENSITIES, noise_columns
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.smoother.landmark_factors import linearise_observations
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.motion_factors import NOISE_FLOOR, SensorRows, prior_rows
from spinfilters.smoother.priors import VariableOrdering
from spinfilters.smoother.problem import LinearizationPoint, NormalEquations, Problem


@dataclass(frozen=True)
class NoiseModel:
    """A problem whose noise levels are unknown.

    Attributes
    ----------
    problem : Problem
        Smoothing problem at its stated levels.
    components, densities : tuple[ComponentRows, ...], tuple[str, ...]
        Those to be identified.
    """

    problem: Problem
    components: tuple[ComponentRows, ...]
    densities: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all levels: the order of their ln variances."""
        return (*(each.name for each in self.components), *self.densities)

    @property
    def stated(self) -> Float[np.ndarray, " c"]:
        """Ln variances of the levels as the problem states them: zeros."""
        return np.zeros(len(self.names))

    def scaled(self, log_variance: Float[np.ndarray, " c"]) -> Problem:
        """The problem with variances of exp(log_variance) times those stated."""
        motion, observations = self.problem.motion, self.problem.observations
        scales: list[Float[np.ndarray, " i"] | None] = [each.scale for each in motion.sensors]
        for each, scale in zip(self.components, np.exp(0.5 * log_variance).tolist(), strict=False):
            for k, rows in each.sensors.items():
                stated = scales[k]
                changed = np.ones(motion.sensors[k].model.dim) if stated is None else stated.copy()
                changed[list(rows)] *= scale
                scales[k] = changed
            if each.landmarks and observations is not None:
                observations = replace(observations, scale=observations.scale * scale)
        sensors = tuple(replace(s, scale=scale) for s, scale in zip(motion.sensors, scales, strict=True))
        motion = replace(motion, sensors=sensors, process=self._process(log_variance))
        return replace(self.problem, motion=motion, observations=observations)

    def without(self, sensor: int, row: int) -> "tuple[NoiseModel, SensorRows]":
        """The model without one measurement of a sensor, and the measurement."""
        sensors = list(self.problem.motion.sensors)
        every = np.arange(len(sensors[sensor].epoch))
        alone = sensors[sensor].chosen(every == row)
        sensors[sensor] = sensors[sensor].chosen(every != row)
        motion = replace(self.problem.motion, sensors=tuple(sensors))
        return replace(self, problem=replace(self.problem, motion=motion)), alone

    def at(self, log_variance: Float[np.ndarray, " c"]) -> "NoiseModel":
        """The model whose problem is stated with these levels."""
        values = self.values(log_variance)
        components = tuple(
            replace(each, value=value) for each, value in zip(self.components, values, strict=False)
        )
        return NoiseModel(self.scaled(log_variance), components, self.densities)

    def first(
        self, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
    ) -> Float[np.ndarray, " c"]:
        """Initial ln variances, from the median residual of every sensor component; zero (as stated) for disturbances."""
        found, motion, observations = self.stated, self.problem.motion, self.problem.observations
        linear = None if observations is None else linearise_observations(observations, trajectory, points)
        made = [motion.sensor_rows(sensor, trajectory).rows for sensor in motion.sensors]
        for k, each in enumerate(self.components):
            squares = [made[s][:, list(rows), -1] for s, rows in each.sensors.items()]
            ratio = [np.nanmedian(part**2) / chi_square_median(1) for part in squares if part.size]
            if each.landmarks and linear is not None and observations is not None:
                dim = max(group.model.dim for group in observations.groups)
                ratio.append(float(np.median(linear.square)) / chi_square_median(dim))
            good = [value for value in ratio if np.isfinite(value) and value > 0]
            found[k] = np.log(max(good)) if good else 0.0
        return found

    @property
    def lowest(self) -> Float[np.ndarray, " c"]:
        """Least ln variances, of the components' smallest levels; densities have none."""
        bounds = [2 * np.log(c.smallest / c.value) if c.smallest > 0 else -np.inf for c in self.components]
        return np.array([*bounds, *(-np.inf for _ in self.densities)])

    def values(self, log_variance: Float[np.ndarray, " c"]) -> tuple[float, ...]:
        """Standard deviations and densities."""
        noise, factor = self._noise, np.exp(log_variance)
        stds = [c.value * float(np.sqrt(f)) for c, f in zip(self.components, factor, strict=False)]
        rest = factor[len(self.components) :]
        return (*stds, *(float(getattr(noise, n) * f) for n, f in zip(self.densities, rest, strict=True)))

    @property
    def _noise(self) -> ProcessNoise:
        process = self.problem.motion.process
        assert isinstance(process, TorqueFreeProcess)
        return process.noise

    def _process(self, log_variance: Float[np.ndarray, " c"]) -> TorqueFreeProcess:
        process = self.problem.motion.process
        assert isinstance(process, TorqueFreeProcess)
        psd = dict(zip(self.densities, self.values(log_variance)[len(self.components) :], strict=True))
        return process.with_noise(replace(process.noise, **psd))


LEAST_FREE = 0.2
"""Redundancy of a component, from which its residual shows whether it is wrong."""


@dataclass(frozen=True)
class Residuals:
    """Residuals of a linear problem's solution by component.

    Attributes
    ----------
    squares : (c,) float array
        r of each component, then of each density.
    redundancy : (c,) float array
        S, likewise.
    sources : tuple[WhitenedRows, ...]
        Whitened residuals as each of them explains them: the working variable of the average information.
    sensors : tuple[SensorResiduals, ...]
        Of every sensor without landmarks.
    """

    squares: Float[np.ndarray, " c"]
    redundancy: Float[np.ndarray, " c"]
    sources: tuple["WhitenedRows", ...]
    sensors: tuple["SensorResiduals", ...]


@dataclass(frozen=True)
class WhitenedRows:
    """A right-hand side of the linear problem: one number for every whitened row.

    Attributes
    ----------
    sensors : tuple[(r, i) float array, ...]
        Of every sensor without landmarks.
    steps : (k, d) float array
        Rows of the k - 1 steps.
    observations : (N, 3) float array or None
        Rows of landmark observations, None without any.
    """

    sensors: tuple[Float[np.ndarray, "_ _"], ...]
    steps: Float[np.ndarray, "k d"]
    observations: Float[np.ndarray, "N 3"] | None

    def dot(self, other: "WhitenedRows") -> float:
        """Sum of products."""
        pairs = [*zip(self.sensors, other.sensors, strict=True), (self.steps, other.steps)]
        if self.observations is not None and other.observations is not None:
            pairs.append((self.observations, other.observations))
        return float(sum(np.vdot(a, b) for a, b in pairs))


def residuals_of(
    problem: Problem,
    here: LinearizationPoint,
    normal: NormalEquations,
    components: Sequence[ComponentRows],
    densities: Sequence[str],
    after: "StepsAfter | None" = None,
) -> Residuals:
    """Residuals of the linear problem about a point, at its solution.

    Parameters
    ----------
    densities : Sequence[str]
        Names of the disturbances wanted.
    normal : NormalEquations
        Solved, its rows in memory (`Problem.is_long` is false).
    after : StepsAfter or None
        What the solution leaves of the steps, where it is known already.
    """
    marginals = Marginals(normal.system, normal.eliminated)
    steps = after or steps_after(problem, here, marginals)
    sensors = [_sensor_after(problem, here, marginals, k) for k in range(len(problem.motion.sensors))]
    # a right-hand side of zeros, to which each source adds its own rows
    seen = None if here.linear is None else np.zeros_like(here.linear.innovation)
    nothing = WhitenedRows(
        tuple(np.zeros_like(each.rest) for each in sensors), np.zeros_like(steps.rest), seen
    )
    spent = steps.leverage + sum(each.leverage for each in sensors)
    spent += _prior_leverage(problem, here, marginals)
    sources, redundancy = [], []
    for each in components:
        chosen, free = _sensor_residuals(each, sensors, nothing)
        seen = nothing.observations
        if each.landmarks:
            seen = _observations_after(here, normal)
            free += _free_observations(problem, normal, spent)
        sources.append(WhitenedRows(tuple(chosen), nothing.steps, seen))
        redundancy.append(free)
    squares = [each.dot(each) for each in sources]
    for W in source_factors(problem, here, densities):
        # per step: W'r is what a disturbance explains of the residual, W W'r the working variable, with r of d rows
        explained = np.einsum("kdi,kd->ki", W, steps.rest)
        squares.append(float(np.vdot(explained, explained)))
        redundancy.append(steps.redundancy(W))
        sources.append(replace(nothing, steps=np.einsum("kdi,ki->kd", W, explained)))
    return Residuals(np.array(squares), np.array(redundancy), tuple(sources), tuple(sensors))


def sensor_residuals(
    problem: Problem, here: LinearizationPoint, marginals: Marginals
) -> tuple["SensorResiduals", ...]:
    """Residuals of every pose-only sensor."""
    return tuple(_sensor_after(problem, here, marginals, k) for k in range(len(problem.motion.sensors)))


@dataclass(frozen=True)
class StepsAfter:
    """Whitened residuals (k - 1, d) of the steps, and a factor (k - 1, d, w) of the share J P J' of their states."""

    rest: Float[np.ndarray, "j d"]
    spread: Float[np.ndarray, "j d w"]

    @property
    def leverage(self) -> float:
        """Unknowns that the steps determine."""
        return float(np.vdot(self.spread, self.spread))

    def redundancy(self, W: Float[np.ndarray, "k d i"]) -> float:
        """Of a disturbance with these factors."""
        spread = np.swapaxes(W, 1, 2) @ self.spread
        return float(np.vdot(W, W)) - float(np.vdot(spread, spread))


@dataclass(frozen=True)
class SensorResiduals:
    """Whitened residuals (r, i) of a sensor, their redundancy 1 - diag(J P J') and the sum of diag(J P J').

    The redundancy is 0 where a measurement is not used.
    """

    rest: Float[np.ndarray, "r i"]
    free: Float[np.ndarray, "r i"]
    leverage: float

    @cached_property
    def deleted_squares(self) -> Float[np.ndarray, " r"]:
        """Squared residuals of each measurement about states of all others (Cook and Weisberg 1982).

        Component by component; where few others determine one, with a redundancy of a fifth.
        """
        return np.einsum("ri,ri,ri->r", self.rest, self.rest, 1 / np.maximum(self.free, LEAST_FREE))

    @property
    def farthest(self) -> int:
        """Row of the measurement with the largest of them."""
        return int(self.deleted_squares.argmax())

    @property
    def least_probability(self) -> float:
        """Of larger residuals than those of the farthest measurement; 1 without any."""
        largest = float(self.deleted_squares.max(initial=0.0))
        return float(chi_square_tail(largest, self.rest.shape[1]))


def _explained_steps(
    problem: Problem, here: LinearizationPoint, errors: Float[np.ndarray, "k n"]
) -> Float[np.ndarray, "j d"]:
    return np.einsum("kdc,kc->kd", here.dynamics.rows[:, :, :-1], step_errors(problem.ordering, errors))


def step_errors(ordering: VariableOrdering, errors: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "j w"]:
    """Errors by the columns of a step's rows: moving ones of its first epoch, of its second, then the constants."""
    moving = errors[:, ordering.moving]
    return np.concatenate([moving[:-1], moving[1:], errors[:-1, ordering.constant]], axis=1)


def _explained_by_sensor(
    problem: Problem, here: LinearizationPoint, errors: Float[np.ndarray, "k n"], number: int
) -> Float[np.ndarray, "r i"]:
    sensor, rows = problem.motion.sensors[number], here.sensor_rows(problem.motion, number).by_epoch
    return rows.products(errors[:, sensor.model.columns, None])[:, :, 0]


def explained_observations(here: LinearizationPoint, normal: NormalEquations) -> Float[np.ndarray, "N 3"]:
    """Of the observations that count, zero of the others."""
    fit, linear, solution = normal.eliminated, here.linear, normal.system
    assert fit is not None
    assert linear is not None
    # of each observation the errors of its epoch's pose, then of its landmark: the columns of its rows
    poses = solution.poses[fit.observations.epoch]
    points = fit.points_step(solution.poses)[fit.observations.landmark]
    moved = np.einsum("nic,nc->ni", linear.rows[:, :, :-1], np.concatenate([poses, points], axis=1))
    return np.where(fit.used[:, None], moved, 0.0)


def steps_after(problem: Problem, here: LinearizationPoint, marginals: Marginals) -> StepsAfter:
    """Whitened residuals of the steps, and what their states' covariance leaves of them."""
    # rows [J | y] of every step: residual y - J x, and J F for the share J P J' = (J F)(J F)'
    J, y = here.dynamics.rows[:, :, :-1], here.dynamics.rows[:, :, -1]
    explained = _explained_steps(problem, here, marginals.solution.errors)
    return StepsAfter(y - explained, J @ marginals.step_rows())


def _sensor_residuals(
    of: ComponentRows, sensors: Sequence[SensorResiduals], nothing: WhitenedRows
) -> tuple[list[np.ndarray], float]:
    """Residuals of the pose-only sensors that a component is of, others zero, and their redundancy."""
    chosen, free = list(nothing.sensors), 0.0
    for k, rows in of.sensors.items():
        chosen[k] = np.zeros_like(chosen[k])
        chosen[k][:, list(rows)] = sensors[k].rest[:, list(rows)]
        free += float(sensors[k].free[:, list(rows)].sum())
    return chosen, free


def _sensor_after(
    problem: Problem, here: LinearizationPoint, marginals: Marginals, number: int
) -> SensorResiduals:
    sensor, made = problem.motion.sensors[number], here.sensor_rows(problem.motion, number)
    each = made.by_epoch
    # leverage of each component i of a row r: (J P J')_ii, with P = F F' of the row's epoch
    factors = marginals.factors[:, sensor.model.columns]
    leverage = each.variances(factors @ factors.swapaxes(1, 2))
    rest = made.rows[:, :, -1] - _explained_by_sensor(problem, here, marginals.solution.errors, number)
    return SensorResiduals(rest, made.counted[:, None] - leverage, float(leverage.sum()))


def _prior_leverage(problem: Problem, here: LinearizationPoint, marginals: Marginals) -> float:
    if problem.motion.prior is None:
        return 0.0
    # rows of the prior are in the ordering's columns, those of the factor in the layout's
    J = prior_rows(problem.ordering, here.trajectory[0], problem.motion.prior)[:, :-1]
    spread = J @ marginals.factors[0][problem.ordering.order]
    return float(np.vdot(spread, spread))


def _observations_after(here: LinearizationPoint, normal: NormalEquations) -> Float[np.ndarray, "N 3"]:
    """Whitened residuals of the observations that count."""
    fit, linear = normal.eliminated, here.linear
    assert fit is not None
    assert linear is not None
    counted = np.where(fit.used[:, None], linear.innovation, 0.0)
    return counted - explained_observations(here, normal)


def _free_observations(problem: Problem, normal: NormalEquations, spent: float) -> float:
    """Redundancy of all observations.

    The traces of all rows' leverages sum up to the number of unknowns.
    """
    fit, ordering = normal.eliminated, problem.ordering
    assert fit is not None
    # unknowns in all: constants and gauge (separator), moving errors of every epoch, and the landmarks that are determined
    values = sum(int(np.count_nonzero(fit.used[g.rows])) * g.model.dim for g in fit.observations.groups)
    count = (
        ordering.separator_dim
        + ordering.epochs * len(ordering.tridiagonal)
        + 3 * int(np.count_nonzero(fit.is_constrained))
    )
    return values - (count - spent)


def source_factors(
    problem: Problem, here: LinearizationPoint, densities: Sequence[str]
) -> list[Float[np.ndarray, "k d _"]]:
    """W = L^-1 G of disturbances, for every step."""
    motion, moving = problem.motion, problem.ordering.moving
    noise = here.dynamics.noise
    if noise is None:
        noise = motion.process.linearise_steps(here.trajectory[:-1], here.trajectory[1:], motion.dt)[2]
    # noise factor of the moving rows, its columns those of each disturbance
    G = noise[:, moving]
    Q = G @ np.swapaxes(G, 1, 2) + NOISE_FLOOR**2 * np.eye(len(moving))
    W = np.linalg.solve(np.linalg.cholesky(Q), G)
    columns = noise_columns(problem.layout.blocks)
    return [W[:, :, columns[DENSITIES[name].name]] for name in densities]
