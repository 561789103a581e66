"""The iterated update: Gauss-Newton on the most probable state, with a line search, and when it is worth making.

The state sought, in the coordinates y of the predicted belief (error = F y, y standard normal), is the least of

    |y|^2 + |r(y)|^2,   r the whitened residual of the measurement at retract(mean, F y).

About a trial y the residual is linear in y; the least of that model is the next trial, taken in full, or halved until the objective
falls. Every model holds the one prior and the one measurement, so that however often it iterates the measurement counts once (Bell
and Cathey 1993); the covariance is that of the last model. See Skoglund, Hendeby, Axehill (2015) for the line search.

`IteratedUpdate` does so for a sensor without landmarks. `IteratedObservations` does the same for observations of landmarks, whose
own errors count as noise there, whitened as at the point before the update.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.filters.compiled_steps import Update
from spinfilters.filters.filter import reset_factor
from spinfilters.filters.landmark_observations import ChosenObservations, SolvedObservations, corrected
from spinfilters.filters.landmark_steps import LinearisedObservations, MapObservations
from spinfilters.filters.measurement_prediction import LinearisedRows, linear_rows
from spinfilters.filters.square_root import Correction, square_root_update
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.state_blocks import ATTITUDE
from spinfilters.models.state_layout import StateLayout

HALVINGS = 6
"""Of a step at most: a 64th that still does not fall says that the trial is the least there is, to rounding."""

SMALLEST_RANGE = 1e-3
"""Of a body, m: divides its displacement."""
SAMPLE = 16
"""Values at which an update's linear model is checked, spread over all."""


@dataclass(frozen=True)
class IterationOptions:
    """Options of an iterated update.

    Attributes
    ----------
    iterations : int
        Linearisations at most; 1 is the plain update. The estimator iekf iterates to convergence instead.
    tolerance : float
        Standard deviations. An update ends when its remaining step is smaller. It needs no second linearisation if its
        residual differs by less, in norm, from the one that the linear model predicts.
    """

    iterations: Annotated[int, NumberRange(1, 1000, whole=True)] = 4
    tolerance: Annotated[float, NumberRange(1e-15, 1e9)] = 0.1

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise InputError(f"iterations is {self.iterations}; give at least 1, which is the plain update")
        if not (np.isfinite(self.tolerance) and self.tolerance > 0):
            raise InputError(f"tolerance is {self.tolerance}; give a positive number of standard deviations")


class Solution(Protocol):
    """Minimum of the linearised objective about a trial point."""

    @property
    def coordinates(self) -> Float[np.ndarray, " r"]:
        """Coordinates y of the minimum."""
        ...

    def length(self, step: Float[np.ndarray, " r"]) -> float:
        """Length of a step of y in standard deviations of the model's posterior."""
        ...


Found = TypeVar("Found", bound=Solution)
Objective = Callable[[Float[np.ndarray, " r"]], float]
"""|y|^2 + |r(y)|^2, infinite where the measurement is impossible."""


def iterate(
    first: Found,
    solve: Callable[[Float[np.ndarray, " r"]], Found],
    objective: Objective,
    options: IterationOptions,
) -> tuple[Float[np.ndarray, " r"], Found]:
    """The most probable y, and the solution of the last model.

    Parameters
    ----------
    first : Found
        The solution about y = 0.
    solve : Callable[[ndarray of float, shape (r,)], Found]
        Solution of the model linearised about a trial.
    """
    y = np.zeros(len(first.coordinates))
    value, solution = objective(y), first
    for _ in range(options.iterations - 1):
        trial, after = _search_line(objective, y, value, solution.coordinates)
        if not after < value:
            return y, solution
        y, value, solution = trial, after, solve(trial)
        if solution.length(solution.coordinates - y) <= options.tolerance:
            return solution.coordinates, solution
    return _search_line(objective, y, value, solution.coordinates)[0], solution


def agrees(
    residual: Float[np.ndarray, " k"], expected: Float[np.ndarray, " k"], options: IterationOptions
) -> bool:
    """Whether a residual is as small as its linear model predicted.

    The linear model's minimum is then the objective's.
    A residual that is off by e moves the least by |U^-T H' e| <= |e| standard deviations of what is left.
    """
    off = residual - expected
    return float(off @ off) <= options.tolerance**2


