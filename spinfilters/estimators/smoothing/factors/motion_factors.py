"""Whitened factors of a motion: dynamics, prior, and pose-only observations.

About a trial trajectory x_0 .. x_K-1 the errors obey, with the defect b_k by which the trial misses its own dynamics,

    e_k+1 = Phi e_k + b_k + G n,     (e_0 about x_0) = (prior mean [-] x_0) + std n.

Each line divided by its noise is a row of a least-squares problem (Bell 1994). What is kept of the rows is their Gram matrix
with the right-hand side as last column, one per epoch and one per step.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.estimators.estimator import ProcessModel
from spinfilters.estimators.robust.losses import LeastSquares, RobustLoss
from spinfilters.estimators.smoothing.factors.epoch_rows import EpochRows
from spinfilters.estimators.smoothing.factors.sensor_rows import (
    STRETCH,
    SensorRows,
    WeightedRows,
    collect_sensors,
)
from spinfilters.estimators.smoothing.factors.variable_ordering import VariableOrdering
from spinfilters.estimators.smoothing.kernels.compiled_kernels import kernels
from spinfilters.estimators.smoothing.state_prior import StatePrior
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.symbolic.compiled import address

NOTHING = np.zeros((0, 1, 1))
NOISE_FLOOR = 1e-8
"""Of every moving component per step (m, rad, m/s, rad/s): far below any sensor, it stands in where a disturbance is zero."""


@dataclass(frozen=True)
class InformationBlocks:
    """Gram matrices of rows [J | y] and how much they cost.

    Attributes
    ----------
    epochs: (k, n + 1, n + 1) of each epoch alone, components in `VariableOrdering.order`, then the right-hand side.
    steps: (k - 1, 2 d + c + 1, ...) of each step: moving here, moving there, constants, right-hand side.
    cost: sum of (robust) squares.   rows: (k - 1, d, 2 d + c + 1) of the steps, whitened.
    mean_squares: (r,) squared length of each observation's whitened innovation over its dimension; infinite where the model does
        not apply.
    sensor_rows: of each sensor.   noise: (k - 1, n, q) noise factors of the steps, None where they are not in memory.
    """

    epochs: Float[np.ndarray, "k n1 n1"]
    steps: Float[np.ndarray, "j s1 s1"]
    cost: float
    rows: Float[np.ndarray, "j d s1"]
    mean_squares: Float[np.ndarray, " r"] = field(default_factory=lambda: np.zeros(0))
    sensor_rows: tuple[WeightedRows, ...] = ()
    noise: Float[np.ndarray, "j n q"] | None = None


@dataclass(frozen=True)
class EpochFactors:
    """The dynamics, prior and sensors of some epochs.

    Attributes
    ----------
    dt: (k - 1,) s.   prior: of the first state, or None where something else holds it.
    loss: of each measurement's whitened length.   first: (m,) whose constants the steps are linearised about, or None for
    their own.
    """

    process: ProcessModel
    ordering: VariableOrdering
    dt: Float[np.ndarray, " j"]
    sensors: tuple[SensorRows, ...]
    prior: StatePrior | None = None
    loss: RobustLoss = field(default_factory=LeastSquares)
    first: Float[np.ndarray, " m"] | None = None

    @cached_property
    def measured(self) -> int:
        """Scalar measurements of sensors that see no landmark."""
        return sum(rows.values.shape[0] * rows.model.dim for rows in self.sensors)

    def dynamics(self, trajectory: Float[np.ndarray, "k m"]) -> InformationBlocks:
        """Steps from epoch to epoch, linearised about a trajectory.

        Its constants are the same in every epoch.
        """
        if not len(self.dt):
            return InformationBlocks(NOTHING, NOTHING, 0.0, NOTHING)
        about = None if self.first is None else self._at_first_constants(trajectory[:-1])
        steps = self.process.linearise_steps(trajectory[:-1], trajectory[1:], self.dt, about)
        rows, blocks = whitened_steps(self.ordering, *map(np.ascontiguousarray, steps))
        cost = float(blocks[:, -1, -1].sum())
        return InformationBlocks(NOTHING, blocks, cost, rows, noise=steps[2] if about is None else None)

    def _at_first_constants(self, trajectory: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k m"]:
        """Trajectory at the constants of the marginalization prior's first estimates.

        Jacobians at other constants would add information that no measurement has.
        """
        assert self.first is not None
        at, constant = trajectory.copy(), self.process.layout.constant_indices
        at[:, constant] = self.first[constant]
        return at

    def measurements(
        self, trajectory: Float[np.ndarray, "k m"], pose_only_loss: RobustLoss | None = None
    ) -> InformationBlocks:
        """The prior, and every sensor that sees no landmark.

        Parameters
        ----------
        pose_only_loss: of each measurement in place of `loss`.
        """
        n, made = self.process.layout.error_dim, []
        blocks, cost = np.zeros((len(trajectory), n + 1, n + 1)), 0.0
        if self.prior is not None:
            rows = prior_rows(self.ordering, trajectory[0], self.prior)
            blocks[0] += rows.T @ rows
            cost += float(rows[:, -1] @ rows[:, -1])
        for sensor in self.sensors:
            made.append(self.sensor_rows(sensor, trajectory, pose_only_loss))
            each, columns = EpochRows(made[-1].rows, sensor.epoch), self.sensor_columns(sensor)
            epochs = sensor.epoch[each.first]
            blocks[epochs[:, None, None], columns[:, None], columns] += each.information
            cost += float(made[-1].costs.sum())
        means = (own.squares / sensor.model.dim for sensor, own in zip(self.sensors, made, strict=True))
        squares = np.concatenate([np.zeros(0), *means])
        return InformationBlocks(blocks, NOTHING, cost, NOTHING, squares, tuple(made))

    def sensor_columns(self, sensor: SensorRows) -> Int[np.ndarray, " c1"]:
        """Places of `sensor_rows`' columns among the components in `VariableOrdering.order` and the right-hand side."""
        return np.append(_inverse(self.ordering.order)[sensor.model.columns], self.process.layout.error_dim)

    def sensor_rows(
        self,
        sensor: SensorRows,
        trajectory: Float[np.ndarray, "k m"],
        pose_only_loss: RobustLoss | None = None,
    ) -> WeightedRows:
        """Weighted whitened rows of one sensor about a trajectory."""
        loss = self.loss if pose_only_loss is None else pose_only_loss
        innovation, jacobian, valid, _ = sensor.model.linearise_each(
            trajectory, sensor.epoch, sensor.parameters, sensor.values
        )
        if sensor.scale is not None:
            innovation, jacobian = innovation / sensor.scale, jacobian / sensor.scale[:, None]
        with np.errstate(invalid="ignore", over="ignore"):
            square = np.einsum("nr,nr->n", innovation, innovation)
        good = valid & np.isfinite(square)
        square = np.where(good, square, np.inf)
        weight = np.where(good, np.sqrt(loss.weight(square)), 0.0)
        rows = np.concatenate([jacobian, innovation[..., None]], axis=2)
        other = np.flatnonzero(weight != 1.0)
        if len(other):
            rows[other] *= weight[other, None, None]
            rows[np.flatnonzero(~good)] = 0.0
        return WeightedRows(rows, np.where(good, loss.cost(square), 0.0), square, weight > 0)

    def inliers(
        self,
        sensor: SensorRows,
        trajectory: Float[np.ndarray, "k m"],
        pose_only_loss: RobustLoss | None = None,
    ) -> Bool[np.ndarray, " r"]:
        """Mask of a sensor's measurements with a weight."""
        result = np.empty(len(sensor.epoch), dtype=bool)
        for first in range(0, len(result), STRETCH):
            rows = slice(first, first + STRETCH)
            result[rows] = self.sensor_rows(sensor.part(rows), trajectory, pose_only_loss).counted
        return result

    def stretch(self, begin: int, end: int) -> "EpochFactors":
        """Epochs from ``begin`` to before ``end``, and steps from them.

        The prior belongs to the first epoch of all.
        """
        return replace(
            self,
            ordering=replace(self.ordering, epochs=min(end, self.ordering.epochs) - begin),
            dt=self.dt[begin:end],
            sensors=tuple(sensor.within(begin, end) for sensor in self.sensors),
            prior=None if begin else self.prior,
        )


