"""Whitened factors of a motion: dynamics, prior, and observations that depend on the state of one epoch alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.compiled import address, addresses
from spinfilters.core.robust_losses import LeastSquares, RobustLoss
from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.timeline import Timeline, by_sensor, times_of
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.rotation_integrator import LinearisedSteps
from spinfilters.smoother.epoch_rows import EpochRows, weigh_rows
from spinfilters.smoother.kernels import kernels
from spinfilters.smoother.linearisation_kernels import charts_of, many_steps
from spinfilters.smoother.priors import StatePrior, VariableOrdering

STRETCH = 2048
"""Epochs whose rows are in memory together: rows of an epoch take ten times the room of what they add to the linear problem."""


class WeightedRows(NamedTuple):
    """One sensor's measurements about a trajectory, whitened and weighted by a robust loss.

    Attributes
    ----------
    by_epoch : EpochRows
        Jacobian by the model's columns, with the right-hand side as the last column.
    costs : ndarray of float, shape (r,)
        Robust costs.
    squares : ndarray of float, shape (r,)
        Squared lengths of the whitened innovations; infinite where the model does not apply.
    counted : ndarray of bool, shape (r,)
        Whether they have a weight; rows of others are zero.
    """

    by_epoch: EpochRows
    costs: Float[np.ndarray, " r"]
    squares: Float[np.ndarray, " r"]
    counted: Bool[np.ndarray, " r"]

    @property
    def rows(self) -> Float[np.ndarray, "r i c1"]:
        """Of all measurements."""
        return self.by_epoch.rows


@dataclass(frozen=True)
class SensorRows:
    """All measurements of one sensor that sees no landmark."""

    model: MeasurementModel
    epoch: Int[np.ndarray, " r"]
    values: Float[np.ndarray, "r v"]
    parameters: Float[np.ndarray, "r p"]
    scale: Float[np.ndarray, " i"] | None = None
    """Of the standard deviations that the model states, by component of the innovation; None for 1."""

    @classmethod
    def joined(cls, parts: Sequence["SensorRows"]) -> "SensorRows":
        """Parts of one sensor, one after the other."""
        columns = ([getattr(part, name) for part in parts] for name in ("epoch", "values", "parameters"))
        return cls(parts[0].model, *map(np.concatenate, columns))

    def part(self, rows: slice, first: int = 0) -> "SensorRows":
        """Some of the measurements, their frames counted from epoch ``first`` on."""
        epoch = self.epoch[rows] - first
        return SensorRows(self.model, epoch, self.values[rows], self.parameters[rows], self.scale)

    def chosen(self, which: Bool[np.ndarray, " r"]) -> "SensorRows":
        """The measurements that are true in ``which``."""
        return replace(
            self, epoch=self.epoch[which], values=self.values[which], parameters=self.parameters[which]
        )

    def counted_among(self, some: "SensorRows", counted: Bool[np.ndarray, " s"]) -> Bool[np.ndarray, " r"]:
        """Which of these measurements count among ``some`` of them."""
        if len(some.epoch) == len(self.epoch):
            return counted
        chosen = {key for key, own in zip(some._keys(), counted, strict=True) if own}
        return np.array([key in chosen for key in self._keys()], dtype=bool)

    def _keys(self) -> list[bytes]:
        """Keys by which measurements differ."""
        return [row.tobytes() for row in np.column_stack([self.epoch, self.values, self.parameters])]

    def within(self, begin: int, end: int) -> "SensorRows":
        """The measurements of the epochs from ``begin`` to before ``end``, counted from ``begin`` on."""
        first, last = np.searchsorted(self.epoch, (begin, end))
        return self.part(slice(int(first), int(last)), begin)


def without_refused(epochs: Timeline, refused: Mapping[MeasurementModel, Bool[np.ndarray, " r"]]) -> Timeline:
    """Epochs without the measurements that are true in ``refused``, by sensor in the order of time."""
    if not any(each.any() for each in refused.values()):
        return epochs
    left, found = dict(refused), []
    for epoch in epochs:
        kept = []
        for m in epoch.measurements:
            if m.model in left:
                # the first flags are this epoch's, the rest belongs to later epochs
                own, left[m.model] = np.split(left[m.model], [len(m.values)])
                m = replace(m, values=m.values[~own], parameters=m.parameters[~own])
            kept.append(m)
        found.append(replace(epoch, measurements=tuple(kept)))
    return found


def collect_sensors(epochs: Timeline) -> tuple[SensorRows, ...]:
    """Measurements without ids, by sensor; of a long timeline one stretch after the other."""
    parts: dict[int, list[SensorRows]] = {}
    for begin in range(0, len(epochs), STRETCH):
        for rows in _collect_sensors(epochs[begin : begin + STRETCH], begin):
            parts.setdefault(id(rows.model), []).append(rows)
    return tuple(map(SensorRows.joined, parts.values()))


def _collect_sensors(epochs: Timeline, begin: int) -> list[SensorRows]:
    """Sensors' measurements of a stretch whose first epoch has the number ``begin``."""
    return [
        SensorRows(m.model, found.epoch + begin, m.values, m.parameters)
        for found in by_sensor(epochs)
        if (m := found.measurement).ids is None and len(m.values)
    ]