def _search_line(
    objective: Objective, y: Float[np.ndarray, " r"], value: float, target: Float[np.ndarray, " r"]
) -> tuple[Float[np.ndarray, " r"], float]:
    """Backtracking line search towards the target.

    A point where the objective has fallen, and its value; y itself where none is found.
    """
    share = 1.0
    for _ in range(HALVINGS + 1):
        trial = target if share == 1.0 else y + share * (target - y)
        after = objective(trial)
        if after < value:
            return trial, after
        share /= 2
    return y, value


def is_small(
    layout: StateLayout, mean: Float[np.ndarray, " m"], correction: Correction, options: IterationOptions
) -> bool:
    """Whether a correction is so small that a second linearisation changes nothing that matters.

    A correction moves a residual by |H e| <= |U y| standard deviations; the linear model is off by that times `curvature`.
    """
    length = math.sqrt(correction.shift @ correction.shift)
    return length * curvature(layout, mean, correction.error) <= options.tolerance


def curvature(layout: StateLayout, mean: Float[np.ndarray, " m"], error: Float[np.ndarray, " n"]) -> float:
    """Relative error of a linearly predicted change of residual, in order of magnitude.

    It is the sum of the rotation (rad) and the relative change of range.
    """
    if not layout.has(ATTITUDE):
        return math.inf
    total = math.hypot(*error[layout.slice("a")].tolist())
    if layout.translates:
        away = math.hypot(*mean[layout.mean_slice("t")].tolist())
        total += math.hypot(*error[layout.slice("t")].tolist()) / max(away, SMALLEST_RANGE)
    return total