def motion_of(process: ProcessModel, epochs: Timeline, has_landmarks: bool) -> EpochFactors:
    """The dynamics and sensors of some epochs, without a prior.

    Parameters
    ----------
    has_landmarks: whether there are observations of landmarks.
    """
    dt = np.diff(times_of(epochs))
    return EpochFactors(
        process, VariableOrdering(process.layout, len(epochs), has_landmarks), dt, collect_sensors(epochs)
    )


def whitened_steps(
    ordering: VariableOrdering,
    defect: Float[np.ndarray, "k n"],
    transition: Float[np.ndarray, "k n n"],
    noise: Float[np.ndarray, "k n q"],
) -> tuple[Float[np.ndarray, "k d w"], Float[np.ndarray, "k w w"]]:
    """Dynamics rows whitened by noise noise' + floor^2, and their information blocks.

    NaN where the covariance has no square root.
    """
    library = kernels()
    if library is None:
        return whitened_steps_in_numpy(ordering, defect, transition, noise)
    (k, n, q), d, c = noise.shape, len(ordering.moving), len(ordering.constant)
    width = 2 * d + c + 1
    rows, blocks = np.empty((k, d, width)), np.empty((k, width, width))
    failed = library.step_rows(
        *(k, n, d, c, q),
        *map(address, (ordering.moving, ordering.constant)),
        NOISE_FLOOR,
        *map(address, (defect, transition, noise, rows, blocks)),
    )
    if failed:
        raise MemoryError("no memory to whiten the steps")
    return rows, blocks