NOTHING = np.zeros((0, 1, 1))
NOISE_FLOOR = 1e-8
"""Of every moving component per step (m, rad, m/s, rad/s): far below any sensor, it stands in where a disturbance is zero."""


@dataclass(frozen=True)
class InformationBlocks:
    """Gram matrices of rows [J | y] and how much they cost.

    Attributes
    ----------
    epochs : ndarray of float, shape (k, n1, n1)
        Each epoch alone, or the first ones that have any, components in `VariableOrdering.order`, then the right-hand side.
    steps : ndarray of float, shape (j, s1, s1)
        Each step: moving here, moving there, constants, right-hand side.
    cost : float
        Sum of (robust) squares.
    rows : ndarray of float, shape (j, d, s1)
        The steps, whitened.
    mean_squares : ndarray of float, shape (r,)
        Squared length of each observation's whitened innovation over its dimension; infinite where the model does not
        apply.
    sensor_rows : tuple[WeightedRows, ...]
        Of each sensor.
    noise : ndarray of float, shape (j, n, q) or None
        Noise factors of the steps, None where they are not in memory.
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
    dt : ndarray of float, shape (j,)
        Steps between the k epochs, s; j = k - 1.
    prior : StatePrior or None
        Prior of the first state, or None where something else constrains it.
    loss : RobustLoss
        Robust loss of each measurement's whitened innovation.
    first : ndarray of float, shape (m,) or None
        State about whose constants the steps are linearised, or None for the trajectory's own.
    driven : ndarray of float, shape (k, n) or None
        Known rates of change of every epoch's error in addition to the process, 1/s, components in the order of the layout.
    """

    process: ProcessModel
    ordering: VariableOrdering
    dt: Float[np.ndarray, " j"]
    sensors: tuple[SensorRows, ...]
    prior: StatePrior | None = None
    loss: RobustLoss = field(default_factory=LeastSquares)
    first: Float[np.ndarray, " m"] | None = None
    driven: Float[np.ndarray, "k n"] | None = None

    @cached_property
    def measured(self) -> int:
        """Scalar measurements of sensors that see no landmark."""
        return sum(rows.values.shape[0] * rows.model.dim for rows in self.sensors)

    def dynamics(self, trajectory: Float[np.ndarray, "k m"]) -> InformationBlocks:
        """Whitened steps from epoch to epoch, linearised about a trajectory whose constants are the same in all epochs."""
        if not len(self.dt):
            return InformationBlocks(NOTHING, NOTHING, 0.0, NOTHING)
        if (made := self._dynamics_in_c(trajectory)) is not None:
            return made
        about = None if self.first is None else self._at_first_constants(trajectory[:-1])
        steps = self.process.linearise_steps(trajectory[:-1], trajectory[1:], self.dt, about)
        if about is not None:
            steps = self._by_errors_here(steps, trajectory[0])
        if self.driven is not None:
            # half of it before each step, which carries it on, and half after
            carried = np.einsum("kij,kj->ki", steps.transition, self.driven[:-1]) + self.driven[1:]
            steps = steps._replace(defect=steps.defect + self.dt[:, None] / 2 * carried)
        rows, blocks = whitened_steps(self.ordering, *map(np.ascontiguousarray, steps))
        cost = float(blocks[:, -1, -1].sum())
        return InformationBlocks(NOTHING, blocks, cost, rows, noise=steps[2] if about is None else None)

    def _dynamics_in_c(self, trajectory: Float[np.ndarray, "k m"]) -> InformationBlocks | None:
        """`dynamics` in one call; None where there is none, or where the steps must be taken in groups."""
        library = kernels()
        compiled = None if library is None or self.driven is not None else many_steps(self.process)
        if library is None or compiled is None:
            return None
        ordering, places = self.ordering, self.process.layout.constant_indices
        j, n, q, d = len(self.dt), ordering.layout.error_dim, compiled.noise_dim, len(ordering.moving)
        c, at = len(ordering.constant), np.ascontiguousarray(trajectory)
        width = 2 * d + c + 1
        defect, transition, noise = np.empty((j, n)), np.empty((j, n, n)), np.empty((j, n, q))
        rows, blocks = np.empty((j, d, width)), np.empty((j, width, width))
        cost = library.linearise_steps(
            *(compiled.charts.address, compiled.steps.address, j + 1, address(self.dt), address(at)),
            *(None if self.first is None else address(self.first), len(places), address(places)),
            *(d, c, address(ordering.moving), address(ordering.constant), NOISE_FLOOR),
            *addresses(defect, transition, noise, rows, blocks),
        )
        if cost < 0:
            return None
        return InformationBlocks(NOTHING, blocks, cost, rows, noise=noise if self.first is None else None)

    def _at_first_constants(self, trajectory: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k m"]:
        """Trajectory at the constants of the marginalization prior's first estimates.

        Jacobians at other constants would add information that no measurement has.
        """
        assert self.first is not None
        at, constant = trajectory.copy(), self.process.layout.constant_indices
        at[:, constant] = self.first[constant]
        return at

    def _by_errors_here(self, steps: LinearisedSteps, state: Float[np.ndarray, " m"]) -> LinearisedSteps:
        """Steps whose derivatives by the constants about the first estimates become those by the constants' errors at ``state``."""
        assert self.first is not None
        layout, constant = self.process.layout, self.ordering.constant
        # Chain rule on the constants' columns of every step: d/d(error here) = d/d(error at first) by_here.
        by_here = np.linalg.inv(layout.reset_jacobian(layout.local(self.first, state)))
        transition = steps.transition.copy()
        transition[:, :, constant] = transition[:, :, constant] @ by_here[np.ix_(constant, constant)]
        return steps._replace(transition=transition)

    def measurements(
        self, trajectory: Float[np.ndarray, "k m"], pose_only_loss: RobustLoss | None = None
    ) -> InformationBlocks:
        """The prior, and every sensor that sees no landmark.

        Parameters
        ----------
        pose_only_loss : RobustLoss or None
            Of each measurement in place of `loss`.
        """
        n, made = self.process.layout.error_dim, []
        # without sensors there is the prior of the first epoch alone
        blocks, cost = np.zeros((len(trajectory) if self.sensors else 1, n + 1, n + 1)), 0.0
        if self.prior is not None:
            # first epoch: += [J | y]'[J | y] of the prior, its columns in the ordering already
            blocks[0] += prior_information(self.ordering, trajectory[0], self.prior)
            cost += float(blocks[0, -1, -1])
        for sensor in self.sensors:
            made.append(self.sensor_rows(sensor, trajectory, pose_only_loss))
            each, columns = made[-1].by_epoch, self.sensor_columns(sensor)
            epochs = sensor.epoch[each.first]
            # [J | y]'[J | y] of each epoch, into the rows and columns of the errors that the sensor sees
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
        scaled = innovation if sensor.scale is None else innovation / sensor.scale
        with np.errstate(invalid="ignore", over="ignore"):
            square = np.einsum("nr,nr->n", scaled, scaled)
        good = valid & np.isfinite(square)
        square = np.where(good, square, np.inf)
        # rows times the root of the loss's weight, so that their squares have the weight; rows of no use are zero
        weight = np.where(good, np.sqrt(loss.weight(square)), 0.0)
        rows = weigh_rows(innovation, jacobian, sensor.scale, weight, sensor.epoch)
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
        """Factors of the epochs ``begin`` to before ``end`` and of the steps from them; the prior goes with epoch 0 alone."""
        return replace(
            self,
            ordering=replace(self.ordering, epochs=min(end, self.ordering.epochs) - begin),
            dt=self.dt[begin:end],
            sensors=tuple(sensor.within(begin, end) for sensor in self.sensors),
            prior=None if begin else self.prior,
            driven=None if self.driven is None else self.driven[begin : end + 1],
        )


def motion_of(
    process: ProcessModel,
    epochs: Timeline,
    has_landmarks: bool,
    prior: StatePrior | None = None,
    first: Float[np.ndarray, " m"] | None = None,
) -> EpochFactors:
    """The dynamics and sensors of some epochs.

    Parameters
    ----------
    has_landmarks : bool
        Whether there are observations of landmarks.
    prior : StatePrior or None
        As of `EpochFactors`.
    first : ndarray of float, shape (m,) or None
        As of `EpochFactors`.
    """
    dt = np.diff(times_of(epochs))
    ordering = VariableOrdering(process.layout, len(epochs), has_landmarks)
    return EpochFactors(process, ordering, dt, collect_sensors(epochs), prior, first=first)


def whitened_steps(
    ordering: VariableOrdering,
    defect: Float[np.ndarray, "k n"],
    transition: Float[np.ndarray, "k n n"],
    noise: Float[np.ndarray, "k n q"],
) -> tuple[Float[np.ndarray, "k d w"], Float[np.ndarray, "k w w"]]:
    """Dynamics rows whitened by noise noise' + floor^2, and their information blocks; NaN where that has no root."""
    library = kernels()
    if library is None:
        return whitened_steps_in_numpy(ordering, defect, transition, noise)
    (k, n, q), d, c = noise.shape, len(ordering.moving), len(ordering.constant)
    width = 2 * d + c + 1
    rows, blocks = np.empty((k, d, width)), np.empty((k, width, width))
    failed = library.step_rows(
        *(k, n, d, c, q),
        *addresses(ordering.moving, ordering.constant),
        NOISE_FLOOR,
        *addresses(defect, transition, noise, rows, blocks),
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
    # Rows [-Phi_moving | I | -Phi_constant | defect]: moving errors here (d), there (d), constants, right-hand side.
    rows[:, :, :d] = -transition[:, moving][:, :, moving]
    rows[:, :, d : 2 * d] = np.eye(d)
    rows[:, :, 2 * d : -1] = -transition[:, moving][:, :, constant]
    rows[:, :, -1] = defect[:, moving]
    # Whitened by the Cholesky factor of Q = noise noise' + floor^2 I.
    spread = noise[:, moving] @ noise[:, moving].swapaxes(1, 2)
    spread[:, np.arange(d), np.arange(d)] += NOISE_FLOOR**2
    try:
        rows = np.linalg.solve(np.linalg.cholesky(spread), rows)
    except np.linalg.LinAlgError:  # a trial that is not finite: its cost says so
        rows = np.full_like(rows, np.nan)
    with np.errstate(invalid="ignore", over="ignore"):
        return rows, rows.swapaxes(1, 2) @ rows


def prior_information(
    ordering: VariableOrdering, first: Float[np.ndarray, " m"], prior: StatePrior
) -> Float[np.ndarray, "n1 n1"]:
    """[J | y]'[J | y] of `prior_rows`."""
    layout, library = ordering.layout, kernels()
    charts = None if library is None else charts_of(layout)
    if library is None or charts is None:
        rows = prior_rows(ordering, first, prior)
        return rows.T @ rows
    n = layout.error_dim
    mean, x = np.ascontiguousarray(prior.mean, dtype=float), np.ascontiguousarray(first)
    whitening, gram = np.ascontiguousarray(prior.whitened(np.eye(n))), np.empty((n + 1, n + 1))
    arrays = addresses(mean, whitening, ordering.order, x, gram)
    if library.linearise_first(charts.address, *arrays) < 0:
        raise MemoryError("no memory to linearise the prior")
    return gram


def prior_rows(
    ordering: VariableOrdering, first: Float[np.ndarray, " m"], prior: StatePrior
) -> Float[np.ndarray, "n n1"]:
    """Rows of the prior in the error about the linearisation point, whitened; it is Gaussian about its own mean."""
    layout = ordering.layout
    # about the linearisation point the error of the prior's mean is -away + G^-1 d, with the reset Jacobian G at away
    away = layout.local(prior.mean, first)
    by_trial = np.linalg.inv(layout.reset_jacobian(away))[:, ordering.order]
    return prior.whitened(np.concatenate([by_trial, -away[:, None]], axis=1))


def _inverse(order: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    result = np.empty(len(order), dtype=int)
    result[order] = np.arange(len(order))  # place in the ordering of every component of the layout
    return result