def sample_rows(count: int) -> tuple[slice, float]:
    """Rows, spread over so many, at which a linear model is checked, and how many rows each of them represents."""
    spacing = -(-count // SAMPLE)
    return slice(None, None, spacing), float(spacing)


def linear_model_holds(
    rows: LinearisedRows, spacing: float, update: Update, options: IterationOptions
) -> bool:
    """Whether sampled rows, each counted ``spacing`` times, are as their linear model predicted, or iteration is off."""
    if options.iterations == 1:
        return True
    expected = rows.innovation - rows.jacobian @ update.correction.error[rows.columns]
    m = rows.measurement
    after = m.model.linearise(update.mean, m.parameters, m.values)
    residual = after.innovation
    if rows.root_weights is not None:
        residual = residual * rows.root_weights[:, np.newaxis]
    root = np.sqrt(spacing)
    good = agrees(root * residual.reshape(-1), root * expected.reshape(-1), options)
    return good and bool(after.valid.all())


@dataclass(frozen=True)
class IteratedUpdate:
    """Iterated update in the coordinates y of a predicted belief, whose error about its mean is factor @ y.

    Attributes
    ----------
    layout : StateLayout
        Layout of the state.
    mean : ndarray of float, shape (m,)
        Mean of the predicted belief.
    factor : ndarray of float, shape (n, n)
        Its covariance factor.
    rows : LinearisedRows
        Linearised at the mean; the noise is what it is there.
    """

    layout: StateLayout
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "n n"]
    rows: LinearisedRows

    def solve(self, first: Correction, options: IterationOptions) -> Update:
        """The most probable point, from the correction about the mean."""
        y, correction = iterate(first, self.solution, self.objective, options)
        correction = replace(correction, error=self.factor @ y)
        factor = reset_factor(self.layout, correction.error, correction.factor)
        return Update(self._point(y), correction, factor)

    def objective(self, y: Float[np.ndarray, " n"]) -> float:
        """|y|^2 + |r|^2, infinite where a value is impossible."""
        m = self.rows.measurement
        away, valid = m.model.innovations(self._point(y), m.parameters, m.values)
        if not (valid.all() and np.isfinite(away).all()):
            return np.inf
        residual = self._weighing @ away[..., np.newaxis]
        return float(y @ y) + float(np.sum(residual * residual))

    def solution(self, y: Float[np.ndarray, " n"]) -> Correction:
        """Correction by the model linearised at y, as an error about the mean; the objective must be finite there."""
        point = self._point(y)
        m = self.rows.measurement
        rows = linear_rows(m, point)
        # Errors about the point by y: reset Jacobian times factor, so that the prior mean lies at -moved y.
        moved = self.layout.reset_jacobian(self._rows @ y) @ self._rows
        whitening = m.model.whitening(point, m.parameters)
        innovation, jacobian = rows.innovation, rows.jacobian
        # Rows whitened at y are re-whitened by the weighted noise at the mean: W_mean W_y^-1.
        if not np.array_equal(whitening, self._weighing):  # noise that depends on the state, or weights
            back = np.swapaxes(whitening, 1, 2)
            turn = np.swapaxes(np.linalg.solve(back, np.swapaxes(self._weighing, 1, 2)), 1, 2)
            innovation, jacobian = (turn @ innovation[..., np.newaxis])[..., 0], turn @ jacobian
        rows = replace(rows, innovation=innovation, jacobian=jacobian, log_noise=self.rows.log_noise)
        return square_root_update(replace(rows.predicted(moved, -(moved @ y)), state_factor=self.factor))

    def _point(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        return self.layout.retract(self.mean, self._rows @ y)

    @property
    def _rows(self) -> Float[np.ndarray, "n N"]:
        """Rows of the covariance factor that belong to the state."""
        return self.factor[: self.layout.error_dim]

    @cached_property
    def _weighing(self) -> Float[np.ndarray, "k d d"]:
        """Whitening matrix of a residual times the square root of its weight."""
        m, root = self.rows.measurement, self.rows.root_weights
        whitening = m.model.whitening(self.mean, m.parameters)
        return whitening if root is None else whitening * root[:, np.newaxis, np.newaxis]


@dataclass(frozen=True)
class IteratedObservations:
    """Landmark observations in the coordinates y of a predicted belief, whose error about its mean is factor @ y.

    Attributes
    ----------
    first : SolvedObservations
        The solution about the mean.
    """

    observations: MapObservations
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "N N"]
    first: SolvedObservations

    def solution(self, options: IterationOptions) -> SolvedObservations:
        """The most probable point, from the first solution."""
        if options.iterations == 1 or self._is_good(options):
            return self.first
        y, last = iterate(self.first, self._solved_at, self._objective, options)
        return last._replace(correction=replace(last.correction, error=self.factor @ y))

    def _is_good(self, options: IterationOptions) -> bool:
        """Whether the innovations at the first solution are what the linear model predicted."""
        rows, error = self.first.whitened.rows, self.first.correction.error
        found = self._linear(error)
        residual = self._whiten_by_sensor(found)
        expected = rows[..., -1] - rows[..., :-1] @ error[self.observations.columns]
        valid = bool(found.valid[self.first.used].all())
        return valid and agrees(residual.reshape(-1), expected.reshape(-1), options)

    def _objective(self, y: Float[np.ndarray, " N"]) -> float:
        found = self._linear(self.factor @ y)
        if not found.valid[self.first.used].all():
            return np.inf
        residual = self._whiten_by_sensor(found)
        return float(y @ y) + float(np.sum(residual * residual))

    def _solved_at(self, y: Float[np.ndarray, " N"]) -> SolvedObservations:
        """The solution of the model linearised at y, as a correction about y = 0."""
        error, o = self.factor @ y, self.observations
        found, pose, c = self._linear(error), o.sensor.columns, len(o.sensor.columns)
        # Jacobian by the pose refers to errors about the mean: times the reset Jacobian of the correction so far.
        reset = o.layout.reset_jacobian(error[: o.layout.error_dim])[np.ix_(pose, pose)]
        rows = found.rows.copy()
        rows[..., :c] = rows[..., :c] @ reset
        # Innovation linearised at y, extrapolated back to y = 0 by pose and by the landmarks' modes.
        own = o.modes @ error[o.layout.error_dim : o.layout.error_dim + o.modes.shape[2]]
        rows[..., -1] += rows[..., :c] @ error[pose] + np.einsum("kdi,ki->kd", rows[..., c:-1], own)
        used, weights = self.first.used, self.first.weights
        white = o.landmarks.steps.whitened(o.landmarks, o.at[used], rows[used], weights)
        return corrected(o, found, white, ChosenObservations(used, weights), self.factor)

    @cached_property
    def _about_mean(self) -> LinearisedObservations:
        return self.observations.rows_at(self.mean)

    def _linear(self, error: Float[np.ndarray, " N"]) -> LinearisedObservations:
        o, n = self.observations, self.observations.layout.error_dim
        points = o.points + o.modes @ error[n : n + o.modes.shape[2]]
        return o.rows_at(o.layout.retract(self.mean, error[:n]), points)

    def _whiten_by_sensor(self, found: LinearisedObservations) -> Float[np.ndarray, "u d"]:
        """The used innovations, that were whitened by the sensor's noise alone."""
        o, used = self.observations, self.first.used
        rows = self._about_mean.rows[used]
        rows[..., -1] = found.rows[used, :, -1]
        return o.landmarks.steps.whitened(o.landmarks, o.at[used], rows, self.first.weights).rows[..., -1]