def whitened_steps_in_numpy(
    ordering: VariableOrdering, defect: np.ndarray, transition: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`whitened_steps` for machines without a compiler."""
    d, moving, constant = len(ordering.moving), ordering.moving, ordering.constant
    rows = np.zeros((len(defect), d, 2 * d + len(constant) + 1))
    rows[:, :, :d] = -transition[:, moving][:, :, moving]
    rows[:, :, d : 2 * d] = np.eye(d)
    rows[:, :, 2 * d : -1] = -transition[:, moving][:, :, constant]
    rows[:, :, -1] = defect[:, moving]
    spread = noise[:, moving] @ noise[:, moving].swapaxes(1, 2)
    spread[:, np.arange(d), np.arange(d)] += NOISE_FLOOR**2
    try:
        rows = np.linalg.solve(np.linalg.cholesky(spread), rows)
    except np.linalg.LinAlgError:  # a trial that is not finite: its cost says so
        rows = np.full_like(rows, np.nan)
    with np.errstate(invalid="ignore", over="ignore"):
        return rows, rows.swapaxes(1, 2) @ rows


def prior_rows(
    ordering: VariableOrdering, first: Float[np.ndarray, " m"], prior: StatePrior
) -> Float[np.ndarray, "n n1"]:
    """Jacobian of the prior's error by that about the linearisation point.

    The prior is Gaussian about its own mean.
    """
    layout = ordering.layout
    away = layout.local(prior.mean, first)
    by_trial = np.linalg.inv(layout.reset_jacobian(away))[:, ordering.order]
    return prior.whitened(np.concatenate([by_trial, -away[:, None]], axis=1))


def _inverse(order: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    result = np.empty(len(order), dtype=int)
    result[order] = np.arange(len(order))
    return result
